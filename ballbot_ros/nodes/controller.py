"""The NXT brick: runs the control program on the devices' samples."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from typing import Any

from ballbot_ros.codegen.implementation import program_maker
from ballbot_ros.controller.tasks import TS1_MS
from ballbot_ros.messages.controller_messages import ControllerMessages
from ballbot_ros.messages.conversions import stamp_ns, time_ns
from ballbot_ros.messages.inputs import INPUTS, device_inputs
from ballbot_ros.messages.topics import BATTERY_STATE, GAMEPAD_JOY, GYRO_IMU, JOINT_STATES, RUN
from ballbot_ros.nodes.base import BallbotNode, run_node
from ballbot_ros.parameters import CONTROLLER
from ballbot_ros.simulation.lockstep import InputGate, TimerAudit
from ballbot_ros.simulation.timing import FREE_RUNNING_SILENCE_S, MILLISECOND_NS, TICK_NS


class Controller(BallbotNode):
    """Answers the inputs of every tick with one ``motor_duty`` of the same stamp.

    In lockstep a tick runs as soon as its inputs are in, and the tasks due follow from the time
    since the start of the run; the three timers on ROS time are checked against that. Free
    running, the 4 ms timer runs the tick on the newest samples.
    """

    def __init__(self, values: Mapping[str, Any] | None = None) -> None:
        super().__init__(CONTROLLER, values, use_sim_time=True)
        self._lockstep = self.values['lockstep']
        self._gate = InputGate({topic.name: topic.period_ns for topic in INPUTS})
        self._run_name: str | None = None
        self._start_ns = 0
        self._next_ns: int | None = None
        self._make_program = program_maker(self.values)
        self._program = self._make_program()
        self._overruns = 0
        self._resent = 0
        self._free_ticks = 0
        self._sticks_at = self._tick_at = time.monotonic()
        self._messages = ControllerMessages(self.output)
        self._periods_ms = (TS1_MS, self.values['ts2_period'], self.values['ts3_period'])
        self._audits = [TimerAudit(period_ms * MILLISECOND_NS) for period_ms in self._periods_ms]
        for period_ms, audit in zip(self._periods_ms, self._audits, strict=True):
            self.create_timer(period_ms * 1e-3, self._timer_callback(audit))
        if not self._lockstep:
            self.every(TS1_MS * 1e-3, self._free_tick)
        self.listen(RUN, self._on_run)
        for topic, reader in INPUTS.items():
            self.listen(topic, self._input_callback(topic.name, reader))

    def _timer_callback(self, audit: TimerAudit) -> Callable[[], None]:
        def fire() -> None:
            if self._run_name is not None:
                audit.fire(self.get_clock().now().nanoseconds, self._start_ns)

        return fire

    def _input_callback(self, name: str, reader: Callable[[Any], Any]) -> Callable[[Any], None]:
        def receive(message: Any) -> None:
            stamp = stamp_ns(message)
            try:
                reading = reader(message)
            except (ValueError, IndexError, OverflowError):
                # As of another robot's joint states in the same domain.
                self.warn(f'{name}: what no device of the brick gives is ignored')
                return
            if name == GAMEPAD_JOY.name:
                self._sticks_at = time.monotonic()
            if self._gate.put(name, stamp, reading):
                if self._lockstep:
                    self._try_tick()
            elif self._lockstep and self._next_ns and stamp == self._next_ns - TICK_NS:
                # The plant asks again: it has not got the answer.
                self._resent += 1
                self._messages.repeat_duty(stamp)

        return receive

    def _on_run(self, header: Any) -> None:
        if header.frame_id == self._run_name:
            return
        restarted = self._run_name is not None
        self._run_name = header.frame_id
        self._start_ns = time_ns(header.stamp)
        self._next_ns = None
        self._program = self._make_program()
        for audit in self._audits:
            audit.restart()
        if restarted and (self._gate.stamp(GYRO_IMU.name) or 0) > self._start_ns:
            # Another plant has begun at an earlier time.
            self._gate.clear()
        if self._lockstep:
            self._try_tick()

    def _try_tick(self) -> None:
        if self._run_name is None:
            return
        if self._next_ns is None and not self._join():
            return
        assert self._next_ns is not None
        if self._gate.ready(self._next_ns):
            now = self._next_ns
            self._next_ns = now + TICK_NS
            self._tick(now, now - self._start_ns)

    def _join(self) -> bool:
        """Begin at the run's first tick; in mid-run only where `rejoin` allows it."""
        first = self._gate.stamp(GYRO_IMU.name)
        if first is None or first < self._start_ns:
            return False
        if first > self._start_ns:
            if not self.values['rejoin']:
                self.finish()
                self.fail(
                    f'started in mid-run, at {first * 1e-9:.3f} s, without the state of the '
                    'ticks before: the run has failed (rejoin: true begins afresh)'
                )
                return False
            self.get_logger().warning(f'begins afresh in mid-run, at {first * 1e-9:.3f} s')
        self._next_ns = first
        return True

    def _tick(self, now_ns: int, elapsed_ns: int) -> None:
        inputs = device_inputs(lambda topic: self._gate.newest(topic.name))
        outputs = self._program.tick(elapsed_ns // MILLISECOND_NS, now_ns // MILLISECOND_NS, inputs)
        self._messages.tick(now_ns, outputs, self._program)
        self.sampled(now_ns)

    def _free_tick(self) -> None:
        """Run a tick on the newest samples; the wall clock is the time."""
        gate = self._gate
        now = gate.stamp(GYRO_IMU.name)
        if now is None or gate.stamp(BATTERY_STATE.name) is None or self._run_name is None:
            return
        if gate.stamp(JOINT_STATES.name) is None:
            return
        at = time.monotonic()
        if self._free_ticks and at - self._tick_at > 2e-3 * TS1_MS:
            self._overruns += 1
        self._tick_at = at
        if at - self._sticks_at > FREE_RUNNING_SILENCE_S:
            gate.put(GAMEPAD_JOY.name, now, (0, 0))
        elapsed = self._free_ticks * TICK_NS
        self._free_ticks += 1
        self._tick(now, elapsed)

    def diagnose(self) -> Mapping[str, Any]:
        """Return the counts of timers, overruns and repeated answers."""
        return {
            'operating state': self._messages.operating_state,
            f'timer callbacks {"/".join(map(str, self._periods_ms))} ms': '/'.join(
                str(audit.fired) for audit in self._audits
            ),
            'timer disagreements': sum(audit.disagreements for audit in self._audits),
            'overruns': self._overruns,
            'answers sent again': self._resent,
        }


def main() -> None:
    """Run the node."""
    sys.exit(run_node(Controller))


if __name__ == '__main__':
    main()
