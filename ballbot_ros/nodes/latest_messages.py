"""The newest messages of the graph, for nodes that show it from time to time."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any

from rclpy.node import Node

from ballbot_ros.controllers.interface import OperatingState
from ballbot_ros.messages.conversions import (
    NO_CONTROLLER_STATE,
    ball_position,
    ball_velocity,
    body_pitch,
    body_rates,
    controller_state,
    push_forces,
    stamp_ns,
    stick_deflection,
)
from ballbot_ros.messages.raw import decoder
from ballbot_ros.messages.topics import (
    ACCEPTED_PUSH,
    BATTERY_STATE,
    CONTROLLER_STATE,
    GAMEPAD_JOY,
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
from ballbot_ros.viewer.acting_force import ForceEvent, acting_force
from ballbot_ros.viewer.snapshot import UNKNOWN, Snapshot

_OUT_OF_CONTROL = (OperatingState.CALIBRATION, OperatingState.OUT_OF_CONTROL)
"""States in which the controller's estimates mean nothing."""


class LatestMessages:
    """The newest message of each topic; only the newest message of a poll is decoded.

    Of the pushes all messages of the run count: the plant announces start and end of a push
    together.

    The messages are read without the executor, as in the recorder: most of them are never shown,
    and a callback for each would cost many times as much.
    """

    def __init__(self, node: Node, topics: Collection[Topic]) -> None:
        self._inbox = hidden_node('inbox', node)
        self._subscriptions = {
            topic: raw_subscription(self._inbox, topic, requested_qos(topic, _depth(topic)))
            for topic in topics
        }
        self._decoders = {topic: decoder(topic.type_name) for topic in topics}
        self._messages: dict[Topic, Any] = {}
        self._forces: list[ForceEvent] = []
        self._changed: set[Topic] = set()

    def take(self) -> tuple[Snapshot | None, set[Topic]]:
        """Read the messages that have arrived; return the robot's state, and the changed topics.

        The state is None before the robot's first pose. The topics are those with a message since
        the last state; for the first state, since the start, so that they include messages from
        before the first pose.

        A new run discards the map of the run before. A map from before the first announcement is
        kept: a late subscriber may get the map of a run before its announcement.
        """
        received = {
            topic: [data for data, _ in drain(subscription)]
            for topic, subscription in self._subscriptions.items()
        }
        arrived = {topic: messages[-1] for topic, messages in received.items() if messages}
        if RUN in arrived:
            self._forces.clear()
        self._forces += [
            _force(self._decoders[ACCEPTED_PUSH](data)) for data in received.get(ACCEPTED_PUSH, ())
        ]
        if RUN in arrived and RUN in self._messages:
            self._messages.pop(MAP, None)
        for topic, data in arrived.items():
            self._messages[topic] = self._decoders[topic](data)
        self._changed.update(arrived)
        snapshot = snapshot_of(self)
        if snapshot is None:
            return None, set()
        changed, self._changed = self._changed, set()
        return snapshot._replace(force=acting_force(self._forces, snapshot.time)), changed

    def __getitem__(self, topic: Topic) -> Any:
        """Return the newest message of a topic; None if there is none."""
        return self._messages.get(topic)

    def close(self) -> None:
        """Remove the subscriptions."""
        self._inbox.destroy_node()


def _depth(topic: Topic) -> int:
    return HISTORY if topic is ACCEPTED_PUSH else 1


def _force(message: Any) -> ForceEvent:
    force, _ = push_forces(message)
    return stamp_ns(message) / SECOND_NS, message.header.frame_id, force


def snapshot_of(newest: LatestMessages) -> Snapshot | None:
    """Return the state of the robot in the newest messages; None before its first pose."""
    body, ball = newest[PLANT_IMU], newest[PLANT_ODOM]
    if body is None or ball is None:
        return None
    duty, sonar, battery = newest[MOTOR_DUTY], newest[SONAR_RANGE], newest[BATTERY_STATE]
    state, lcd = newest[OPERATING_STATE], newest[LCD]
    estimates, sticks = newest[CONTROLLER_STATE], newest[GAMEPAD_JOY]
    is_in_control = state is not None and state.data not in _OUT_OF_CONTROL
    return Snapshot(
        time=stamp_ns(ball) / SECOND_NS,
        position=ball_position(ball),
        psi=body_pitch(body),
        speed=ball_velocity(ball),
        pitch_rate=body_rates(body),
        estimates=(
            controller_state(estimates) if estimates and is_in_control else NO_CONTROLLER_STATE
        ),
        sticks=stick_deflection(sticks) if sticks else UNKNOWN,
        duty=(duty.vector.x, duty.vector.y) if duty else (math.nan, math.nan),
        sonar=sonar.range if sonar else math.nan,
        cone_angle=sonar.field_of_view if sonar else 0.0,
        battery=battery.voltage if battery else math.nan,
        state=state.data if state else '',
        lcd=lcd.data if lcd else '',
    )
