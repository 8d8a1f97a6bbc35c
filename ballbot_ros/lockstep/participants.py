"""A participant of a run, its announcements and objections, and strangers on its topics."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, cast

from ballbot_ros.errors import one_line
from ballbot_ros.files import OUR_PACKAGE
from ballbot_ros.lockstep.lockstep import RunIdentity
from ballbot_ros.parameters import GYRO, parameters_of
from ballbot_ros.parameters.timing import SECOND_NS

MAP_HASH = 'map_sha256'
"""Parameter that identifies the map by its content, since the same file may have another path on
another machine."""

SOURCE_HASH = 'implementation_sha256'
"""Parameter that identifies the code of a controller other than the document's."""

TUNABLE = 'tunable'
"""Parameter with the names of those that a controller takes over during a run."""


class LocalNode(NamedTuple):
    """A node on the plant's machine that may take part in its run."""

    role: str
    process: int

    def __str__(self) -> str:
        return f'{self.role} (process {self.process})'


@dataclass(frozen=True)
class Participant:
    """A node that takes part in runs.

    Attributes
    ----------
    role : str
        Its function in the graph: the node of the parameter table that it stands for.
    node : str
        Fully qualified name, such as ``/gyro_driver``.
    instance : str
        Distinguishes nodes that are otherwise equal.
    implementation : str
        Program and version.
    guid_prefix : str
        Prefix of the identifiers of its publishers, as hexadecimal text; '' if unknown, in which
        case its publishers are identified by the name of their node.
    topics : tuple of str
        The periodic topics that it publishes, with a message at each multiple of the period.
    parameters : mapping of str to object
        The values of its parameters in this run, as far as it announces them.
    """

    role: str
    node: str
    host: str
    process: int
    instance: str
    implementation: str
    parameters_sha256: str
    guid_prefix: str = ''
    topics: tuple[str, ...] = ()
    parameters: Mapping[str, object] = field(default_factory=dict, compare=False)

    @property
    def is_foreign(self) -> bool:
        """Whether it is a node of another package."""
        return self.implementation.split()[:1] != [OUR_PACKAGE]

    def with_faults(self, text: str) -> Participant:
        """Return the participant with other faults, which it was given during the run."""
        return replace(self, parameters={**self.parameters, 'faults': text})

    def longest_delay(self) -> int:
        """Return the longest dead time of its samples [physics steps]; 0 unless it announces one.

        Raises ParameterError if it announces a value that is not allowed.
        """
        longest = 0
        for name in ('delay', 'delay_jitter'):
            declared = parameters_of(self.role).get(name)
            if declared and name in self.parameters:
                value = declared.check(self.parameters[name], f'{self} announces ')
                longest += cast(int, value)
        if self.role == GYRO and self.parameters.get('link'):
            # Imported only here: numpy would delay the start of every run.
            from ballbot_ros.robot.brick.link import longest_analog_steps

            row = parameters_of(GYRO)['converter_period']
            period = row.check(self.parameters.get(row.name, row.default), f'{self} announces ')
            longest += longest_analog_steps(True, cast(float, period))
        if text := self.parameters.get('faults'):
            # Likewise.
            from ballbot_ros.robot.brick.faults import late_steps, parse_faults

            declared = parameters_of(self.role)['faults']
            text = cast(str, declared.check(text, f'{self} announces '))
            longest += late_steps(parse_faults(text))
        return longest

    def __str__(self) -> str:
        return f'{self.node} (process {self.process} on {self.host})'


@dataclass(frozen=True)
class Objection:
    """A participant's report of a sample that can't belong to this run, or that it can't continue.

    In the second case, `topic` is ''.
    """

    text: str
    topic: str = ''
    stamp_ns: int = 0

    def told_by(self, participant: Participant) -> str:
        """Return the objection of a participant that can't continue as one line."""
        text = one_line(self.text) or 'it cannot continue'
        return text if text.startswith(participant.role) else f'{participant.role}: {text}'

    @classmethod
    def to_sample(cls, topic: str, stamp_ns: int, kind: str = 'sample') -> Objection:
        """Return the objection to a sample that no participant can have sent."""
        text = (
            f'{topic!r} has a second {kind} stamped {stamp_ns / SECOND_NS:.3f} s, or one ahead of '
            'the run'
        )
        return cls(text, topic, stamp_ns)


@dataclass(frozen=True)
class Announcement:
    """A participant's description of itself, sent when it joins a run and at each roll call.

    Attributes
    ----------
    answered_ns : int
        The stamp of its newest sample in this run [ns], 0 before the first.
    awaits : mapping of str to int or None
        Of a controller: the topics whose samples it lacks for its next answer. For each, the stamp
        of the newest sample that has arrived since its last answer [ns], which is not the awaited
        one; None if none has.
    """

    participant: Participant
    run: str
    answered_ns: int = 0
    objection: Objection | None = None
    awaits: Mapping[str, int | None] = field(default_factory=dict)


class Membership(NamedTuple):
    """A participant, when it joined the run [ns], and whether it replaced one that had gone."""

    participant: Participant
    since_ns: int
    is_successor: bool = False


class RunMember:
    """A participant's part in runs: it joins each, and announces itself and its objections.

    `run` is the run that it has joined; None before the first.
    """

    def __init__(self, participant: Participant) -> None:
        self.participant = participant
        self.run: RunIdentity | None = None
        self._objection: Objection | None = None
        self._left = ''

    def includes(self, stamp_ns: int) -> bool:
        """Return whether a sample can belong to the run that the participant has joined."""
        return self.run is not None and stamp_ns >= self.run.start_ns

    def join(self, run: RunIdentity) -> bool:
        """Join a run without earlier objections; return whether the plant is another one.

        A run that another plant's has interrupted can't be continued: its state is lost.
        """
        before, self.run, self._objection = self.run, run, None
        is_another_plants = before is not None and run.plant != before.plant
        if before and is_another_plants:
            if run.name == self._left:
                self._objection = Objection(f'another run, {before.name!r}, has interrupted it')
            self._left = before.name
        return is_another_plants

    def objects(self, objection: Objection) -> bool:
        """Note an objection; return whether it is new, so that it must be announced."""
        before, self._objection = self._objection, objection
        return objection != before

    def announcement(
        self, answered_ns: int, awaits: Mapping[str, int | None]
    ) -> Announcement | None:
        """Return what to announce, as in :class:`Announcement`; None before the first run."""
        if self.run is None:
            return None
        return Announcement(self.participant, self.run.name, answered_ns, self._objection, awaits)


ANSWER_CALLS = 5
"""Roll calls after which a participant that has answered none of them counts as gone."""

GONE_S = 2.0
"""Time for which a departed publisher can still explain an objection."""

MAX_POLL_GAP_S = 0.5
"""Upper limit of the time counted between two looks at the graph: a publisher that leaves is
noticed only at the next look."""

NAME_S = 5.0
"""Time within which the middleware reports the node name of a publisher, if at all."""

LEASE_S = 21.0
"""Age from which a suspect counts as alive. The middleware's lease keeps a killed process in the
graph for 20 s; a publisher that stays longer was alive while the run waited for it to leave."""


class Publisher(NamedTuple):
    """A publisher in the graph; `node` is '' until its name is known."""

    gid: bytes
    node: str


@dataclass
class _Suspect:
    """A publisher that belongs to no participant."""

    topic: str
    node: str
    since_s: float
    last_seen_s: float
    heard_at_call: int | None = None

    @property
    def problem(self) -> str:
        name = self.node or 'an unnamed node'
        return f'{name} publishes on {self.topic!r}, but takes no part in the run'


class Strangers:
    """Finds the publishers of strangers.

    A publisher whose node has not announced itself is a suspect. It is a stranger as soon as one of
    its samples arrives, or if it outlasts the lease of a dead process. `owners` are the roles that
    publish on each lockstep topic.
    """

    def __init__(self, owners: Mapping[str, Collection[str]]) -> None:
        self._owners = owners
        self._publishers: dict[bytes, str] = {}
        self._first_seen_s: dict[bytes, float] = {}
        self._polled_at_s: float | None = None
        self._now_s = 0.0
        self.begin()

    def begin(self) -> None:
        """Start over with another run."""
        self._suspects: dict[bytes, _Suspect] = {}
        self._present: list[_Suspect] = []
        self._alone_since_s: float | None = None

    def update(
        self,
        publishers: Mapping[str, Sequence[Publisher]],
        participants: Collection[Participant],
        now_s: float,
    ) -> None:
        """Update the publishers on each topic; `now_s` is a time on a monotonic clock [s]."""
        if self._polled_at_s is not None:
            self._now_s += min(now_s - self._polled_at_s, MAX_POLL_GAP_S)
        self._polled_at_s = now_s
        there = set()
        for topic, found in publishers.items():
            gids = {publisher.gid for publisher in found}
            there |= gids
            for publisher in found:
                if publisher.gid in self._publishers:
                    continue
                if owner := self._owner(topic, publisher, gids, participants):
                    self._publishers[publisher.gid] = owner
                    self._suspects.pop(publisher.gid, None)
                    continue
                now = self._now_s
                since_s = self._first_seen_s.setdefault(publisher.gid, now)
                new = _Suspect(topic, '', since_s, now)
                suspect = self._suspects.setdefault(publisher.gid, new)
                suspect.node = publisher.node or suspect.node
                suspect.last_seen_s = now
        self._present = [each for gid, each in self._suspects.items() if gid in there]

    def _owner(
        self,
        topic: str,
        publisher: Publisher,
        gids: Collection[bytes],
        participants: Collection[Participant],
    ) -> str | None:
        """Return the instance that owns a publisher.

        Each instance has one publisher per topic, so a second one belongs to another instance.
        """
        taken = {self._publishers[gid] for gid in gids if gid in self._publishers}
        for participant in participants:
            if participant.guid_prefix:
                is_theirs = publisher.gid.hex().startswith(participant.guid_prefix)
            else:
                is_theirs = publisher.node == participant.node
            is_theirs = is_theirs and participant.role in self._owners[topic]
            if is_theirs and participant.instance not in taken:
                return participant.instance
        return None

    @property
    def topics(self) -> set[str]:
        """Topics with a suspect."""
        return {suspect.topic for suspect in self._present}

    @property
    def waits(self) -> list[str]:
        """What the run waits for because of the suspects."""
        return [
            f'{each.node or "a new node"} on {each.topic!r} to join the run or to leave'
            for each in self._present
        ]

    def note_message(self, topic: str, calls: int) -> None:
        """Note a message of a suspect, after some number of roll calls."""
        for suspect in self._present:
            if suspect.topic == topic and suspect.heard_at_call is None:
                suspect.heard_at_call = calls

    def time(self, calls: int, *, are_alone: bool) -> None:
        """Treat a suspect as a stranger if it outlasts the lease while nothing else is wrong."""
        if not (are_alone and self._present):
            self._alone_since_s = None
            return
        if self._alone_since_s is None:
            self._alone_since_s = self._now_s
        for suspect in self._present:
            if self._now_s - max(suspect.since_s, self._alone_since_s) > LEASE_S:
                self.note_message(suspect.topic, calls)

    def problem(self, calls: int, members: Collection[str]) -> str:
        """Return the problem with a stranger, once it can't be a node that is joining, or ''.

        A stranger has preferably none of the names of the members.
        """
        heard = [
            suspect
            for suspect in self._suspects.values()
            if suspect.heard_at_call is not None
            and calls - suspect.heard_at_call >= ANSWER_CALLS
            and self._can_be_named(suspect)
        ]
        return _likeliest(heard, members).problem if heard else ''

    def explanation(self, topic: str, members: Collection[str]) -> str | None:
        """Return who may have sent a foreign message: '' if it has no name yet, None if nobody."""
        found = [
            each for each in self._suspects.values() if self._now_s - each.last_seen_s <= GONE_S
        ]
        if not found:
            return None
        suspect = _likeliest([each for each in found if each.topic == topic] or found, members)
        return suspect.problem if self._can_be_named(suspect) else ''

    def former_problem(self, members: Collection[str]) -> str:
        """Return the problem with a publisher that was or is a suspect in this run, or ''."""
        found = list(self._suspects.values())
        return _likeliest(found, members).problem if found else ''

    def _can_be_named(self, suspect: _Suspect) -> bool:
        return bool(suspect.node) or self._now_s - suspect.since_s > NAME_S


def _likeliest(suspects: Sequence[_Suspect], members: Collection[str]) -> _Suspect:
    """Return the most likely suspect: preferably one with a name, and not a participant's."""
    return min(suspects, key=lambda suspect: (not suspect.node, suspect.node in members))
