"""The participants of a run from the plant's point of view."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from ballbot_ros.lockstep.liveness import LivenessMonitor, ProcessObserver
from ballbot_ros.lockstep.lockstep import RunIdentity
from ballbot_ros.lockstep.participants import (
    Announcement,
    LocalNode,
    Objection,
    Participant,
    Publisher,
)
from ballbot_ros.lockstep.roster import Readiness, ReadinessState, Roster
from ballbot_ros.lockstep.run_actions import Action, CallRoll, Log, PublishStatus, RunSummary
from ballbot_ros.parameters import CONTROLLER, DRIVERS, NODES, RECORDER, ParameterError
from ballbot_ros.parameters.timing import SECOND_NS


class Graph(Protocol):
    """The plant's view of the ROS graph."""

    def is_complete(self) -> bool:
        """Return whether all participants have been discovered; False if that can't be known."""

    def present_nodes(self) -> Mapping[str, LocalNode]:
        """Return the participants on this machine by instance, also undiscovered ones."""

    def publishers(self) -> Mapping[str, Sequence[Publisher]]:
        """Return the publishers on each lockstep topic."""

    def count_publishers(self, topic: str) -> int:
        """Return the number of publishers on a topic."""

    def received(self, topics: Collection[str]) -> Sequence[tuple[str, int]]:
        """Return the messages on these topics since the last call, as topic and stamp [ns].

        The first call for a topic subscribes to it.
        """

    def stop_listening(self) -> None:
        """Stop listening on all topics."""


@dataclass(frozen=True)
class RunTopics:
    """The topics that the master of a run needs to know; the messages of `stamped` have a stamp.

    `is_same_duty` compares the content of two serialised duties with one stamp.
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
    """Calls the roll, evaluates the answers, and decides whether the run may continue.

    `longest_delay` is the longest dead time of all samples [physics steps], at the last check.
    """

    def __init__(
        self,
        graph: Graph,
        process_observer: ProcessObserver,
        host: str,
        topics: RunTopics,
        *,
        is_lockstep: bool,
        act: Callable[[Action], None],
    ) -> None:
        self._graph, self._topics, self._is_lockstep, self._act = graph, topics, is_lockstep, act
        self.roster = Roster(topics.owners)
        self.liveness = LivenessMonitor(self.roster, process_observer, host)
        self._process_observer = process_observer
        self._run: RunIdentity | None = None
        self._plant: Participant | None = None
        self._is_gathering = self._gathers_first_run = True
        self.longest_delay = 0

    def gather(self, run: RunIdentity, plant: Participant, *, requires_recorder: bool) -> None:
        """Start collecting the participants of a run."""
        self._run, self._plant = run, plant
        self._is_gathering = True
        required: list[str] = []
        if self._is_lockstep:
            required += (*DRIVERS, CONTROLLER)
            if requires_recorder:
                required.append(RECORDER)
        self.roster.gather(run.name, plant, required)
        self._act(CallRoll(run, plant))
        self._graph.stop_listening()
        self.liveness.reset()

    def on_announcement(self, announcement: Announcement) -> None:
        """Process a participant's announcement."""
        participant, objection = announcement.participant, announcement.objection
        if participant.role not in NODES:
            text = f'{participant} announces {participant.role!r}, which is not a role'
            self._act(Log(text, is_warning=True, is_throttled=True))
        if objection and objection.topic and not self._is_lockstep:
            # Drop the objection: in free-running mode, a sample may have served to answer two
            # ticks.
            announcement = replace(announcement, objection=None)
        self.roster.on_announcement(announcement)

    def on_unreadable_announcement(self) -> None:
        """Note an announcement that no participant can have sent."""
        self.roster.note_foreign_message(self._topics.participants)

    def on_run(self, name: str, topic: str) -> None:
        """Object to the run of another plant; ignore our own, whose announcement may be late."""
        if self._run and RunIdentity(name, 0).plant != self._run.plant:
            self.roster.add_objection(
                Objection(f'another run, {name!r}, is announced on {topic!r}', topic)
            )

    def readiness(self, now_ns: int, now_s: float) -> Readiness:
        """Check the graph; return whether the run may continue."""
        self.roster.update_publishers(self._graph.publishers(), now_s)
        if self._is_lockstep:
            suspected = self.roster.suspected_topics & self._topics.stamped
            start_ns = self._run.start_ns if self._run else 0
            for topic, stamp_ns in self._graph.received(suspected):
                # Any other stamp is foreign: a message that answers the plant has one of its run.
                if not start_ns <= stamp_ns <= now_ns:
                    self.roster.note_foreign_message(topic)
        if self._is_gathering:
            self._update_local_nodes()
        standing = self.roster.readiness(now_ns)
        try:
            delays = [each.longest_delay() for each in self.roster.members.values()]
        except ParameterError as error:
            return Readiness(ReadinessState.REFUSED, str(error))
        self.longest_delay = max(delays, default=0)
        if standing.state is ReadinessState.COMPLETE:
            self._graph.stop_listening()
        return standing

    def _update_local_nodes(self) -> None:
        """Find the nodes on this machine that must join the run or end before it begins.

        When every role has a participant, a leftover node may still be undiscovered; or else the
        leftover nodes may have every role, while those of this run are still starting.
        """
        present = self._graph.present_nodes() if self._gathers_first_run else {}
        self.roster.update_local_nodes(present, self._process_observer.started_nodes())

    def call_roll(self) -> None:
        """Ask all participants to announce themselves again, because of a silence or a doubt."""
        assert self._run is not None
        assert self._plant is not None
        self._act(CallRoll(self._run, self._plant))
        self.liveness.call()
        self.roster.note_roll_call()

    def confirm(self) -> None:
        """Begin the run with the participants that have joined it, and publish them."""
        self.roster.confirm()
        self.roster.update_local_nodes({}, ())
        self._is_gathering = self._gathers_first_run = False
        self.publish_status()

    def publish_status(self, summary: RunSummary | None = None) -> None:
        """Publish the status of the run; `summary` is None while it is in progress."""
        run = self._run or RunIdentity('', 0)
        topics = tuple(
            name for name in self.roster.periodic_topics if name in self._topics.periodic
        )
        self._act(PublishStatus(run, self._is_lockstep, topics, self.roster.history, summary))

    def restarted_controller(self) -> str:
        """Return which controller restarted in mid-run and when, as text; '' if none did."""
        start_ns = self._run.start_ns if self._run else 0
        for member in self.roster.history:
            if member.is_successor and member.participant.role == CONTROLLER:
                since_s = (member.since_ns - start_ns) / SECOND_NS
                return f'{member.participant} restarted at {since_s:.3f} s of the run'
        return ''

    def controller_since_ns(self) -> int:
        """Return when the current controller joined [ns]; 0 if there is none."""
        since = (
            each.since_ns for each in self.roster.history if each.participant.role == CONTROLLER
        )
        return max(since, default=0)
