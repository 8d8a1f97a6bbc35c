"""What the plant publishes: each topic, and the message that is filled again and again."""

from __future__ import annotations

from typing import Any

from rclpy.duration import Duration

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
from ballbot_ros.messages.topics import (
    ACCEPTED_PUSH,
    BATTERY_STATE,
    CLOCK,
    MAP,
    PLANT_IMU,
    PLANT_JOINT_STATES,
    PLANT_ODOM,
    RUN,
    WALL_HIT,
)
from ballbot_ros.nodes.base import BallbotNode
from ballbot_ros.plant.truth import Push, Truth
from ballbot_ros.simulation.timing import BATTERY_NS
from ballbot_ros.world.exports import occupancy_grid
from ballbot_ros.world.world import World


class PlantOutputs:
    """The plant's publishers.

    Parameters
    ----------
    node : BallbotNode
        The plant's node.
    ball_radius : float
        Height of the ball's centre [m].
    """

    def __init__(self, node: BallbotNode, ball_radius: float) -> None:
        self._ball_radius = ball_radius
        topics = (
            CLOCK, RUN, PLANT_JOINT_STATES, PLANT_IMU, PLANT_ODOM, BATTERY_STATE, WALL_HIT,
            ACCEPTED_PUSH,
        )  # fmt: skip
        self._publishers = {topic: node.advertise(topic) for topic in topics}
        self._publishers[MAP] = node.advertise(MAP, depth=1)
        self._messages: dict[Any, Any] = {
            topic: topic.message_class() for topic in self._publishers
        }

    def _publish(self, topic: Any) -> None:
        self._publishers[topic].publish(self._messages[topic])

    def run(self, start_ns: int, name: str, world: World | None) -> None:
        """Announce a run, and what it begins with."""
        fill_header(self._messages[RUN], start_ns, name)
        self._publish(RUN)
        if world:
            fill_map(self._messages[MAP], start_ns, occupancy_grid(world.map))
            self._publish(MAP)
        self._messages[WALL_HIT].data = False
        self._publish(WALL_HIT)

    def accepted(self, push: Push, number: int) -> None:
        """Tell when a push begins and ends to act, for the run to be made again."""
        for stamp, acts in ((push.start_ns, True), (push.end_ns, False)):
            fill_accepted_push(self._messages[ACCEPTED_PUSH], stamp, push, number, acts=acts)
            self._publish(ACCEPTED_PUSH)

    def truth(self, truth: Truth) -> None:
        """Publish the truth of a tick."""
        messages = self._messages
        fill_clock(messages[CLOCK], truth.stamp_ns)
        self._publish(CLOCK)
        fill_body(messages[PLANT_IMU], truth)
        self._publish(PLANT_IMU)
        fill_motors(messages[PLANT_JOINT_STATES], truth)
        self._publish(PLANT_JOINT_STATES)
        if truth.stamp_ns % BATTERY_NS == 0:
            fill_battery(messages[BATTERY_STATE], truth)
            self._publish(BATTERY_STATE)
        fill_odometry(messages[PLANT_ODOM], truth, self._ball_radius)
        self._publish(PLANT_ODOM)

    def wall_hit(self, hit: bool) -> bool:
        """Publish ``wall_hit`` if it has changed; return whether it has."""
        message = self._messages[WALL_HIT]
        if message.data == hit:
            return False
        message.data = hit
        self._publish(WALL_HIT)
        return True

    def flush(self) -> None:
        """Let the last messages reach their readers."""
        for topic in (CLOCK, PLANT_IMU, PLANT_JOINT_STATES, PLANT_ODOM, WALL_HIT):
            self._publishers[topic].wait_for_all_acked(Duration(seconds=0.1))
