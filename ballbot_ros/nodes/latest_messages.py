"""The newest messages of the graph, for nodes that show it from time to time."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from contextlib import suppress
from typing import Any

from rclpy.node import Node

from ballbot_ros.controllers.interface import OUT_OF_CONTROL
from ballbot_ros.nodes.endpoints import drain, hidden_node, raw_subscription, requested_qos
from ballbot_ros.parameters import PLANT
from ballbot_ros.parameters.timing import SECOND_NS
from ballbot_ros.recording.messages.conversions import (
    NO_CONTROLLER_STATE,
    ball_velocity,
    body_pitch,
    body_rates,
    controller_state,
    odometry_position,
    push_forces,
    stamp_ns,
    stick_deflection,
    time_ns,
)
from ballbot_ros.recording.messages.raw import decoder, has_stamp, stamp_of
from ballbot_ros.recording.messages.topics import (
    ACCEPTED_PUSH,
    BATTERY_STATE,
    CONTROLLER_STATE,
    GAMEPAD_JOY,
    HISTORY,
    LCD,
    MOTOR_DUTY,
    OPERATING_STATE,
    PLANT_IMU,
    PLANT_ODOM,
    RUN,
    SESSION,
    SONAR_RANGE,
    Topic,
)
from ballbot_ros.viewer.run_activity import Session, decode_session
from ballbot_ros.viewer.snapshot import UNKNOWN, ForceEvent, ShownRun, Snapshot, acting_force

_PUBLISHED = 'source_timestamp'
"""Time of publication in a message's metadata [ns]."""


class LatestMessages:
    """The newest message of each topic; only the newest message of a poll is decoded.

    Of the pushes all messages of the run count: the plant announces start and end of a push
    together.

    The messages are read without the executor, as in the recorder: most of them are never shown,
    and a callback for each would cost many times as much.

    Attributes
    ----------
    inbox : Node
        The hidden node of the subscriptions, for others that its owner drains.
    run : ShownRun
        The run to which the messages belong; a new one discards those of the run before.
    session : Session or None
        What the command of the run tells, if ``SESSION`` is among the topics.
    """

    def __init__(self, node: Node, topics: Collection[Topic]) -> None:
        self.inbox = hidden_node('inbox', node)
        self._subscriptions = {
            topic: raw_subscription(
                self.inbox, topic, requested_qos(topic, HISTORY if topic is ACCEPTED_PUSH else 1)
            )
            for topic in topics
        }
        self._decoders = {topic: decoder(topic.type_name) for topic in topics}
        self._stamped = {topic for topic in topics if has_stamp(topic.type_name)}
        self._messages: dict[Topic, Any] = {}
        self._forces: list[ForceEvent] = []
        self._changed: set[Topic] = set()
        self.run = ShownRun()
        self.session: Session | None = None

    def take(self) -> tuple[Snapshot | None, set[Topic]]:
        """Read the messages that have arrived; return the robot's state, and the changed topics.

        The state is None before the robot's first pose in its run. The topics are those with a
        message since the last state; for the first state of a run, since its announcement or
        before, as a late subscriber may get its messages before the announcement.
        """
        received = {
            topic: messages
            for topic, subscription in self._subscriptions.items()
            if (messages := list(drain(subscription)))
        }
        if SESSION in received:
            self._on_session(*received.pop(SESSION)[-1])
        if RUN in received and self._on_run(*received[RUN][-1]):
            # They may be from the run before, and come again with the next tick.
            received = {topic: each for topic, each in received.items() if not topic.period_ns}
        received.pop(RUN, None)
        for topic, messages in received.items():
            for data, _ in messages if topic is ACCEPTED_PUSH else messages[-1:]:
                self._on_message(topic, data)
        snapshot = snapshot_of(self)
        if snapshot is None:
            return None, set()
        changed, self._changed = self._changed, set()
        return snapshot._replace(force=acting_force(self._forces, snapshot.time)), changed

    def _on_session(self, data: bytes, metadata: Mapping[str, Any]) -> None:
        """Note what the command tells; from the request of another run on, show nothing."""
        with suppress(ValueError):
            self.session = decode_session(self._decoders[SESSION](data).data)
            if self.session.result is None:
                self.run.replace(metadata[_PUBLISHED])
                if self.run.is_awaited:
                    self._discard()

    def _on_run(self, data: bytes, metadata: Mapping[str, Any]) -> bool:
        """Note the announcement of a run; return whether it replaces another one."""
        header = self._decoders[RUN](data)
        replaces = self.run.is_awaited or bool(self.run.name)
        if not self.run.announce(header.frame_id, time_ns(header.stamp), metadata[_PUBLISHED]):
            return False
        if replaces:
            self._discard()
        self._messages[RUN] = header
        self._changed.add(RUN)
        return replaces

    def _discard(self) -> None:
        self._messages.clear()
        self._forces.clear()
        self._changed.clear()

    def _on_message(self, topic: Topic, data: bytes) -> None:
        if self.run.is_awaited:
            return
        if topic in self._stamped:
            is_truth = topic.publisher == PLANT and bool(topic.period_ns)
            if not self.run.includes(stamp_of(data), is_truth=is_truth):
                return
        message = self._messages[topic] = self._decoders[topic](data)
        self._changed.add(topic)
        if topic is ACCEPTED_PUSH:
            at_s, (force, _) = stamp_ns(message) / SECOND_NS, push_forces(message)
            self._forces.append((at_s, message.header.frame_id, force))

    def __getitem__(self, topic: Topic) -> Any:
        """Return the newest message of a topic; None if there is none."""
        return self._messages.get(topic)

    def close(self) -> None:
        """Remove the subscriptions."""
        self.inbox.destroy_node()


def snapshot_of(newest: LatestMessages) -> Snapshot | None:
    """Return the state of the robot in the newest messages; None before its first pose."""
    body, ball = newest[PLANT_IMU], newest[PLANT_ODOM]
    if body is None or ball is None:
        return None
    duty, sonar, battery = newest[MOTOR_DUTY], newest[SONAR_RANGE], newest[BATTERY_STATE]
    state, lcd = newest[OPERATING_STATE], newest[LCD]
    estimates, sticks = newest[CONTROLLER_STATE], newest[GAMEPAD_JOY]
    is_in_control = state is not None and state.data not in OUT_OF_CONTROL
    return Snapshot(
        time=stamp_ns(ball) / SECOND_NS,
        position=odometry_position(ball),
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
