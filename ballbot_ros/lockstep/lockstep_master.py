"""The master of a run in lockstep: the plant advances only with the duty of its own tick.

The master asks again for an unanswered tick, and finds out which participant is silent.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection

from ballbot_ros.engine.pacer import PauseControl
from ballbot_ros.lockstep import run_actions as do
from ballbot_ros.lockstep.lockstep import SampleHistory, SampleStatus
from ballbot_ros.lockstep.participants import Objection
from ballbot_ros.lockstep.recording_order import RecorderFlow
from ballbot_ros.lockstep.roster import wrong_stamp_text
from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.lockstep.run_master import STARTUP_WARN_S, Phase, RunMaster
from ballbot_ros.parameters import CONTROLLER, RECORDER
from ballbot_ros.parameters.timing import MAX_LEAD_TICKS, RESEND_S, SECOND_NS
from ballbot_ros.robot.brick.brick import MotorDuty
from ballbot_ros.robot.plant.ground_truth import GroundTruth

WARN_S = 0.3


class LockstepMaster(RunMaster):
    """Conducts runs in lockstep."""

    is_lockstep = True
    _duty: MotorDuty | None

    # Events

    def _take_duty(self, stamp_ns: int, duty: MotorDuty, data: bytes, *, is_stop: bool) -> None:
        if is_stop:
            # Not an answer: the controller is leaving, and another one may take its place.
            return
        now_ns = self._plant.time_ns
        is_ahead = stamp_ns > now_ns
        if is_ahead or self._duties.classify(stamp_ns, data) is SampleStatus.CONFLICTING:
            self._participants.roster.add_objection(
                Objection.to_sample(self._topics.duty, stamp_ns, 'duty')
            )
            return
        if self._duty is not None or self._phase is Phase.DRAINING:
            return
        if stamp_ns != now_ns:
            self._other_ns[self._topics.duty] = stamp_ns
            return
        self._duty = duty
        self._answered_s = self._now_s
        if self._duration_ns:
            self._round_trips_s.append(self._now_s - self._last_sent_s)
        self._advance()

    def _take_ack(self, stamp_ns: int) -> None:
        if stamp_ns > self._plant.time_ns:
            topic = self._topics.ack
            self._participants.roster.add_objection(
                Objection(f'{topic!r} is ahead of the run', topic)
            )
            return
        self._other_ns[self._topics.ack] = stamp_ns
        self._recorder.ack_ns = stamp_ns
        self._advance()
        if self._is_behind() and self._last_sent.stamp_ns <= stamp_ns and not self._is_ended:
            # The silence of the others begins: until now, they were not asked for the newest tick.
            self._waiting_since_s = self._now_s
            self._resend()

    def _note_early(self, topic: str, stamp_ns: int) -> None:
        self._other_ns[topic] = stamp_ns

    # Running

    def _prepare(self, start_ns: int) -> None:
        super()._prepare(start_ns)
        self._recent: deque[GroundTruth] = deque(maxlen=MAX_LEAD_TICKS + 1)
        self._duties = SampleHistory(self._topics.is_same_duty)
        self._duty = None
        self._other_ns: dict[str, int] = {}
        self._answered_s = self._now_s
        self._recorder = RecorderFlow(start_ns)
        # The tick that was sent last: after a resend, it may be older than the newest.
        self._last_sent = self._truth

    def _open(self) -> None:
        self._recorder.begin(self._participants.roster.members.get(RECORDER))
        super()._open()

    def _publish_truth(self, *, is_resend: bool = False) -> None:
        super()._publish_truth(is_resend=is_resend)
        self._last_sent = self._truth
        if not is_resend:
            self._recent.append(self._truth)
            self._other_ns.clear()

    def _advance(self) -> None:
        if self._phase is Phase.DRAINING:
            self._finish()
            return
        if self._phase is not Phase.TICKING or self._duty is None or self._is_wake_pending:
            return
        if self._is_held or self._recorder.lags(self._plant.time_ns):
            return
        factor = self._pace()
        if not self.pause.is_paused and (delay_s := self._pacer.delay_s(factor, self._now_s)):
            self._wake_in(delay_s)
            return
        if not self.pause.take_step():
            return
        self._pacer.on_tick(factor, self._now_s)
        duty, self._duty = self._duty, None
        self._tick(duty)

    def _pace(self) -> float:
        """Return the pace of the next tick; the moment from which the run is live may pause it."""
        elapsed_ns = self._plant.time_ns - self._run.start_ns
        if elapsed_ns < round(self._parameters.live_from * SECOND_NS):
            return 0.0
        if self._pauses_when_live:
            self._pauses_when_live = False
            self.pause = PauseControl(starts_paused=True)
            self._act(do.Report())
        return self._parameters.real_time_factor

    def _continue(self) -> None:
        # Measure the silence from now on: the pause does not count.
        self._answered_s = self._waiting_since_s = self._now_s
        self._participants.liveness.reset()
        self._pacer.restart()
        self._advance()

    def _drain(self) -> None:
        # Whoever another plant has called away, or a stranger has answered for, now says so.
        self._last_call = self._participants.roster.calls
        self._participants.call_roll()
        super()._drain()

    def _is_settled(self) -> bool:
        last_ns = self._truth.stamp_ns
        if self._participants.controller_since_ns() > last_ns:
            return True  # no other controller can repeat the last answer: the run fails
        liveness = self._participants.liveness
        return self._recorder.has_all(last_ns) and liveness.have_confirmed(self._last_call, last_ns)

    # Silence

    def _watch(self) -> None:
        if self._duty is not None and (self.pause.is_paused or self._is_wake_pending):
            self._repeat_truth()
            if self._recorder.lags(self._plant.time_ns):
                self._recorder_left()
            return
        awaits_recorder = self._awaits_recorder()
        if awaits_recorder and self._recorder_left():
            return
        since_s = self._answered_s if awaits_recorder else self._waiting_since_s
        silent = self._find_silent(since_s, awaits_recorder=awaits_recorder)
        if self._now_s - self._last_sent_s > RESEND_S:
            if self._duty is not None:
                self._participants.call_roll()
            self._resend()
        if silent:
            self._give_up(silent)
        elif self._now_s - since_s > WARN_S:
            # Keep reporting, so that a waiting plant is not counted as silent itself.
            self._act(do.Report())

    def _awaits_recorder(self) -> bool:
        """Return whether the plant waits for the recorder instead of the controller."""
        if self._phase is Phase.DRAINING:
            return not self._recorder.has_all(self._truth.stamp_ns)
        return self._duty is not None or self._is_behind()

    def _find_silent(self, since_s: float, *, awaits_recorder: bool) -> list[str]:
        """Return the roles that have been silent for too long; call the roll early enough."""
        limit_s = self._limit_s
        if self._now_s - since_s <= min(WARN_S if self.log.ticks else STARTUP_WARN_S, limit_s):
            return []
        silences_s = self._participants.liveness.silences_s(
            since_s, self._last_sent.stamp_ns, awaits_recorder=awaits_recorder
        )
        silent = [role for role, silence_s in silences_s.items() if silence_s > limit_s]
        self._participants.call_roll()
        if awaits_recorder:
            # The recorder acknowledges nothing until it knows the required topics from the status.
            self._participants.publish_status()
        if not silent:
            what = RECORDER if awaits_recorder else 'the duty'
            self._warn(f'waiting for {what} at sim time {self._sim_time_s:.3f} s')
        return silent

    def _give_up(self, silent: Collection[str]) -> None:
        who, when = ', '.join(silent), f'{self._sim_time_s:.3f} s'
        problem = f'{who} silent for {self._limit_s:g} s at sim time {when}'
        causes = (*map(self._wrong_stamp, silent), self._participants.roster.stranger())
        if cause := '; '.join(filter(None, causes)):
            problem = f'{problem}: {cause}'
        if self._parameters.on_timeout == 'wait':
            self._warn(f'{problem}; still waiting')
        else:
            self._end(Outcome.FAILED, problem, 1)

    def _wrong_stamp(self, role: str) -> str:
        """Return with which stamp a role has answered instead of the awaited one, or ''."""
        topic = {CONTROLLER: self._topics.duty, RECORDER: self._topics.ack}.get(role)
        if topic is None:
            is_due = self._phase is not Phase.DRAINING
            return self._participants.roster.wrong_stamp(role) if is_due else ''
        return wrong_stamp_text(topic, self._other_ns.get(topic))

    @property
    def _limit_s(self) -> float:
        """The longest permitted silence [s]."""
        parameters = self._parameters
        return parameters.timeout if self.log.ticks else parameters.startup_timeout

    @property
    def _sim_time_s(self) -> float:
        return self._plant.time_ns / SECOND_NS

    # Resends

    def _resend(self) -> None:
        """Ask again for the first incomplete tick, without ending the silence.

        That tick may precede the newest: the recorder may lack samples that the controller received
        from a driver that was then killed, since the middleware discards unread samples of a dead
        process.
        """
        waiting_since_s = self._waiting_since_s
        self.resends += 1
        self._recorder.require_ack(self._plant.time_ns)
        missing = self._first_missing()
        if missing.stamp_ns < self._plant.time_ns:
            self._act(do.ResendToDrivers(missing))
            self._last_sent, self._last_sent_s = missing, self._now_s
        else:
            self._publish_truth(is_resend=True)
        self._waiting_since_s = waiting_since_s

    def _first_missing(self) -> GroundTruth:
        """Return the first tick that the recorder lacks, or else the newest tick.

        Ticks that a previous controller answered are left out: no other controller can repeat them.
        """
        next_ns = self._recorder.next_ns
        if next_ns is None:
            return self._truth
        first_ns = max(next_ns, self._participants.controller_since_ns())
        return next((truth for truth in self._recent if truth.stamp_ns >= first_ns), self._truth)

    def _is_behind(self) -> bool:
        """Return whether the tick sent last is an earlier one, resent for the recorder."""
        has_recorder = self._recorder.recorder is not None
        return has_recorder and self._last_sent.stamp_ns < self._truth.stamp_ns

    # Participants

    @property
    def _can_be_held(self) -> bool:
        return self._is_open

    def _release(self) -> None:
        if self._phase is not Phase.DRAINING and self._recorder.join(
            self._participants.roster.members.get(RECORDER), self._plant.time_ns
        ):
            self._answered_s = self._now_s
            self._advance()
        super()._release()

    def _resume(self) -> None:
        self._answered_s = self._now_s
        if self._duty is None and self._phase is Phase.TICKING:
            self._resend()
        else:
            self._advance()

    def _recorder_left(self) -> bool:
        """Continue without a recorder that left in an orderly way; return whether it did."""
        if self._parameters.require_recorder or self._graph.count_publishers(self._topics.ack):
            return False
        self._recorder.leave()
        reason = self._participants.roster.reported_failure(RECORDER)
        text = f'the recorder has left the run{reason and ": "}{reason}'
        self._act(do.Log(text, is_warning=True))
        self._advance()
        return True
