"""The plant's messages, for the graph and for recordings without one."""

from __future__ import annotations

from ballbot_ros.messages.conversions import (
    fill_accepted_push,
    fill_battery,
    fill_body,
    fill_clock,
    fill_header,
    fill_map,
    fill_motors,
    fill_odometry,
)
from ballbot_ros.messages.motor_stop import send_stop
from ballbot_ros.messages.outputs import MakeOutput
from ballbot_ros.messages.topics import (
    ACCEPTED_PUSH,
    BATTERY_STATE,
    CLOCK,
    MAP,
    MOTOR_DUTY,
    PLANT_IMU,
    PLANT_JOINT_STATES,
    PLANT_ODOM,
    RUN,
    WALL_HIT,
)
from ballbot_ros.plant.ground_truth import GroundTruth, Push
from ballbot_ros.timing import BATTERY_PERIOD_NS
from ballbot_ros.world.exports import occupancy_grid
from ballbot_ros.world.world import World


class PlantMessages:
    """Fills and sends the plant's messages.

    Parameters
    ----------
    make : callable
        Creates the output of a topic.

    Attributes
    ----------
    ball_radius : float
        Height of the ball's centre [m].
    """

    def __init__(self, make: MakeOutput) -> None:
        self.ball_radius = 0.0
        self._clock = make(CLOCK)
        self._run = make(RUN)
        self._motors = make(PLANT_JOINT_STATES)
        self._body = make(PLANT_IMU)
        self._odometry = make(PLANT_ODOM)
        self._battery = make(BATTERY_STATE)
        self._wall_hit = make(WALL_HIT)
        self._accepted_push = make(ACCEPTED_PUSH)
        self._map = make(MAP)
        self._duty = make(MOTOR_DUTY)

    def announce(self, start_ns: int, name: str) -> None:
        """Announce a run, so that its participants join it."""
        fill_header(self._run.message, start_ns, name)
        self._run.send(start_ns)

    def begin(self, start_ns: int, world: World | None) -> None:
        """Publish the initial state of a run."""
        if world:
            fill_map(self._map.message, start_ns, occupancy_grid(world.map))
            self._map.send(start_ns)
        self._wall_hit.message.data = False
        self._wall_hit.send(start_ns)

    def push(self, push: Push, number: int) -> None:
        """Publish the start and the end of a push, so that the run can be replayed."""
        for stamp, acts in ((push.start_ns, True), (push.end_ns, False)):
            fill_accepted_push(self._accepted_push.message, stamp, push, number, acts=acts)
            self._accepted_push.send(stamp)

    def truth(self, truth: GroundTruth, *, wall_hit: bool, is_resend: bool = False) -> bool:
        """Send the plant's true state at a tick; return whether `wall_hit` has changed.

        With `is_resend`, also send the newest battery sample again, because a controller that has
        just joined waits for it.
        """
        stamp_ns = truth.stamp_ns
        fill_clock(self._clock.message, stamp_ns)
        self._clock.send(stamp_ns)
        # Send the battery sample before the drivers' inputs: it marks the start of the run for the
        # controller.
        if stamp_ns % BATTERY_PERIOD_NS == 0:
            fill_battery(self._battery.message, truth)
        if is_resend or stamp_ns % BATTERY_PERIOD_NS == 0:
            self._battery.send(stamp_ns)
        self.send_to_drivers(truth)
        hit = self._wall_hit.message
        if hit.data == wall_hit:
            return False
        hit.data = wall_hit
        self._wall_hit.send(stamp_ns)
        return True

    def send_to_drivers(self, truth: GroundTruth) -> None:
        """Send the topics that the drivers answer."""
        stamp_ns = truth.stamp_ns
        fill_body(self._body.message, truth)
        self._body.send(stamp_ns)
        fill_motors(self._motors.message, truth)
        self._motors.send(stamp_ns)
        fill_odometry(self._odometry.message, truth, self.ball_radius)
        self._odometry.send(stamp_ns)

    def stop_motors(self, last_ns: int) -> None:
        """Publish that the motors are off from the tick after the last one."""
        send_stop(self._duty, last_ns)
