"""Who takes part in a run of the lockstep, and who does not belong to it.

Nothing here knows of ROS: the plant's node hands in announcements, the publishers that the graph
has and the roll calls it has made, and does what the :class:`Standing` says.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import NamedTuple

from ballbot_ros.timing import SECOND_NS

ANSWER_CALLS = 5
"""Roll calls that a living participant answers; who answers none of them is gone."""

GONE_S = 2.0
"""Time for which a publisher that has left may still be to blame for what is objected to."""

LOOK_S = 0.5
"""The most that counts between two looks: who could not look does not know who has left."""

NAME_S = 5.0
"""Time within which the middleware tells the name of a publisher's node, if it ever does."""

LEASE_S = 21.0
"""A process that was killed stays in the graph for 20 s, the middleware's lease of a participant.
A publisher that is there for longer was alive while the run waited for it to leave."""


MAP_HASH = 'map_sha256'
"""Among a participant's parameters, what stands for a map beside its name: the same file may have
another path elsewhere."""


@dataclass(frozen=True)
class Participant:
    """A node that takes part in runs.

    Attributes
    ----------
    role : str
        What it does in the graph: the node of the parameter table whose place it takes.
    node : str
        Fully qualified name, such as ``/gyro_driver``.
    host : str
    process : int
        Process id on that host.
    instance : str
        Tells two nodes apart that have all else in common.
    implementation : str
        Program and version.
    parameters_sha256 : str
        Hash of its parameters' values.
    guid_prefix : str
        What the identifiers of its publishers begin with, as hexadecimal text; '' if it does not
        know: its publishers are then told by the name of their node.
    topics : tuple of str
        The periodic topics that it publishes, a message at each multiple of their period.
    parameters : mapping of str to object
        Its parameters' values in this run, as far as it tells them.
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
    parameters: Mapping[str, object] = field(default_factory=dict)

    def __str__(self) -> str:
        return f'{self.node} (process {self.process} on {self.host})'


@dataclass(frozen=True)
class Objection:
    """A participant has seen what can't be of this run.

    Attributes
    ----------
    text : str
    topic : str
        Where it came; '' if it is the participant itself that can't go on.
    stamp_ns : int
        Stamp of the sample [ns].
    """

    text: str
    topic: str = ''
    stamp_ns: int = 0

    @classmethod
    def to_sample(cls, topic: str, stamp_ns: int, kind: str = 'sample') -> Objection:
        """Return the objection to a sample that no participant can have sent."""
        text = (
            f'{topic!r} has a second {kind} of {stamp_ns / SECOND_NS:.3f} s, or one ahead of the '
            'run'
        )
        return cls(text, topic, stamp_ns)


@dataclass(frozen=True)
class Announcement:
    """What a participant says of itself when it joins a run, and at each roll call.

    Attributes
    ----------
    participant : Participant
    run : str
        The run that it takes part in, by the name that ``plant/run`` gives it.
    answered_ns : int
        Stamp of its newest sample in this run [ns], 0 before the first.
    objection : Objection or None
    """

    participant: Participant
    run: str
    answered_ns: int = 0
    objection: Objection | None = None


class Publisher(NamedTuple):
    """A publisher of a topic as the graph tells it; `node` is '' while its name is not known."""

    gid: bytes
    node: str


class State(Enum):
    """Whether the run may go on."""

    COMPLETE = auto()
    WAITING = auto()
    REFUSED = auto()


@dataclass(frozen=True)
class Standing:
    """What the roster says of a run, and why it waits or is refused."""

    state: State
    reason: str = ''


_COMPLETE = Standing(State.COMPLETE)


class Membership(NamedTuple):
    """A participant of a run.

    Attributes
    ----------
    participant : Participant
    since_ns : int
        Sim time from which on it took part [ns].
    is_successor : bool
        Whether it took the place of one that was gone.
    """

    participant: Participant
    since_ns: int
    is_successor: bool = False


@dataclass
class _Heard:
    """An announcement, and how many roll calls had been made when it came."""

    announcement: Announcement
    calls: int


@dataclass
class _Suspect:
    """A publisher on a topic of the lockstep that belongs to no participant."""

    topic: str
    node: str
    since_s: float
    last_seen_s: float
    heard_at_call: int | None = None

    @property
    def offence(self) -> str:
        name = self.node or 'an unnamed node'
        return f'{name} publishes on {self.topic!r}, but takes no part in the run'


@dataclass
class _Run:
    """What is known of one run."""

    name: str
    heard: dict[str, _Heard] = field(default_factory=dict)
    contests: dict[str, int] = field(default_factory=dict)
    members: dict[str, Participant] = field(default_factory=dict)
    history: list[Membership] = field(default_factory=list)
    suspects: dict[bytes, _Suspect] = field(default_factory=dict)
    strangers: dict[bytes, _Suspect] = field(default_factory=dict)
    objections: list[tuple[int, Objection]] = field(default_factory=list)
    waits_only_for_suspects_since_s: float | None = None
    offence: str = ''
    has_begun: bool = False


class Roster:
    """Decides whether those who belong to a run, and nobody else, take part in it.

    A role has one participant. If a second one announces itself, roll calls tell which of the two
    live: both, and the run is refused; only the second, and it is the successor. A publisher on
    a topic of the lockstep whose node has not announced itself is a stranger as soon as a sample
    of it is heard, or when it is still there after the lease of a dead process.

    Parameters
    ----------
    shared : collection of str
        The parameters of which all that have them are to have the same value.
    stateless : collection of str
        The roles whose participant may be replaced in mid-run by one that is equal to it; any
        other one begins afresh.
    owners : mapping of str to collection of str
        The topics of the lockstep, and the roles that publish on each.
    """

    def __init__(
        self,
        *,
        shared: Collection[str],
        stateless: Collection[str],
        owners: Mapping[str, Collection[str]],
    ) -> None:
        self._plant: Participant | None = None
        self._required: tuple[str, ...] = ()
        self._shared = tuple(shared)
        self._stateless = frozenset(stateless)
        self._owners = owners
        self._publishers: dict[bytes, str] = {}
        self._first_seen_s: dict[bytes, float] = {}
        self._looked_at_s: float | None = None
        self._now_s = 0.0
        self._calls = 0
        self._run = _Run('')

    def gather(self, run: str, plant: Participant, required: Collection[str]) -> None:
        """Begin to gather the participants of a run.

        Parameters
        ----------
        run : str
            Its name.
        plant : Participant
            The plant, whose run it is.
        required : collection of str
            The roles without which it does not begin.
        """
        self._plant, self._required = plant, tuple(required)
        self._run = _Run(run)
        self._run.heard[plant.instance] = _Heard(Announcement(plant, run), self._calls)

    def fix(self) -> None:
        """Let the run begin with those who are there; from now on each of them has to stay."""
        self._run.has_begun = True

    def called(self) -> None:
        """Note a roll call, which the plant answers, too."""
        self._calls += 1
        if self._plant:
            self._run.heard[self._plant.instance].calls = self._calls

    def announced(self, announcement: Announcement) -> None:
        """Take an announcement; one for another run changes nothing."""
        run = self._run
        participant = announcement.participant
        if announcement.run != run.name or participant == self._plant:
            return
        if not any(participant.role in roles for roles in self._owners.values()):
            return
        known = run.heard.get(participant.instance)
        if known and known.announcement.participant != participant:
            run.offence = f'{participant} gives itself out as {known.announcement.participant}'
            return
        run.heard[participant.instance] = _Heard(announcement, self._calls)
        objection = announcement.objection
        # The run goes on without a participant that it does not require.
        if objection and (objection.topic or participant.role in self._required):
            self.object(objection)
        if len(self._claimants(participant.role)) > 1:
            run.contests.setdefault(participant.role, self._calls)

    def object(self, objection: Objection) -> None:
        """Take what a participant, or the plant itself, objects to."""
        if all(objection != known for _, known in self._run.objections):
            self._run.objections.append((self._calls, objection))

    def looked(self, publishers: Mapping[str, Sequence[Publisher]], now_s: float) -> None:
        """Take the publishers that the graph has on the topics of the lockstep.

        Parameters
        ----------
        publishers : mapping of str to sequence of Publisher
            By topic.
        now_s : float
            Time of this look on a clock that only goes forward [s].
        """
        run = self._run
        if self._looked_at_s is not None:
            self._now_s += min(now_s - self._looked_at_s, LOOK_S)
        self._looked_at_s = now_s
        there = set()
        for topic, found in publishers.items():
            gids = {publisher.gid for publisher in found}
            there |= gids
            for publisher in found:
                if publisher.gid in self._publishers:
                    continue
                if owner := self._owner(topic, publisher, gids):
                    self._publishers[publisher.gid] = owner
                    run.strangers.pop(publisher.gid, None)
                    continue
                now = self._now_s
                since_s = self._first_seen_s.setdefault(publisher.gid, now)
                suspect = run.strangers.setdefault(publisher.gid, _Suspect(topic, '', since_s, now))
                suspect.node = publisher.node or suspect.node
                suspect.last_seen_s = now
        run.suspects = {gid: each for gid, each in run.strangers.items() if gid in there}

    def _owner(self, topic: str, publisher: Publisher, gids: Collection[bytes]) -> str | None:
        """Return the instance whose publisher it is.

        Each instance has one publisher a topic, so a second one belongs to another.
        """
        taken = {self._publishers[gid] for gid in gids if gid in self._publishers}
        for instance, heard in self._run.heard.items():
            participant = heard.announcement.participant
            if participant.guid_prefix:
                is_theirs = publisher.gid.hex().startswith(participant.guid_prefix)
            else:
                is_theirs = publisher.node == participant.node
            is_theirs = is_theirs and participant.role in self._owners[topic]
            if is_theirs and instance not in taken:
                return instance
        return None

    @property
    def suspected_topics(self) -> set[str]:
        """Topics that have a publisher of nobody in the run."""
        return {suspect.topic for suspect in self._run.suspects.values()}

    def overheard(self, topic: str) -> None:
        """Take note that a message came on a suspected topic that no participant can have sent."""
        for suspect in self._run.suspects.values():
            if suspect.topic == topic and suspect.heard_at_call is None:
                suspect.heard_at_call = self._calls

    def standing(self, now_ns: int) -> Standing:
        """Tell whether the run may go on.

        Parameters
        ----------
        now_ns : int
            Sim time [ns]: a successor takes part from there on.
        """
        run = self._run
        problem = run.offence or self._sentence() or self._settle_contests() or self._admit(now_ns)
        if not (problem or run.contests):
            problem = self._judge_objections() or self._disagreement()
        if problem:
            return Standing(State.REFUSED, problem)
        waits = [*self.missing(), *(f'one answer as {role}' for role in run.contests)]
        waits += [f'a roll call because of {objection.text}' for _, objection in run.objections]
        self._time_suspects(are_alone=not waits)
        waits += [
            f'{each.node or "a new node"} on {each.topic!r} to take part or to leave'
            for each in run.suspects.values()
        ]
        return Standing(State.WAITING, f'waiting for {", ".join(waits)}') if waits else _COMPLETE

    def _time_suspects(self, *, are_alone: bool) -> None:
        """Accuse a suspect that stays for longer than a dead process while all else is well."""
        run = self._run
        if not (are_alone and run.suspects):
            run.waits_only_for_suspects_since_s = None
            return
        if run.waits_only_for_suspects_since_s is None:
            run.waits_only_for_suspects_since_s = self._now_s
        for suspect in run.suspects.values():
            since_s = max(suspect.since_s, run.waits_only_for_suspects_since_s)
            if self._now_s - since_s > LEASE_S:
                self.overheard(suspect.topic)

    def _sentence(self) -> str:
        """Return what a stranger has done that was heard, once it can be told from a newcomer."""
        heard = [
            suspect
            for suspect in self._run.strangers.values()
            if suspect.heard_at_call is not None
            and self._calls - suspect.heard_at_call >= ANSWER_CALLS
            and self._can_be_named(suspect)
        ]
        return self._likeliest(heard).offence if heard else ''

    def _likeliest(self, suspects: Sequence[_Suspect]) -> _Suspect:
        """Return the one to name of several suspects: not a participant's namesake if possible."""
        names = {participant.node for participant in self._run.members.values()}
        return min(suspects, key=lambda suspect: (not suspect.node, suspect.node in names))

    def _can_be_named(self, suspect: _Suspect) -> bool:
        return bool(suspect.node) or self._now_s - suspect.since_s > NAME_S

    def _claimants(self, role: str) -> list[_Heard]:
        heard = self._run.heard.values()
        return [each for each in heard if each.announcement.participant.role == role]

    def _settle_contests(self) -> str:
        """Find out who of several claimants of a role live; return what is wrong, or nothing."""
        run = self._run
        doubled: dict[str, list[Participant]] = {}
        for role, since in tuple(run.contests.items()):
            claimants = self._claimants(role)
            living = [each.announcement.participant for each in claimants if each.calls > since]
            if len(living) > 1:
                doubled[role] = living
            elif self._calls - since >= ANSWER_CALLS:
                # If none is left, the silence that follows is the last participant's.
                for each in claimants:
                    if each.announcement.participant not in living:
                        del run.heard[each.announcement.participant.instance]
                del run.contests[role]
        if not doubled:
            return ''
        role, *others = doubled
        topic = next(topic for topic, roles in self._owners.items() if role in roles)
        both = ' and '.join(map(str, doubled[role][:2]))
        likewise = f'; likewise as {", ".join(others)}' if others else ''
        return f'two nodes publish on {topic!r} as {role}: {both}{likewise}'

    def _admit(self, now_ns: int) -> str:
        """Give each role its participant; return what is wrong with a successor, or nothing."""
        run = self._run
        for instance, heard in run.heard.items():
            participant = heard.announcement.participant
            role, known = participant.role, run.members.get(participant.role)
            if role in run.contests or (known and known.instance == instance):
                continue
            if known and not run.has_begun:
                run.history = [each for each in run.history if each.participant != known]
            elif known and role in self._stateless and not _are_equal(known, participant):
                return (
                    f'{participant} takes the place of {known} with another program or other '
                    'parameters'
                )
            is_successor = known is not None and run.has_begun
            run.members[role] = participant
            run.history.append(Membership(participant, now_ns, is_successor))
        return ''

    def _judge_objections(self) -> str:
        """Return what the oldest objection comes to once the roll has been called upon it."""
        run = self._run
        run.objections = [each for each in run.objections if not self._is_of_a_handover(each[1])]
        for calls, objection in run.objections:
            if not objection.topic:
                return objection.text
            if self._calls - calls < ANSWER_CALLS:
                continue
            strangers = [
                each for each in run.strangers.values() if self._now_s - each.last_seen_s <= GONE_S
            ]
            on_this_topic = [each for each in strangers if each.topic == objection.topic]
            if not strangers:
                return self._unexplained(objection)
            suspect = self._likeliest(on_this_topic or strangers)
            if self._can_be_named(suspect):
                return suspect.offence
        return ''

    def _disagreement(self) -> str:
        """Return which two participants have different values of one parameter, or nothing."""
        for name in self._shared:
            tellers = [each for each in self._run.members.values() if name in each.parameters]
            tellers.sort(key=lambda each: each.node)
            for other in tellers[1:]:
                values = tellers[0].parameters[name], other.parameters[name]
                if values[0] != values[1]:
                    return (
                        f'{name} is {values[0]!r} in {tellers[0].node}, '
                        f'but {values[1]!r} in {other.node}'
                    )
        return ''

    def _unexplained(self, objection: Objection) -> str:
        """Return the text of an objection that no publisher in the graph explains."""
        roles = self._owners.get(objection.topic, ())
        senders = [str(self._run.members[role]) for role in roles if role in self._run.members]
        sent_by = f', sent by {senders[0]} or by a node that has left' if senders else ''
        return objection.text + sent_by

    def _is_of_a_handover(self, objection: Objection) -> bool:
        """Tell whether two participants of one role answered a tick before it changed hands.

        What a gamepad says depends on when it is asked; its first answer counts.
        """
        roles = self._owners.get(objection.topic, ())
        return any(
            each.is_successor
            and each.participant.role in roles
            and objection.stamp_ns <= each.since_ns
            for each in self._run.history
        )

    def last_words(self, role: str) -> str:
        """Return why the participant of a role can't go on, or nothing."""
        member = self._run.members.get(role)
        heard = self._run.heard.get(member.instance) if member else None
        objection = heard.announcement.objection if heard else None
        return objection.text if objection and not objection.topic else ''

    def missing(self) -> list[str]:
        """Return the required roles that have no participant in this run."""
        return [role for role in self._required if role not in self._run.members]

    def silences_s(
        self,
        since_call: int,
        due_ns: Mapping[str, int],
        silence_s: Callable[[Participant | None], float],
    ) -> dict[str, float]:
        """Return the roles whose participant does not answer, and for how long that is so [s].

        Parameters
        ----------
        since_call : int
            Number of the last roll call before the silence.
        due_ns : mapping of str to int
            The roles whose answer is waited for, in the order in which one depends on the other,
            and the stamp that is due [ns].
        silence_s : callable
            How much of the silence counts for a participant.

        Returns
        -------
        dict of str to float
            Those that answered no roll call since, each for itself; if all did, those whose
            newest sample is older than what is due, since one of them may wait for another.
        """
        run = self._run
        found = {}
        for role in due_ns:
            member = run.members.get(role)
            found[role] = run.heard.get(member.instance) if member else None
        silences_s = {role: silence_s(run.members.get(role)) for role in found}
        unheard = [role for role, heard in found.items() if not heard or heard.calls <= since_call]
        if unheard:
            return {role: silences_s[role] for role in unheard}
        lacking = [
            role
            for role, heard in found.items()
            if heard and heard.announcement.answered_ns < due_ns[role]
        ]
        return dict.fromkeys(lacking, min(silences_s[role] for role in lacking)) if lacking else {}

    @property
    def calls(self) -> int:
        """Number of roll calls so far."""
        return self._calls

    @property
    def members(self) -> Mapping[str, Participant]:
        """Who has which role at present."""
        return self._run.members

    @property
    def history(self) -> tuple[Membership, ...]:
        """Everybody who has taken part in this run, in the order of joining it."""
        return tuple(self._run.history)

    @property
    def periodic_topics(self) -> tuple[str, ...]:
        """Topics of which this run has a message at each multiple of their period."""
        return tuple(
            topic for participant in self._run.members.values() for topic in participant.topics
        )


def _are_equal(one: Participant, other: Participant) -> bool:
    return (one.implementation, one.parameters_sha256) == (
        other.implementation,
        other.parameters_sha256,
    )
