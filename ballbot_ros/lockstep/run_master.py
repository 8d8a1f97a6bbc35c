"""The master of a run: gathers its participants, moves the plant, and ends the run.

Free of ROS and of clocks: the plant's node passes in timed events and carries out the actions that
each of them returns.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from array import array
from collections.abc import Callable, Mapping
from enum import Enum, auto
from functools import wraps
from typing import Concatenate, ParamSpec, TypeVar

from ballbot_ros.engine.pacer import Pacer, PauseControl
from ballbot_ros.engine.trajectory import TrajectoryLog
from ballbot_ros.lockstep import run_actions as do
from ballbot_ros.lockstep.liveness import ProcessObserver
from ballbot_ros.lockstep.lockstep import RunIdentity
from ballbot_ros.lockstep.participants import Announcement
from ballbot_ros.lockstep.roster import Readiness, ReadinessState
from ballbot_ros.lockstep.run_actions import (
    Action,
    Actions,
    Outcome,
    ParameterChange,
    RunSetup,
    RunSummary,
)
from ballbot_ros.lockstep.run_participants import Graph, RunParticipants, RunTopics
from ballbot_ros.parameters import CONTROLLER, PLANT, PlantParameters, Value, parameters_of
from ballbot_ros.parameters.changes import scheduled_at
from ballbot_ros.parameters.timing import FIRST_TICK_NS, SECOND_NS, TICK_NS, next_start_ns
from ballbot_ros.robot.brick.brick import MotorDuty
from ballbot_ros.robot.brick.fault_effects import change_faults
from ballbot_ros.robot.brick.faults import new_faults
from ballbot_ros.robot.plant.ground_truth import Pair, Push

DISCOVERY_S = 1.0
"""Time limit for discovering all participants before the first run: among them may be another
plant, whose run a second clock would disturb, and other nodes that publish on the run's topics."""

DISCOVERY_POLL_S = 0.02

STARTUP_WARN_S = 5.0
STILL_S = 1.0
"""Interval at which a halted plant repeats its truth, for late subscribers."""

MAX_PUSHES = 100
"""Limit on external pushes that are active or pending: each costs time in every step."""

_OF_PACE = frozenset(name for name, row in parameters_of(PLANT).items() if row.is_live)
"""Parameters of the plant that act at once: they change no duty by themselves."""


class Phase(Enum):
    """Phase of a run."""

    DISCOVERING = auto()
    """No run has been announced yet."""
    GATHERING = auto()
    """The run waits for its participants."""
    TICKING = auto()
    DRAINING = auto()
    """All ticks are done, but not everybody has confirmed the last one."""
    ENDED = auto()


P = ParamSpec('P')
M = TypeVar('M', bound='RunMaster')
"""Class of the master of a run."""


def event(method: Callable[Concatenate[M, P], None]) -> Callable[Concatenate[M, float, P], Actions]:
    """Turn a method of a master into an event handler.

    The handler takes the time on a monotonic clock [s] as its first argument, and returns the
    actions that the event leads to.
    """

    @wraps(method)
    def handle(self: M, now_s: float, /, *args: P.args, **kwargs: P.kwargs) -> Actions:
        self._now_s = now_s
        method(self, *args, **kwargs)
        actions, self._actions = self._actions, []
        return actions

    return handle


class RunMaster(ABC):
    """Conducts one run after another.

    Parameters
    ----------
    set_up : callable
        Returns the :class:`RunSetup` of a run for the stamp of its first tick [ns].

    Attributes
    ----------
    log : TrajectoryLog
        Trajectory and duties of the current run so far.
    resends : int
        Number of times that an unanswered tick was sent again in lockstep, in all runs. Repeated
        truths of a halted plant, or of a free-running one before its first duty, do not count.
    """

    is_lockstep: bool
    _parameters: PlantParameters

    def __init__(
        self,
        graph: Graph,
        process_observer: ProcessObserver,
        topics: RunTopics,
        set_up: Callable[[int], RunSetup],
        token: str,
        now_s: float,
    ) -> None:
        self._graph, self._topics, self._set_up, self._token = graph, topics, set_up, token
        self._actions: Actions = []
        self.resends = 0
        self.summary: RunSummary | None = None
        self._pacer = Pacer()
        self._created_s = self._now_s = now_s
        self._number = 0
        self._first_values: Mapping[tuple[str, str], Value] = {}
        self._is_warned = self._is_wake_pending = False
        self._prepare(FIRST_TICK_NS)
        starts_paused, is_live = self._parameters.start_paused, not self._parameters.live_from
        self.pause = PauseControl(starts_paused=starts_paused and is_live)
        self._pauses_when_live = starts_paused and not is_live
        self._participants = RunParticipants(
            graph,
            process_observer,
            self._setup.participant.host,
            topics,
            is_lockstep=self.is_lockstep,
            act=self._act,
        )

    def _act(self, action: Action) -> None:
        self._actions.append(action)

    # Events

    @event
    def on_time(self) -> None:
        """Supervise the run; call every 100 ms."""
        if self._phase is Phase.ENDED:
            return
        if self._phase is Phase.DISCOVERING:
            self._discover()
        elif (
            self._is_only_plant()
            and self._check_participants(calls_roll=True)
            and not self._is_ended
        ):
            self._watch()

    @event
    def on_wake(self) -> None:
        """Continue: the next tick, or the next look at the graph, is due."""
        self._is_wake_pending = False
        if self._phase is Phase.DISCOVERING:
            self._discover()
        else:
            self._advance()

    @event
    def on_announcement(self, announcement: Announcement) -> None:
        """Process a participant's announcement."""
        role, members = announcement.participant.role, self._participants.roster.members
        before = members.get(role)
        self._participants.on_announcement(announcement)
        if before and (after := members.get(role)):
            self._note_faults(*(str(each.parameters.get('faults', '')) for each in (before, after)))
        self._on_news()

    def _note_faults(self, before: str, after: str) -> None:
        self._changes += map(ParameterChange.of_fault, new_faults(before, after))

    @event
    def on_unreadable_announcement(self) -> None:
        """Note an announcement that no participant can have sent."""
        self._participants.on_unreadable_announcement()

    @event
    def on_run(self, name: str, topic: str) -> None:
        """Note a run announced on a topic; it may belong to another plant."""
        self._participants.on_run(name, topic)
        self._on_news()

    @event
    def on_duty(
        self, stamp_ns: int, duty: MotorDuty | None, data: bytes, *, is_stop: bool = False
    ) -> None:
        """Process a duty of motors B and C [%]; None if the message has no valid duty.

        A message that is a stop answers no tick, but says that the motors are off.
        """
        if not self._is_open:
            return
        if stamp_ns < self._run.start_ns:
            self._note_early(self._topics.duty, stamp_ns)
        elif duty is None:
            text = f'{self._topics.duty}: duty ignored: not whole numbers within -100 … 100 %'
            self._act(do.Log(text, is_warning=True))
        elif duty.delay_ns and not self._plant.constants.has_late_duties:
            text = (
                f'{self._topics.duty}: duty ignored: vector.z is {duty.delay_ns / 1e9:g} s, which '
                'takes plant_sim.kernel or plant_sim.link'
            )
            self._act(do.Log(text, is_warning=True))
        else:
            self._take_duty(stamp_ns, duty, data, is_stop=is_stop)

    @event
    def on_ack(self, stamp_ns: int) -> None:
        """Note the newest tick that the recorder has completely [ns]."""
        if not self._is_open:
            return
        if stamp_ns < self._run.start_ns:
            self._note_early(self._topics.ack, stamp_ns)
        else:
            self._take_ack(stamp_ns)

    @event
    def on_push(self, start_ns: int, force: Pair, torque: Pair) -> None:
        """Push the robot, now or at `start_ns` [ns] if that is later, as in :class:`Push`."""
        if not self._is_open:
            return
        now_ns = self._plant.time_ns
        start_ns = max(start_ns, now_ns)
        end_ns = start_ns + round(self._parameters.push_duration * SECOND_NS)
        push = Push(start_ns, end_ns, force, torque)
        problem = push.problem(now_ns)
        if not problem and self._plant.pushes >= MAX_PUSHES:
            problem = f'{MAX_PUSHES} pushes are already active or pending'
        if problem:
            text = f'{self._topics.push}: push ignored: {problem}'
            self._act(do.Log(text, is_warning=True, is_throttled=True))
        else:
            self._external_pushes.append(push)
            self._push(push)

    @event
    def on_retuned(self, stamp_ns: int, values: Mapping[str, Value]) -> None:
        """Note values that the controller's parameters have from the tick at `stamp_ns` [ns] on."""
        time = (stamp_ns - self._run.start_ns) / SECOND_NS
        if self._is_open and time >= 0.0:
            controller = self._participants.roster.members.get(CONTROLLER)
            scheduled = (
                scheduled_at(controller.parameters.get('changes', ''), time) if controller else []
            )
            self._changes += [
                ParameterChange(time, CONTROLLER, *item)
                for item in values.items()
                if item not in scheduled
            ]

    @event
    def on_parameters(self, parameters: PlantParameters) -> None:
        """Apply new parameters, such as another pace or other faults."""
        if parameters.faults != self._parameters.faults:
            change_faults(self._plant.faults, parameters, self._run.start_ns)
            self._note_faults(self._parameters.faults, parameters.faults)
            if self._phase is not Phase.DISCOVERING:
                self._act(do.CallRoll(self._run, self._setup.participant))
        self._parameters = parameters
        self._act(do.Report())
        self._pacer.restart()
        if self._is_wake_pending:
            self._cancel_wake()
            self._advance()

    @event
    def reset(self) -> None:
        """Begin a new run at the next multiple of 100 ms."""
        if self._is_ended:
            return
        self._act(do.Log(f'reset: run {self._number} ends {self._progress()}'))
        self._prepare(next_start_ns(self._plant.time_ns))
        self._begin()

    @event
    def set_paused(self, *, is_paused: bool) -> None:
        """Pause the plant at its current tick, or resume."""
        if self._is_ended:
            return
        if is_paused != self.pause.is_paused:
            self._act(do.Log('paused' if is_paused else 'resumed'))
        self.pause.set(is_paused=is_paused)
        self._act(do.Report())
        if not is_paused:
            self._continue()

    @event
    def start(self) -> None:
        """End the pause at the start, if there is one; a later pause stays."""
        if not self._is_ended and self.pause.start():
            self._act(do.Log('started'))
            self._act(do.Report())
            self._continue()

    @event
    def step(self) -> None:
        """Run one tick of a paused plant."""
        if not self._is_ended and self.pause.step():
            self._act(do.Report())
            self._advance()

    @event
    def stop(self) -> None:
        """End the run because the plant is asked to stop."""
        self._end(Outcome.STOPPED, '', 0)

    # Progress of a run

    def _prepare(self, start_ns: int) -> None:
        """Reset everything to the start of a run whose first tick is at `start_ns`."""
        self._setup = self._set_up(start_ns)
        self._parameters, self._plant = self._setup.parameters, self._setup.plant
        self._duration_ns = round(self._parameters.duration * SECOND_NS)
        self._run = RunIdentity('', start_ns)
        self._phase = Phase.DISCOVERING
        self._truth = self._plant.truth()
        self._pushes = 0
        self._external_pushes: list[Push] = []
        self._changes: list[ParameterChange] = []
        self._is_hit = self._is_held = False
        self.log = TrajectoryLog(keep=self._duration_ns > 0)
        self._round_trips_s = array('d')
        self._first_tick_s = self._last_tick_s = self._now_s
        self._missing: list[str] = []
        self._pacer.restart()
        self._cancel_wake()

    def _discover(self) -> None:
        """Begin the first run once all participants are known, or after the time limit."""
        is_complete = self._graph.is_complete() or self._now_s - self._created_s > DISCOVERY_S
        # Look for another plant after that: the last participant to be discovered may be one.
        if not self._is_only_plant():
            return
        if is_complete:
            self._cancel_wake()
            self._begin()
        else:
            self._wake_in(DISCOVERY_POLL_S)

    def _is_only_plant(self) -> bool:
        """End a run that has not begun if there is another plant; return whether there is none."""
        if self.log.ticks == 0 and self._graph.count_publishers(self._topics.clock) > 1:
            self._end(Outcome.FAILED, 'another plant publishes /clock in this ROS domain', 2)
        return not self._is_ended

    def _begin(self) -> None:
        """Announce a run."""
        self._number += 1
        self._run = RunIdentity(f'{self._number} {self._token}', self._run.start_ns)
        self._phase = Phase.GATHERING
        self._waiting_since_s = self._now_s
        self._participants.gather(
            self._run, self._setup.participant, requires_recorder=self._parameters.require_recorder
        )
        if self._setup.world is None:
            self._act(do.ClearMap())
        self._act(do.AnnounceRun(self._run))
        self._act(do.ClearError())
        self._act(do.Report())

    def _open(self) -> None:
        """Begin the run with its participants: publish the first truth."""
        self._phase = Phase.TICKING
        self._participants.confirm()
        self._note_values()
        start_s = self._run.start_ns / SECOND_NS
        self._act(do.Log(f'run {self._number} begins at sim time {start_s:.3f} s'))
        self._act(do.BeginRun(self._run.start_ns, self._setup.world, self._parameters.ball_radius))
        for push in self._setup.scenario.pushes_from(self._run.start_ns):
            self._push(push)
        self._publish_truth()
        self._act(do.Report())

    def _note_values(self) -> None:
        """Note the parameters that have other values than in the first run."""
        values = {
            (role, name): value if isinstance(value, bool | int | float | str) else str(value)
            for role, member in self._participants.roster.members.items()
            for name, value in member.parameters.items()
            if role != PLANT or name not in _OF_PACE
        }
        self._first_values = self._first_values or values
        self._changes = [
            ParameterChange(0.0, *key, value)
            for key, value in values.items()
            if value != self._first_values.get(key)
        ]

    def _push(self, push: Push) -> None:
        """Apply a push, and publish its start and end, so that the run can be replayed."""
        self._plant.push(push)
        self._pushes += 1
        self._act(do.PublishPush(push, self._pushes))
        self._act(do.Log(str(push)))

    def _publish_truth(self, *, is_resend: bool = False) -> None:
        self._truth = self._plant.truth()
        is_hit = self._plant.wall_hit
        self._act(do.PublishTruth(self._truth, is_hit, is_resend))
        if is_hit != self._is_hit:
            self._is_hit = is_hit
            # A hit that ends the run becomes its reason.
            if not is_hit:
                self._act(do.ClearError())
            elif not self._plant.stopped:
                self._act(do.RaiseError(str(self._plant.newest_hit)))
        # LockstepMaster._resend restores the second: there, a resend does not end the silence.
        self._last_sent_s = self._waiting_since_s = self._now_s

    def _tick(self, duty: MotorDuty) -> None:
        """Advance the plant by a tick."""
        if self.log.ticks == 0:
            self._first_tick_s = self._now_s
        self.log.add(self._truth, duty.x, duty.y)
        self._plant.tick(*duty)
        self._clear_warning()
        self._participants.liveness.reset()
        if self._plant.stopped:
            self._publish_truth()
            self._end(Outcome.FAILED, str(self._plant.newest_hit), 1)
        elif self._duration_ns and self._plant.time_ns - self._run.start_ns >= self._duration_ns:
            self._drain()
        else:
            self._publish_truth()

    def _drain(self) -> None:
        """End a run whose ticks are done, as soon as it is settled."""
        self._phase = Phase.DRAINING
        self._last_tick_s = self._now_s
        self._finish()

    def _finish(self) -> None:
        """End the run once it is settled, after a last check of the participants."""
        if not (self._is_settled() and self._check_participants()) or self._is_ended:
            return
        problem = self._participants.restarted_controller()
        if problem:
            self._end(Outcome.FAILED, problem, 1)
        else:
            self._end(Outcome.COMPLETED, '', 0)

    def _end(self, outcome: Outcome, reason: str, exit_status: int) -> None:
        """End the run."""
        if self._is_ended:
            return
        if self._phase is not Phase.DRAINING:
            self._last_tick_s = self._now_s
        if outcome is not Outcome.COMPLETED and self._is_open:
            self._act(do.StopMotors(self._truth.stamp_ns))
        self._phase = Phase.ENDED
        self._cancel_wake()
        wall_s = self._last_tick_s - self._first_tick_s
        self.summary = RunSummary(
            outcome=outcome,
            reason=reason,
            ticks=self.log.ticks,
            duty_sha256=self.log.duty_sha256,
            real_time_factor=self.log.ticks * TICK_NS / SECOND_NS / wall_s if wall_s else 0.0,
            late_ticks=self._pacer.late_ticks,
            resends=self.resends,
            # Leave out the first one, which includes the start-up of every node in the run.
            round_trips_s=tuple(self._round_trips_s[1:]),
            start_ns=self._run.start_ns,
            members=self._participants.roster.history,
            external_pushes=tuple(self._external_pushes),
            parameter_changes=tuple(self._changes),
        )
        self._participants.publish_status(self.summary)
        if self._number:
            self._act(do.Log(f'run {self._number} {outcome} {self._progress()}'))
        self._act(do.EndRun(self.summary, exit_status))

    # Participants

    def _on_news(self) -> None:
        """Check the participants at once if the run is waiting for them."""
        if self._phase is Phase.GATHERING:
            self._check_participants()
        elif self._phase is Phase.DRAINING:
            self._finish()

    def _check_participants(self, *, calls_roll: bool = False) -> bool:
        """Return whether all participants, and no others, are present; if not, hold or end the run.

        With `calls_roll`, call the roll while this is undecided.
        """
        standing = self._participants.readiness(self._plant.time_ns, self._now_s)
        self._plant.keep_steps(self._participants.longest_delay)
        if standing.state is ReadinessState.REFUSED:
            self._end(Outcome.FAILED, standing.reason, 1)
        elif standing.state is ReadinessState.WAITING:
            self._is_held = self._can_be_held
            if calls_roll:
                self._wait(standing)
        elif self._phase is Phase.GATHERING:
            self._open()
        else:
            self._release()
        return standing.state is ReadinessState.COMPLETE

    def _release(self) -> None:
        """Continue if the run was held."""
        if self._is_held:
            self._is_held = False
            self._waiting_since_s = self._now_s
            self._clear_warning()
            self._participants.liveness.reset()
            self._resume()

    def _wait(self, standing: Readiness) -> None:
        """Call the roll, and report the wait; fail if a participant is missing for too long."""
        self._participants.call_roll()
        waited_s = self._participants.liveness.waited_s(self._waiting_since_s)
        roster = self._participants.roster
        missing, absent = roster.missing(), roster.absent()
        if missing and missing != self._missing:
            self._missing = missing
            self._act(do.Log(f'run {self._number} waits for {", ".join(missing)}'))
        # Keep reporting, so that a waiting plant on a busy machine is not counted as silent.
        self._act(do.Report())
        limit_s = self._parameters.startup_timeout
        waits = self._parameters.on_timeout == 'wait'
        if self._is_held:
            self._warn(standing.reason)
        elif self._is_open:
            return
        elif waited_s > limit_s and absent and not waits:
            reason = f'{", ".join(absent)} silent for {limit_s:g} s before the first tick'
            self._end(Outcome.FAILED, reason, 1)
        elif self._now_s - self._waiting_since_s > STARTUP_WARN_S:
            self._warn(standing.reason)

    # Differences between lockstep and free running

    @abstractmethod
    def _note_early(self, topic: str, stamp_ns: int) -> None:
        """Note an answer with a stamp from before the run [ns], which does not count."""

    @abstractmethod
    def _take_duty(self, stamp_ns: int, duty: MotorDuty, data: bytes, *, is_stop: bool) -> None:
        """Process a duty of this run."""

    @abstractmethod
    def _take_ack(self, stamp_ns: int) -> None:
        """Note the newest tick that the recorder has completely [ns]."""

    @abstractmethod
    def _watch(self) -> None:
        """Supervise a run that has its participants."""

    @abstractmethod
    def _advance(self) -> None:
        """Advance if the run waits for nothing."""

    @abstractmethod
    def _continue(self) -> None:
        """Continue after a pause."""

    @abstractmethod
    def _is_settled(self) -> bool:
        """Return whether everything is recorded, and all participants have confirmed it."""

    @property
    @abstractmethod
    def _can_be_held(self) -> bool:
        """Whether the run halts while its participants are unclear."""

    @abstractmethod
    def _resume(self) -> None:
        """Resume a run that was held."""

    # Common to both modes

    def state(self) -> dict[str, object]:
        """Return the state of the run, as entries of the plant's diagnostics."""
        return {
            'run': self._number,
            'run name': self._run.name,
            'sim time [s]': f'{self._plant.time_ns / SECOND_NS:.3f}',
            'ticks': self.log.ticks,
            'late ticks': self._pacer.late_ticks,
            'resends': self.resends,
            'fallen': self._plant.fallen,
            'paused': self.pause.is_paused,
            'awaits start': self.pause.awaits_start,
            'pace': self._parameters.real_time_factor,
            'missing': ' '.join(self._missing) if self._phase is Phase.GATHERING else '',
        }

    @property
    def time_ns(self) -> int:
        """Sim time [ns]."""
        return self._plant.time_ns

    @property
    def has_begun(self) -> bool:
        """Whether the first truth of the current run has been published."""
        return self._phase not in (Phase.DISCOVERING, Phase.GATHERING)

    @property
    def _is_open(self) -> bool:
        """Whether the first truth has been published."""
        return self._phase in (Phase.TICKING, Phase.DRAINING)

    @property
    def _is_ended(self) -> bool:
        return self._phase is Phase.ENDED

    def _wake_in(self, delay_s: float) -> None:
        self._is_wake_pending = True
        self._act(do.WakeIn(delay_s))

    def _cancel_wake(self) -> None:
        if self._is_wake_pending:
            self._is_wake_pending = False
            self._act(do.CancelWake())

    def _warn(self, text: str) -> None:
        self._is_warned = True
        self._act(do.Warn(text))

    def _clear_warning(self) -> None:
        if self._is_warned:
            self._is_warned = False
            self._act(do.ClearWarning())

    def _progress(self) -> str:
        if self.log.ticks == 0:
            return 'before its first tick'
        return f'after {self.log.ticks} ticks, duty_sha256 {self.log.duty_sha256[:12]}…'

    def _repeat_truth(self) -> None:
        """Repeat the truth of the halted plant, for late subscribers."""
        if self._now_s - self._last_sent_s > STILL_S:
            self._publish_truth(is_resend=True)
