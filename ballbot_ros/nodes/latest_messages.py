"""The newest messages of the graph, for nodes that show it now and then."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any

from rclpy.node import Node

from ballbot_ros.messages.conversions import ball_position, body_pitch, stamp_ns
from ballbot_ros.messages.raw import decoder
from ballbot_ros.messages.topics import (
    BATTERY_STATE,
    LCD,
    MOTOR_DUTY,
    OPERATING_STATE,
    PLANT_IMU,
    PLANT_ODOM,
    SONAR_RANGE,
    Topic,
)
from ballbot_ros.nodes.base import requested_qos
from ballbot_ros.nodes.inbox import drain, hidden_node, raw_subscription
from ballbot_ros.timing import SECOND_NS
from ballbot_ros.viewer.snapshot import Snapshot


class LatestMessages:
    """The newest message of each topic, decoded only when it is looked for.

    The messages are read past the executor, as the recorder does it: a callback for each of
    them, of which most are never shown, would cost many times as much.

    Parameters
    ----------
    node : rclpy.node.Node
        In whose namespace the topics are.
    topics : collection of Topic
    """

    def __init__(self, node: Node, topics: Collection[Topic]) -> None:
        self._inbox = hidden_node('inbox', node)
        self._subscriptions = {
            topic: raw_subscription(self._inbox, topic, requested_qos(topic, 1)) for topic in topics
        }
        self._decoders = {topic: decoder(topic.type_name) for topic in topics}
        self._messages: dict[Topic, Any] = {}
        self._changed: set[Topic] = set()

    def take(self) -> tuple[Snapshot | None, set[Topic]]:
        """Take what has come.

        Returns
        -------
        snapshot : Snapshot or None
            What the newest messages tell; None before the first of the robot's pose.
        changed : set of Topic
            The topics that have had a message since the last snapshot, so that of a run which was
            announced before there was a pose nothing is missed.
        """
        for topic, subscription in self._subscriptions.items():
            come = [data for data, _ in drain(subscription)]
            if come:
                self._messages[topic] = self._decoders[topic](come[-1])
                self._changed.add(topic)
        snapshot = snapshot_of(self)
        if snapshot is None:
            return None, set()
        changed, self._changed = self._changed, set()
        return snapshot, changed

    def __getitem__(self, topic: Topic) -> Any:
        """Return the newest message; None if there is none."""
        return self._messages.get(topic)

    def close(self) -> None:
        """Take leave of the topics."""
        self._inbox.destroy_node()


def snapshot_of(newest: LatestMessages) -> Snapshot | None:
    """Return what the newest messages tell; None before the first of the robot's pose."""
    body, ball = newest[PLANT_IMU], newest[PLANT_ODOM]
    if body is None or ball is None:
        return None
    duty, sonar, battery = newest[MOTOR_DUTY], newest[SONAR_RANGE], newest[BATTERY_STATE]
    state, lcd = newest[OPERATING_STATE], newest[LCD]
    return Snapshot(
        time=stamp_ns(ball) / SECOND_NS,
        position=ball_position(ball),
        psi=body_pitch(body),
        duty=(duty.vector.x, duty.vector.y) if duty else (math.nan, math.nan),
        sonar=sonar.range if sonar else math.nan,
        cone_angle=sonar.field_of_view if sonar else 0.0,
        battery=battery.voltage if battery else math.nan,
        state=state.data if state else '',
        lcd=lcd.data if lcd else '',
    )
