"""The plant's messages, for the graph and for recordings without one."""

from __future__ import annotations

from ballbot_ros.messages.conversions import (
    encode_accepted_push,
    encode_battery,
    encode_body,
    encode_clock,
    encode_header,
    encode_map,
    encode_motors,
    encode_odometry,
    encode_wall_hit,
)
from ballbot_ros.messages.motor_stop import encode_stop
from ballbot_ros.messages.outputs import MakeSend
from ballbot_ros.messages.steps import encode_steps
from ballbot_ros.messages.topics import (
    ACCEPTED_PUSH,
    BATTERY_STATE,
    CLOCK,
    MAP,
    MOTOR_DUTY,
    PLANT_IMU,
    PLANT_JOINT_STATES,
    PLANT_ODOM,
    PLANT_SLOW_ODOM,
    PLANT_STEPS,
    RUN,
    WALL_HIT,
)
from ballbot_ros.plant.ground_truth import GroundTruth, Push
from ballbot_ros.timing import BATTERY_PERIOD_NS, SLOW_PERIOD_NS, TICK_NS
from ballbot_ros.world.exports import occupancy_grid
from ballbot_ros.world.world import World


class PlantMessages:
    """Encodes and sends the plant's messages."""

    def __init__(self, make: MakeSend) -> None:
        self.ball_radius = 0.0
        self._battery_sample = b''
        self._wall_hit = False
        self._send_clock = make(CLOCK)
        self._send_run = make(RUN)
        self._send_motors = make(PLANT_JOINT_STATES)
        self._send_body = make(PLANT_IMU)
        self._send_odometry = make(PLANT_ODOM)
        self._send_slow_odometry = make(PLANT_SLOW_ODOM)
        self._send_steps = make(PLANT_STEPS)
        self._send_battery = make(BATTERY_STATE)
        self._send_wall_hit = make(WALL_HIT)
        self._send_accepted_push = make(ACCEPTED_PUSH)
        self._send_map = make(MAP)
        self._send_duty = make(MOTOR_DUTY)

    def announce(self, start_ns: int, name: str) -> None:
        """Announce a run, so that its participants join it."""
        self._send_run(start_ns, encode_header(start_ns, name))

    def begin(self, start_ns: int, world: World | None) -> None:
        """Publish the initial state of a run."""
        if world:
            self._send_map(start_ns, encode_map(start_ns, occupancy_grid(world.map)))
        self._set_wall_hit(start_ns, wall_hit=False)

    def push(self, push: Push, number: int) -> None:
        """Publish the start and the end of a push, so that the run can be replayed."""
        for stamp, acts in ((push.start_ns, True), (push.end_ns, False)):
            self._send_accepted_push(stamp, encode_accepted_push(stamp, push, number, acts=acts))

    def truth(self, truth: GroundTruth, *, wall_hit: bool, is_resend: bool = False) -> None:
        """Send the plant's true state at a tick, and `wall_hit` if it has changed.

        With `is_resend`, also send the newest battery sample again, because a controller that has
        just joined waits for it.
        """
        stamp_ns = truth.stamp_ns
        self._send_clock(stamp_ns, encode_clock(stamp_ns))
        # Send the battery sample before the drivers' inputs: it marks the start of the run for the
        # controller.
        if stamp_ns % BATTERY_PERIOD_NS == 0:
            self._battery_sample = encode_battery(truth)
        if is_resend or stamp_ns % BATTERY_PERIOD_NS == 0:
            self._send_battery(stamp_ns, self._battery_sample)
        self.send_to_drivers(truth)
        if self._wall_hit != wall_hit:
            self._set_wall_hit(stamp_ns, wall_hit=wall_hit)

    def _set_wall_hit(self, stamp_ns: int, *, wall_hit: bool) -> None:
        self._wall_hit = wall_hit
        self._send_wall_hit(stamp_ns, encode_wall_hit(wall_hit=wall_hit))

    def send_to_drivers(self, truth: GroundTruth) -> None:
        """Send the topics that the drivers answer."""
        stamp_ns = truth.stamp_ns
        self._send_body(stamp_ns, encode_body(truth))
        self._send_motors(stamp_ns, encode_motors(truth))
        self._send_odometry(stamp_ns, encode_odometry(truth, self.ball_radius))

    def send_unrecorded(self, truth: GroundTruth) -> None:
        """Send the topics that only drivers read.

        They are the odometry at the sampling times of the slow ones, and the latest physics steps,
        if samples have a dead time.
        """
        stamp_ns = truth.stamp_ns
        if stamp_ns % SLOW_PERIOD_NS == 0:
            self._send_slow_odometry(stamp_ns, encode_odometry(truth, self.ball_radius))
        if truth.steps:
            self._send_steps(stamp_ns, encode_steps(truth))

    def stop_motors(self, last_ns: int) -> None:
        """Publish that the motors are off from the tick after the last one."""
        stamp_ns = last_ns + TICK_NS
        self._send_duty(stamp_ns, encode_stop(stamp_ns))
