"""The plant's view of who takes part in its run: hands the roster what it needs, and asks it."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

from ballbot_ros.messages.conversions import fill_header
from ballbot_ros.messages.participation import (
    RunStatus,
    decode_announcement,
    encode_announcement,
    encode_run_status,
    membership_json,
    membership_text,
)
from ballbot_ros.messages.raw import has_stamp
from ballbot_ros.messages.topics import (
    HISTORY,
    LOCKSTEP,
    PARTICIPANTS,
    ROLL_CALL,
    RUN,
    RUN_STATUS,
    Topic,
)
from ballbot_ros.nodes.base import BallbotNode
from ballbot_ros.nodes.graph_look import GraphLook
from ballbot_ros.nodes.participation import participant_of, with_values
from ballbot_ros.parameters import AGREED, CONTROLLER, ENCODER, GAMEPAD, GYRO, RECORDER, SONAR
from ballbot_ros.processes import END_WITH_PARENT, children, threads_by_process
from ballbot_ros.simulation.lockstep import Run
from ballbot_ros.simulation.participants import (
    MAP_HASH,
    Announcement,
    Objection,
    Participant,
    Roster,
    Standing,
    State,
)
from ballbot_ros.simulation.silence_timer import SilenceTimer
from ballbot_ros.simulation.timing import SECOND_NS, SLOW_NS

_DRIVERS = (GYRO, ENCODER, SONAR, GAMEPAD)
_SLOW = (SONAR, GAMEPAD)
_PERIODIC = {topic.name for topic in LOCKSTEP if topic.period_ns}
_STAMPED = {topic.name for topic in LOCKSTEP if has_stamp(topic.type_name)}


class PlantParticipants:
    """Calls the roll, listens to the answers, and looks at the graph.

    Parameters
    ----------
    node : BallbotNode
        The plant.
    on_news : callable
        Called when an announcement or an objection has come.
    """

    def __init__(self, node: BallbotNode, on_news: Callable[[], None]) -> None:
        self._node = node
        self._on_news = on_news
        self._own = participant_of(node)
        self._lockstep: bool = node.values['lockstep']
        self._roster = Roster(
            shared=(*AGREED, MAP_HASH),
            stateless=_DRIVERS,
            owners={topic.name: roles for topic, roles in LOCKSTEP.items()},
        )
        self._look = GraphLook(node, tuple(LOCKSTEP))
        self._announcement = node.output(PARTICIPANTS)
        self._status = node.output(RUN_STATUS)
        self._roll_call = node.output(ROLL_CALL)
        self._run = ''
        self._start_ns = 0
        self._silent_since: int | None = None
        self._called_s = 0.0
        self._starting: list[int] = []
        self._timer = SilenceTimer()
        self._watch_over(RUN)
        self._watch_over(ROLL_CALL)
        node.listen(PARTICIPANTS, self._on_announcement, depth=HISTORY, raw=True)

    def gather(self, run: str, start_ns: int) -> None:
        """Begin to gather the participants of a run."""
        self._run, self._start_ns = run, start_ns
        self._own = with_values(self._own, self._node.values)
        required = [*_DRIVERS, CONTROLLER] if self._lockstep else []
        if self._lockstep and self._node.values['require_recorder']:
            required.append(RECORDER)
        self._roster.gather(run, self._own, required)
        # A command starts the nodes together; of others nothing is known before they are heard.
        self._starting = children(os.getppid()) if END_WITH_PARENT in os.environ else []
        self._send_roll_call()
        self._look.stop_listening()
        self.end_silence()

    def _watch_over(self, topic: Topic) -> None:
        """Object to a run that somebody else announces."""

        def receive(header: Any) -> None:
            # Of its own runs an earlier one may still be under way.
            if self._run and Run(header.frame_id, 0).plant != Run(self._run, 0).plant:
                problem = f'another run, {header.frame_id!r}, is announced on {topic.name!r}'
                self.object(Objection(problem, topic.name))

        self._node.listen(topic, receive, depth=HISTORY)

    def _on_announcement(self, data: bytes) -> None:
        try:
            announcement = decode_announcement(data)
        except ValueError as error:
            self._node.get_logger().warning(f'{error}; it is ignored')
            self._roster.overheard(PARTICIPANTS.name)
            return
        if not self._lockstep:
            # Two ticks may well have answered one sample.
            announcement = replace(announcement, objection=None)
        self._roster.announced(announcement)
        self._on_news()

    def object(self, objection: Objection) -> None:
        """Take what the plant itself objects to."""
        self._roster.object(objection)
        self._on_news()

    def standing(self, now_ns: int) -> Standing:
        """Look at the graph, and tell whether the run may go on at sim time `now_ns` [ns]."""
        self._roster.looked(self._look.publishers(), time.monotonic())
        if self._lockstep:
            suspected = self._roster.suspected_topics & _STAMPED
            for topic, stamp_ns in self._look.heard(suspected):
                # With another stamp nobody answers the plant.
                if not self._start_ns <= stamp_ns <= now_ns:
                    self._roster.overheard(topic)
        standing = self._roster.standing(now_ns)
        if standing.state is State.COMPLETE:
            self._look.stop_listening()
        return standing

    def _send_roll_call(self) -> None:
        """Call the roll, and answer it as everybody does."""
        fill_header(self._roll_call.message, self._start_ns, self._run)
        self._roll_call.send(self._start_ns)
        self._announcement.publish(encode_announcement(Announcement(self._own, self._run)))

    def call_roll(self) -> None:
        """Have every participant announce itself again."""
        self._send_roll_call()
        if self._silent_since is None:
            self._silent_since = self._roster.calls
            self._called_s = time.monotonic()
            self._look_at_silence(self._called_s, self._processes())
        self._roster.called()

    def fix(self) -> None:
        """Let the run begin with those who are there, and tell who they are."""
        self._roster.fix()
        self.tell({})

    def tell(self, result: Mapping[str, Any]) -> None:
        """Publish the account of the run; `result` is empty while it goes on."""
        self._status.publish(
            encode_run_status(
                RunStatus(
                    run=self._run,
                    is_lockstep=self._lockstep,
                    periodic_topics=tuple(
                        name for name in self._roster.periodic_topics if name in _PERIODIC
                    ),
                    participants={
                        member.participant.role: membership_text(member, self._start_ns)
                        for member in self._roster.history
                    },
                    result={key: str(value) for key, value in result.items()},
                )
            )
        )

    def as_json(self) -> list[dict[str, Any]]:
        """Return everybody who has taken part in the run."""
        return [membership_json(member, self._start_ns) for member in self._roster.history]

    def restarted_controller(self) -> str:
        """Return since when another controller has driven, which began afresh, or nothing."""
        for member in self._roster.history:
            if member.is_successor and member.participant.role == CONTROLLER:
                since_s = (member.since_ns - self._start_ns) / SECOND_NS
                return f'{member.participant} began afresh at {since_s:.3f} s of the run'
        return ''

    def controller_since_ns(self) -> int:
        """Return since when the present controller has driven [ns]; 0 if there is none."""
        history = self._roster.history
        since = (each.since_ns for each in history if each.participant.role == CONTROLLER)
        return max(since, default=0)

    def member(self, role: str) -> Participant | None:
        """Return who has a role in this run."""
        return self._roster.members.get(role)

    def missing(self) -> list[str]:
        """Return the roles that nobody has taken yet."""
        return self._roster.missing()

    def last_words(self, role: str) -> str:
        """Return why the participant of a role can't go on, or nothing."""
        return self._roster.last_words(role)

    def end_silence(self) -> None:
        """Forget which roll calls were made because of a silence."""
        self._silent_since = None

    def silences_s(self, since_s: float, now_ns: int, *, recorder: bool) -> dict[str, float]:
        """Return who has not answered the roll calls of a silence, or lacks the tick.

        A silence counts from the first of these calls on; before it nobody is silent.

        Parameters
        ----------
        since_s : float
            When the silence began [s].
        now_ns : int
            The tick that is not answered [ns].
        recorder : bool
            Whether it is the recorder's answer that is waited for, not the controller's. It is
            that one's fault where all others have done their part.

        Returns
        -------
        dict of str to float
            The roles, and how much of the silence counts for each [s].
        """
        if self._silent_since is None:
            return {}
        due = {role: now_ns for role in _DRIVERS if role not in _SLOW or now_ns % SLOW_NS == 0}
        due |= {role: 0 for role in _DRIVERS if role not in due} | {CONTROLLER: 0}
        last = RECORDER if recorder else CONTROLLER
        if recorder:
            due[RECORDER] = 0
        self._look_at_silence(max(since_s, self._called_s), self._processes())
        found = self._roster.silences_s(self._silent_since, due, self._silence_s)
        return found or {last: self._silence_s(self._roster.members.get(last))}

    def waited_s(self, since_s: float) -> float:
        """Return for how long those have been waited for who are to take part [s]."""
        joined = set(map(self._process, self._roster.members.values()))
        starting = [process for process in self._starting if process not in joined]
        self._look_at_silence(since_s, starting)
        return min(map(self._timer.silence_s, starting), default=self._timer.silence_s())

    def _look_at_silence(self, since_s: float, processes: Iterable[int]) -> None:
        self._timer.update(since_s, time.monotonic(), threads_by_process(processes))

    def _processes(self) -> list[int]:
        """Return the processes of this machine that take part."""
        processes = map(self._process, self._roster.members.values())
        return [process for process in processes if process is not None]

    def _process(self, participant: Participant | None) -> int | None:
        """Return the process of a participant on this machine."""
        is_here = participant is not None and participant.host == self._own.host
        return participant.process if participant and is_here else None

    def _silence_s(self, participant: Participant | None) -> float:
        return self._timer.silence_s(self._process(participant))
