"""The newest messages of the graph, for nodes that show it from time to time."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from typing import Any

from rclpy.node import Node
from rclpy.subscription import Subscription

from ballbot_ros.messages.conversions import ball_position, body_pitch, stamp_ns
from ballbot_ros.messages.raw import decoder, stamp_of
from ballbot_ros.messages.topics import (
    BATTERY_STATE,
    HISTORY,
    LCD,
    MAP,
    MOTOR_DUTY,
    OPERATING_STATE,
    PLANT_IMU,
    PLANT_ODOM,
    RUN,
    SONAR_RANGE,
    Topic,
)
from ballbot_ros.nodes.inbox import drain, hidden_node, raw_subscription
from ballbot_ros.nodes.topic_publisher import requested_qos
from ballbot_ros.timing import SECOND_NS
from ballbot_ros.viewer.snapshot import Snapshot


class LatestMessages:
    """The newest message of each topic; only the newest message of a poll is decoded.

    The messages are read without the executor, as in the recorder: most of them are never shown,
    and a callback for each would cost many times as much.

    Parameters
    ----------
    streams : collection of Topic
        The topics whose messages all matter.
    on_message : callable
        Receives each message of these with its stamp [ns].
    """

    def __init__(
        self,
        node: Node,
        topics: Collection[Topic],
        streams: Collection[Topic] = (),
        on_message: Callable[[Topic, int, bytes], None] = lambda topic, stamp_ns, data: None,
    ) -> None:
        self._inbox = hidden_node('inbox', node)
        self._subscriptions = {
            topic: self._subscribe(topic, HISTORY if topic in streams else 1)
            for topic in dict.fromkeys((*streams, *topics))
        }
        self._streams, self._on_message = frozenset(streams), on_message
        self._decoders = {topic: decoder(topic.type_name) for topic in topics}
        self._messages: dict[Topic, Any] = {}
        self._changed: set[Topic] = set()

    def _subscribe(self, topic: Topic, depth: int) -> Subscription:
        return raw_subscription(self._inbox, topic, requested_qos(topic, depth))

    def take(self) -> tuple[Snapshot | None, set[Topic]]:
        """Read the messages that have arrived; return the robot's state, and the changed topics.

        The state is None before the robot's first pose. The topics are those with a message since
        the last state; for the first state, since the start, so that they include messages from
        before the first pose.

        A new run discards the map of the run before. A map from before the first announcement is
        kept: a late subscriber may get the map of a run before its announcement.
        """
        arrived = {}
        for topic, subscription in self._subscriptions.items():
            if received := [data for data, _ in drain(subscription)]:
                arrived[topic] = received[-1]
                for data in received if topic in self._streams else ():
                    self._on_message(topic, stamp_of(data), data)
        if RUN in arrived and RUN in self._messages:
            self._messages.pop(MAP, None)
        for topic, data in arrived.items():
            if topic not in self._decoders:
                continue
            self._messages[topic] = self._decoders[topic](data)
        self._changed.update(arrived)
        snapshot = snapshot_of(self)
        if snapshot is None:
            return None, set()
        changed, self._changed = self._changed, set()
        return snapshot, changed

    def __getitem__(self, topic: Topic) -> Any:
        """Return the newest message of a topic; None if there is none."""
        return self._messages.get(topic)

    def close(self) -> None:
        """Remove the subscriptions."""
        self._inbox.destroy_node()


def snapshot_of(newest: LatestMessages) -> Snapshot | None:
    """Return the state of the robot in the newest messages; None before its first pose."""
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
