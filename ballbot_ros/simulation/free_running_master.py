"""The master of a free-running run: the plant follows the wall clock and waits for nobody."""

from __future__ import annotations

from ballbot_ros.simulation.outcome import Outcome
from ballbot_ros.simulation.run_master import Phase, RunMaster, event
from ballbot_ros.timing import FREE_RUNNING_SILENCE_S, RESEND_S, TICK_S


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
        self._tick((0, 0) if is_silent else self._duty)

    def _take_duty(
        self, stamp_ns: int, duty: tuple[int, int], data: bytes, *, is_stop: bool
    ) -> None:
        self._duty, self._duty_s = duty, self._now_s

    def _note_early(self, topic: str, stamp_ns: int) -> None:
        pass  # it is not waited for

    def _take_ack(self, stamp_ns: int) -> None:
        pass  # The recorder does not hold up a free-running plant.

    # Running

    def _prepare(self, start_ns: int) -> None:
        super()._prepare(start_ns)
        self._duty = (0, 0)
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
