"""The NXT brick: runs the control program on the devices' samples."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from typing import Any

from ballbot_ros.codegen.implementation import program_maker, require_implementation
from ballbot_ros.controller.tasks import TS1_MS
from ballbot_ros.messages.controller_messages import ControllerMessages
from ballbot_ros.messages.inputs import INPUTS, device_inputs
from ballbot_ros.messages.raw import decoder, same_content, stamp_of
from ballbot_ros.messages.topics import (
    BATTERY_STATE,
    GAMEPAD_JOY,
    GYRO_IMU,
    JOINT_STATES,
    MOTOR_DUTY,
    PARTICIPANTS,
    Topic,
)
from ballbot_ros.nodes.base import NO_SAMPLE, BallbotNode, run_node
from ballbot_ros.nodes.participation import Participation
from ballbot_ros.parameters import CONTROLLER
from ballbot_ros.simulation.lockstep import LockstepInputs, Run, Step, TimerAudit
from ballbot_ros.simulation.participants import Objection
from ballbot_ros.simulation.sample_history import DEPTH
from ballbot_ros.simulation.timing import (
    FREE_RUNNING_SILENCE_S,
    MILLISECOND_NS,
    SECOND_NS,
    TICK_NS,
)


class Controller(BallbotNode):
    """Answers the inputs of every tick with one ``motor_duty`` of the same stamp.

    In lockstep a tick runs as soon as its inputs are in, and the tasks due follow from the time
    since the start of the run; the three timers on ROS time are checked against that. Free
    running, the 4 ms timer runs the tick on the newest samples.
    """

    def __init__(self, values: Mapping[str, Any] | None = None) -> None:
        super().__init__(CONTROLLER, values, use_sim_time=True)
        self._lockstep = self.values['lockstep']
        if self._lockstep:
            self.require_sim_time('in lockstep its timers go by /clock')
        self._inputs = LockstepInputs(
            {topic.name: topic.period_ns for topic in INPUTS},
            first=BATTERY_STATE.name,
            every_tick=GYRO_IMU.name,
            is_same={topic.name: same_content(topic.type_name) for topic in INPUTS},
            tick_ns=TICK_NS,
        )
        self._start_ns: int | None = None
        self._make_program = program_maker(self.values)
        self._program = self._make_program()
        self._overruns = 0
        self._resent = 0
        self._free_ticks = 0
        self._sticks_at = self._tick_at = time.monotonic()
        self._messages = ControllerMessages(self.output)
        self._task_timers: list[Any] = []
        self._set_timers()
        if not self._lockstep:
            self.every(TS1_MS * 1e-3, self._free_tick)
        self._participation = Participation(self, self._on_run)
        # Deep enough to see each of several samples of one tick.
        depth = DEPTH if self._lockstep else 1
        for topic, reader in INPUTS.items():
            self.listen(topic, self._input_callback(topic, reader), depth=depth, raw=True)

    def check(self, values: Mapping[str, Any]) -> None:
        """Find out whether there is all that the control program needs."""
        # To build takes seconds, in which the run would wait: it is done at the next one's start.
        require_implementation(values['implementation'])

    def take_values(self) -> None:
        """Let everything act that was asked for: a run begins."""
        before = self.values
        super().take_values()
        if self.values != before:
            self._make_program = program_maker(self.values)
            self._set_timers()

    def _set_timers(self) -> None:
        """Have a timer for each period of the tasks."""
        for timer in self._task_timers:
            self.destroy_timer(timer)
        self._periods_ms = (TS1_MS, self.values['ts2_period'], self.values['ts3_period'])
        self._audits = [TimerAudit(period_ms * MILLISECOND_NS) for period_ms in self._periods_ms]
        self._task_timers = [
            self.create_timer(period_ms * 1e-3, self._timer_callback(audit))
            for period_ms, audit in zip(self._periods_ms, self._audits, strict=True)
        ]

    def _timer_callback(self, audit: TimerAudit) -> Callable[[], None]:
        def fire() -> None:
            if self._start_ns is not None:
                audit.fire(self.get_clock().now().nanoseconds, self._start_ns)

        return fire

    def _input_callback(
        self, topic: Topic, reader: Callable[[Any], Any]
    ) -> Callable[[bytes], None]:
        name, decode = topic.name, decoder(topic.type_name)
        take = self._take if self._lockstep else self._take_free_running

        def receive(data: bytes) -> None:
            try:
                stamp, reading = stamp_of(data), reader(decode(data))
            except NO_SAMPLE:
                # As of another robot's joint states in the same domain.
                self.warn(f'{name}: what no device of the brick gives is ignored')
                return
            take(name, stamp, data, reading)

        return receive

    def _on_run(self, run: Run) -> None:
        self._start_ns = run.start_ns
        self._free_ticks = 0
        self._program = self._make_program()
        self._inputs.begin(run.start_ns)
        self._messages.begin()
        for audit in self._audits:
            audit.restart()

    def _take(self, name: str, stamp: int, data: bytes, reading: Any) -> None:
        step = self._inputs.take(name, stamp, data, reading)
        # It begins at the tick for which the plant asks, not at one that another has answered.
        if step is Step.MISSED_START and stamp == self.get_clock().now().nanoseconds:
            self._begin_afresh(stamp)
        elif step is Step.TICK:
            self._tick_of_lockstep()
        elif step is Step.ANSWER_AGAIN:
            self._resent += 1
            self._messages.repeat(stamp)
        elif step is Step.OBJECT:
            self._participation.object(Objection.to_sample(name, stamp))

    def _begin_afresh(self, stamp: int) -> None:
        """Begin in mid-run, but only where `rejoin` allows it."""
        if not self.values['rejoin']:
            problem = (
                f'{CONTROLLER} started in mid-run, at {stamp / SECOND_NS:.3f} s, without the state '
                'of the ticks before (rejoin: true begins afresh)'
            )
            self._participation.object(Objection(problem))
            self.finish()
            self.fail(problem)
            return
        self.get_logger().warning(f'begins afresh in mid-run, at {stamp / SECOND_NS:.3f} s')
        self._inputs.begin_afresh(stamp)

    def _tick_of_lockstep(self) -> None:
        now, start = self._inputs.next_ns, self._start_ns
        assert now is not None
        assert start is not None
        self._inputs.ticked()
        self._tick(now, now - start)

    def _take_free_running(self, name: str, stamp: int, data: bytes, reading: Any) -> None:
        if not self._participation.includes(stamp):
            return
        if name == GAMEPAD_JOY.name:
            self._sticks_at = time.monotonic()
        self._inputs.gate.put(name, stamp, reading)

    def _tick(self, now_ns: int, elapsed_ns: int) -> None:
        inputs = device_inputs(lambda topic: self._inputs.gate.newest(topic.name))
        outputs = self._program.tick(elapsed_ns // MILLISECOND_NS, now_ns // MILLISECOND_NS, inputs)
        self._messages.tick(now_ns, outputs, self._program)
        self.sampled(now_ns)

    def _free_tick(self) -> None:
        """Run a tick on the newest samples; the wall clock is the time."""
        gate = self._inputs.gate
        now = gate.stamp(GYRO_IMU.name)
        if now is None or gate.stamp(BATTERY_STATE.name) is None:
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

    def close(self) -> None:
        """Switch off the motors, and let an objection reach the plant."""
        if self.now_ns:
            self._messages.stop_motors(self.now_ns)
        self.flush(MOTOR_DUTY, PARTICIPANTS)


def main() -> None:
    """Run the node."""
    sys.exit(run_node(Controller))
