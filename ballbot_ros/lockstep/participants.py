"""A participant of a run, its announcements and its objections."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, cast

from ballbot_ros.errors import one_line
from ballbot_ros.files import OUR_PACKAGE
from ballbot_ros.lockstep.lockstep import RunIdentity
from ballbot_ros.parameters import parameters_of
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
    parameters: Mapping[str, object] = field(default_factory=dict)

    @property
    def is_foreign(self) -> bool:
        """Whether it is a node of another package."""
        return self.implementation.split()[:1] != [OUR_PACKAGE]

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
