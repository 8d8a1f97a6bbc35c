"""Free-running mode: a plant that waits for nobody, and tasks that wall-clock timers start."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable

from ballbot_ros.lockstep.lockstep import DueTick, InputGate
from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.lockstep.run_master import Phase, RunMaster, event
from ballbot_ros.parameters.timing import FREE_RUNNING_SILENCE_S, RESEND_S, SECOND_NS, TICK_S
from ballbot_ros.robot.brick.bluetooth import NEUTRAL
from ballbot_ros.robot.brick.brick import MotorDuty
from ballbot_ros.robot.brick.schedule import Schedule, TaskTiming


class FreeRunningMaster(RunMaster):
    """Conducts runs in which each tick uses the newest duty."""

    is_lockstep = False
    _duty_s: float | None

    # Events

    @event
    def on_tick(self) -> None:
        """Advance by one tick with the newest duty, or with zero duty after a silence."""
        if self._phase is not Phase.TICKING:
            return
        if problem := self._participants.roster.fatal_objection:
            self._end(Outcome.FAILED, problem, 1)
            return
        if self.log.ticks == 0 and self._awaits_first_duty():
            if self._now_s - self._waiting_since_s > RESEND_S:
                self._publish_truth(is_resend=True)
            return
        is_paused = self.pause.is_paused
        if not self.pause.take_step():
            return
        period_s = TICK_S / (self._parameters.real_time_factor or 1.0)
        if (
            self.log.ticks
            and not is_paused
            and self._now_s - self._waiting_since_s > 2.0 * period_s
        ):
            self._pacer.late_ticks += 1
        is_silent = self._duty_s is None or self._now_s - self._duty_s > FREE_RUNNING_SILENCE_S
        self._tick(MotorDuty(0, 0) if is_silent else self._duty)

    def _take_duty(self, stamp_ns: int, duty: MotorDuty, data: bytes, *, is_stop: bool) -> None:
        self._duty, self._duty_s = duty, self._now_s

    def _note_early(self, topic: str, stamp_ns: int) -> None:
        pass  # it is not waited for

    def _take_ack(self, stamp_ns: int) -> None:
        pass  # The recorder does not hold up a free-running plant.

    # Running

    def _prepare(self, start_ns: int) -> None:
        super()._prepare(start_ns)
        self._duty = MotorDuty(0, 0)
        self._duty_s = None

    def _begin(self) -> None:
        super()._begin()
        self._begun_s = self._now_s
        self._open()

    def _awaits_first_duty(self) -> bool:
        """Return whether the plant still waits for the first duty.

        It does so in order that the controller calibrates from the first tick.
        """
        limit_s = self._parameters.startup_timeout
        return self._duty_s is None and self._now_s - self._begun_s < limit_s

    def _watch(self) -> None:
        self._repeat_truth()

    def _advance(self) -> None:
        pass  # The wall clock triggers the ticks.

    def _continue(self) -> None:
        # Measure the silence from now on: the pause does not count.
        self._waiting_since_s = self._now_s
        if self._duty_s is not None:
            self._duty_s = self._now_s

    def _is_settled(self) -> bool:
        return True

    @property
    def _can_be_held(self) -> bool:
        return self._phase is Phase.DRAINING

    def _resume(self) -> None:
        self._finish()


_SILENCE_NS = round(FREE_RUNNING_SILENCE_S * SECOND_NS)


class FreeRunningTicks:
    """Starts tasks on the newest samples when their timers fire.

    The first tick is the first callback of the tick timer for which all needed samples have
    arrived; all tasks run there. After that, each callback of the tick timer is a tick, and runs
    those tasks whose timers have fired since the previous one.

    Parameters
    ----------
    every_tick : str
        The task whose timer drives the ticks.
    clock : str
        The input whose newest stamp is the sim time of the tick.
    needed : collection of str
        The inputs that a tick requires, including `clock`.
    sticks : str
        The input that becomes neutral after a silence.
    """

    def __init__(
        self, *, every_tick: str, clock: str, needed: Collection[str], sticks: str, tick_ns: int
    ) -> None:
        self.gate = InputGate({})
        self.fired: Counter[str] = Counter()  # the callbacks of each task's timer
        self.late_ticks = 0
        self._every_tick, self._clock, self._needed = every_tick, clock, needed
        self._sticks, self._tick_ns = sticks, tick_ns
        self._schedule = Schedule(())
        self._start_ns: int | None = None
        self._released: set[str] = set()
        self._ticked_at_ns: int | None = None
        self._sticks_at_ns = 0

    def begin(self, start_ns: int, tasks: Iterable[TaskTiming]) -> None:
        """Wait for the samples of a run of `tasks` that begins at `start_ns` [ns]."""
        self.gate.clear()
        self._schedule = Schedule(tasks)
        self._start_ns = start_ns
        self._released.clear()
        self._ticked_at_ns = None

    def take(self, name: str, stamp_ns: int, value: object, at_ns: int) -> None:
        """Store a sample with stamp `stamp_ns` [ns] that arrived at wall time `at_ns` [ns]."""
        if self._start_ns is None or stamp_ns < self._start_ns:
            return
        if name == self._sticks:
            self._sticks_at_ns = at_ns
        self.gate.put(name, stamp_ns, value)

    def on_timer(self, task: str, at_ns: int) -> DueTick | None:
        """Release a task whose timer fired at wall time `at_ns` [ns]; return a tick if one is due.

        `untimed` of the first tick lists the periodic tasks whose timers have not fired yet; they
        must be restarted to be in phase with that tick.
        """
        self.fired[task] += 1
        now = self.gate.stamp(self._clock)
        if task != self._every_tick:
            self._released.add(task)
            return None
        if now is None or any(self.gate.stamp(name) is None for name in self._needed):
            return None
        is_first = self._ticked_at_ns is None
        if self._ticked_at_ns is None:
            self._sticks_at_ns = at_ns
        elif at_ns - self._ticked_at_ns > 2 * self._tick_ns:
            self.late_ticks += 1
        self._ticked_at_ns = at_ns
        if at_ns - self._sticks_at_ns > _SILENCE_NS:
            self.gate.put(self._sticks, now, NEUTRAL)
        self._released.add(task)
        due = [each for each in self._schedule.tasks if is_first or each.name in self._released]
        untimed = [each.name for each in due if each.period_ms and each.name not in self._released]
        self._released.clear()
        return DueTick(now, tuple(each.name for each in due), tuple(untimed))
