"""The participants of a run as its plant sees them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from ballbot_ros.parameters import AGREED, CONTROLLER, DRIVERS, RECORDER
from ballbot_ros.simulation.liveness import LivenessMonitor, Machine
from ballbot_ros.simulation.lockstep import Run
from ballbot_ros.simulation.participants import (
    MAP_HASH,
    Announcement,
    Membership,
    Objection,
    Participant,
    Publisher,
    Roster,
    Standing,
    State,
)
from ballbot_ros.simulation.run_actions import Action, CallRoll, PublishStatus, RunSummary
from ballbot_ros.timing import SECOND_NS


class Graph(Protocol):
    """What the plant can find out about the ROS graph."""

    def publishers(self) -> Mapping[str, Sequence[Publisher]]:
        """Return the publishers on each topic of the lockstep."""

    def count_publishers(self, topic: str) -> int:
        """Return the number of publishers on a topic."""

    def heard(self, topics: Collection[str]) -> Sequence[tuple[str, int]]:
        """Return the messages on these topics since the last call: topic and stamp [ns].

        The first call for a topic starts to listen.
        """

    def stop_listening(self) -> None:
        """Stop listening on all topics."""


@dataclass(frozen=True)
class RunTopics:
    """The names of the topics that the master of a run decides about.

    Attributes
    ----------
    clock, duty, push, ack, participants : str
    owners : mapping of str to collection of str
        The topics of the lockstep, and the roles that publish on each.
    stamped : frozenset of str
        Those of which each message has a stamp.
    periodic : frozenset of str
        Those with a message at each multiple of a period.
    is_same_duty : callable
        Returns whether two serialised duties of one stamp say the same.
    """

    clock: str
    duty: str
    push: str
    ack: str
    participants: str
    owners: Mapping[str, Collection[str]]
    stamped: frozenset[str]
    periodic: frozenset[str]
    is_same_duty: Callable[[bytes, bytes], bool]


class RunParticipants:
    """Calls the roll, takes the answers, and decides whether the run may go on.

    Parameters
    ----------
    graph : Graph
    machine : Machine
    host : str
        The name of this machine.
    topics : RunTopics
    is_lockstep : bool
    act : callable
        Takes the actions that follow.

    Attributes
    ----------
    liveness : LivenessMonitor
    """

    def __init__(
        self,
        graph: Graph,
        machine: Machine,
        host: str,
        topics: RunTopics,
        *,
        is_lockstep: bool,
        act: Callable[[Action], None],
    ) -> None:
        self._graph, self._topics, self._is_lockstep, self._act = graph, topics, is_lockstep, act
        self._roster = Roster(
            shared=(*AGREED, MAP_HASH), stateless=DRIVERS, owners=dict(topics.owners)
        )
        self.liveness = LivenessMonitor(self._roster, machine, host)
        self._run: Run | None = None
        self._plant: Participant | None = None

    def gather(self, run: Run, plant: Participant, *, requires_recorder: bool) -> None:
        """Begin to gather the participants of a run."""
        self._run, self._plant = run, plant
        required = [*DRIVERS, CONTROLLER] if self._is_lockstep else []
        if self._is_lockstep and requires_recorder:
            required.append(RECORDER)
        self._roster.gather(run.name, plant, required)
        self._act(CallRoll(run, plant))
        self._graph.stop_listening()
        self.liveness.begin()

    def on_announcement(self, announcement: Announcement) -> None:
        """Take what a participant says of itself."""
        if not self._is_lockstep:
            # Two ticks may well have answered one sample.
            announcement = replace(announcement, objection=None)
        self._roster.announced(announcement)

    def on_unreadable_announcement(self) -> None:
        """Take note of an announcement that no participant can have sent."""
        self._roster.overheard(self._topics.participants)

    def on_run(self, name: str, topic: str) -> None:
        """Object to a run that another plant announces; ignore our own, of which one may be late.

        Parameters
        ----------
        name : str
            Its name.
        topic : str
            Where it is announced.
        """
        if self._run and Run(name, 0).plant != self._run.plant:
            self.object(Objection(f'another run, {name!r}, is announced on {topic!r}', topic))

    def object(self, objection: Objection) -> None:
        """Take an objection of the plant itself."""
        self._roster.object(objection)

    def standing(self, now_ns: int, now_s: float) -> Standing:
        """Look at the graph; return whether the run may go on.

        Parameters
        ----------
        now_ns : int
            Sim time [ns].
        now_s : float
            Time on a clock that only goes forward [s].
        """
        self._roster.looked(self._graph.publishers(), now_s)
        if self._is_lockstep:
            suspected = self._roster.suspected_topics & self._topics.stamped
            start_ns = self._run.start_ns if self._run else 0
            for topic, stamp_ns in self._graph.heard(suspected):
                # An answer to the plant has a stamp of its run.
                if not start_ns <= stamp_ns <= now_ns:
                    self._roster.overheard(topic)
        standing = self._roster.standing(now_ns)
        if standing.state is State.COMPLETE:
            self._graph.stop_listening()
        return standing

    def call_roll(self) -> None:
        """Have every participant announce itself again, because of a silence or a doubt."""
        assert self._run is not None
        assert self._plant is not None
        self._act(CallRoll(self._run, self._plant))
        self.liveness.call()
        self._roster.called()

    def fix(self) -> None:
        """Let the run begin with those who have joined it, and publish who they are."""
        self._roster.fix()
        self.publish_status()

    def publish_status(self, summary: RunSummary | None = None) -> None:
        """Publish the account of the run; `summary` is None while it goes on."""
        run = self._run or Run('', 0)
        topics = tuple(
            name for name in self._roster.periodic_topics if name in self._topics.periodic
        )
        self._act(PublishStatus(run, self._is_lockstep, topics, self.members, summary))

    @property
    def members(self) -> tuple[Membership, ...]:
        """Everybody who has taken part in the run, in the order of joining it."""
        return self._roster.history

    def member(self, role: str) -> Participant | None:
        """Return who has a role in this run."""
        return self._roster.members.get(role)

    def missing(self) -> list[str]:
        """Return the roles that nobody has taken yet."""
        return self._roster.missing()

    def last_words(self, role: str) -> str:
        """Return why the participant of a role can't go on, or ''."""
        return self._roster.last_words(role)

    def restarted_controller(self) -> str:
        """Return since when a controller has driven that began afresh in mid-run, or ''."""
        start_ns = self._run.start_ns if self._run else 0
        for member in self.members:
            if member.is_successor and member.participant.role == CONTROLLER:
                since_s = (member.since_ns - start_ns) / SECOND_NS
                return f'{member.participant} began afresh at {since_s:.3f} s of the run'
        return ''

    def controller_since_ns(self) -> int:
        """Return since when the present controller has driven [ns]; 0 if there is none."""
        since = (each.since_ns for each in self.members if each.participant.role == CONTROLLER)
        return max(since, default=0)
