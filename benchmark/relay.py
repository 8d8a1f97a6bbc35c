"""A bare relay graph: the robot's processes, topics and lockstep, without the robot.

It has the same nodes, each as a process, their topics with the same types, QoS and periods, the
same executor, and the same gating by stamps, and they publish bytes, too. But messages are encoded
once, and then only their stamps change; nothing is simulated, computed or written; and stamps are
read from messages decoded by rclpy. It shows the performance of a plain rclpy graph of this shape
on this machine.
"""

from __future__ import annotations

import json
import struct
import sys
import time
from collections.abc import Callable
from typing import Any

import click
import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message

from ballbot_ros.messages.conversions import MOTOR_NAMES, STATE_NAMES, time_ns
from ballbot_ros.messages.devices import DEVICE_MESSAGES
from ballbot_ros.messages.inputs import INPUT_READERS
from ballbot_ros.messages.raw import has_stamp, stamp_of
from ballbot_ros.messages.topics import (
    BLUETOOTH_TX,
    CONTROLLER_STATE,
    GAMEPAD_JOY,
    HISTORY,
    JOINT_STATES,
    MOTOR_DUTY,
    PLANT_JOINT_STATES,
    RECORDER_ACK,
    TOPICS,
    Topic,
)
from ballbot_ros.nodes.base import spin
from ballbot_ros.nodes.middleware import prepare_middleware
from ballbot_ros.nodes.topic_publisher import reliable_qos
from ballbot_ros.parameters import CONTROLLER, GAMEPAD, NODES, PLANT, RECORDER
from ballbot_ros.simulation.lockstep import InputGate
from ballbot_ros.stop_request import StopRequest
from ballbot_ros.timing import (
    BATTERY_PERIOD_NS,
    FIRST_TICK_NS,
    MAX_LEAD_TICKS,
    SECOND_NS,
    TICK_NS,
)

ACK_PERIOD_S = 5e-3

STAMP, STAMP_OFFSET = struct.Struct('<iI'), 4
"""Seconds and nanoseconds, and their place in a serialised message."""

DRIVERS = {each.device.parameters.node: (each.truth, each.sample) for each in DEVICE_MESSAGES} | {
    GAMEPAD: (PLANT_JOINT_STATES, GAMEPAD_JOY)
}
"""The input and output topics of each driver."""

LOG_PERIOD_NS = BATTERY_PERIOD_NS
"""Period of the log packets, equal to the battery's by default."""

CONTENT: dict[Topic, dict[str, Any]] = {
    PLANT_JOINT_STATES: {
        'name': MOTOR_NAMES,
        'position': [0.5] * 2,
        'velocity': [0.5] * 2,
        'effort': [0.5] * 2,
    },
    JOINT_STATES: {'name': MOTOR_NAMES, 'position': [0.5] * 2},
    CONTROLLER_STATE: {'name': STATE_NAMES, 'position': [0.5] * 6, 'velocity': [0.5] * 6},
    GAMEPAD_JOY: {'axes': [0.5] * 2},
    BLUETOOTH_TX: {'data': bytes(32)},
}
"""Fields that give messages of variable length the same length as the robot's."""


class Relay:
    """A stand-in for a node of the robot.

    Attributes
    ----------
    node : rclpy.node.Node
    done : rclpy.Future
        Completed when the process may end.
    """

    def __init__(self, name: str, *, use_sim_time: bool = False) -> None:
        sim_time = Parameter('use_sim_time', value=use_sim_time)
        self.node = Node(name, parameter_overrides=[sim_time])
        self.done = rclpy.Future()

    def finish(self) -> None:
        """Let the process end."""
        if not self.done.done():
            self.done.set_result(None)

    def sender(self, topic: Topic) -> Callable[[int], None]:
        """Return a function that publishes on `topic` with a stamp [ns]."""
        publisher = self.node.create_publisher(
            topic.message_class, topic.name, reliable_qos(HISTORY, latched=True)
        )
        data = bytearray(serialize_message(topic.message_class(**CONTENT.get(topic, {}))))
        is_stamped = has_stamp(topic.type_name)

        def send(now_ns: int) -> None:
            if is_stamped:
                STAMP.pack_into(data, STAMP_OFFSET, *divmod(now_ns, SECOND_NS))
            publisher.publish(bytes(data))

        return send

    def subscribe(self, topic: Topic, on_stamp: Callable[[int], None]) -> None:
        """Subscribe to `topic`, for the stamps [ns] of its messages."""
        self.node.create_subscription(
            topic.message_class,
            topic.name,
            lambda message: on_stamp(time_ns(time_in(message))),
            reliable_qos(1, latched=True),
        )


def time_in(message: Any) -> Any:
    """Return the time field of a message, or None."""
    if hasattr(message, 'header'):
        return message.header.stamp
    return getattr(message, 'stamp', getattr(message, 'clock', None))


class PlantRelay(Relay):
    """Publishes the plant's messages of a tick, and waits for the duty with the same stamp."""

    def __init__(self, ticks: int) -> None:
        super().__init__(PLANT)
        self._remaining = ticks
        self._factor_of = ticks * TICK_NS / SECOND_NS
        self._outputs = [
            (self.sender(topic), topic.period_ns)
            for topic in TOPICS
            if topic.publisher == PLANT and topic.period_ns
        ]
        self._now_ns = FIRST_TICK_NS
        self._answered = False
        self._ack_ns: int | None = None
        self._begun_at: float | None = None
        self._round_trips: list[float] = []
        self.subscribe(MOTOR_DUTY, self._on_duty)
        self.subscribe(RECORDER_ACK, self._on_ack)
        self._publish()

    def _publish(self) -> None:
        for send, period_ns in self._outputs:
            if self._now_ns % period_ns == 0:
                send(self._now_ns)
        self._asked_at = time.monotonic()

    def _on_duty(self, stamp_ns: int) -> None:
        if stamp_ns == self._now_ns:
            self._round_trips.append(time.monotonic() - self._asked_at)
            self._answered = True
            self._advance()

    def _on_ack(self, stamp_ns: int) -> None:
        self._ack_ns = stamp_ns
        self._advance()

    def _advance(self) -> None:
        if not self._answered or self._ack_ns is None:
            return
        if self._now_ns - self._ack_ns > MAX_LEAD_TICKS * TICK_NS:
            return
        if self._begun_at is None:
            self._begun_at = time.monotonic()
        self._remaining -= 1
        if self._remaining == 0:
            self._wall = time.monotonic() - self._begun_at
            self.finish()
            return
        self._now_ns += TICK_NS
        self._answered = False
        self._publish()

    def result(self) -> dict[str, Any]:
        """Return the measurements in the form of ``ballbot run --json``."""
        # Omit the first answer, which had to wait for the start of all processes.
        trips = np.array(self._round_trips[1:]) * 1e3
        return {
            'real_time_factor': self._factor_of / self._wall,
            'round_trip_ms': {
                'p50': float(np.percentile(trips, 50)),
                'p99': float(np.percentile(trips, 99)),
                'max': float(trips.max()),
            },
        }


class DriverRelay(Relay):
    """Answers the plant's messages whose stamps are multiples of the sample's period."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        truth, sample = DRIVERS[name]
        send = self.sender(sample)

        def answer(stamp_ns: int) -> None:
            if stamp_ns % sample.period_ns == 0:
                send(stamp_ns)

        self.subscribe(truth, answer)


class ControllerRelay(Relay):
    """Answers when every due input has arrived."""

    def __init__(self) -> None:
        super().__init__(CONTROLLER, use_sim_time=True)
        self._gate = InputGate({topic.name: topic.period_ns for topic in INPUT_READERS})
        self._next_ns = FIRST_TICK_NS
        self._duty = self.sender(MOTOR_DUTY)
        self._state = self.sender(CONTROLLER_STATE)
        self._log = self.sender(BLUETOOTH_TX)
        for topic in INPUT_READERS:
            self.subscribe(topic, self._input_callback(topic.name))

    def _input_callback(self, name: str) -> Callable[[int], None]:
        def receive(stamp_ns: int) -> None:
            now = self._next_ns
            if self._gate.put(name, stamp_ns, None) and self._gate.ready(now):
                self._next_ns += TICK_NS
                self._duty(now)
                self._state(now)
                if now % LOG_PERIOD_NS == 0:
                    self._log(now)

        return receive


class RecorderRelay(Relay):
    """Receives every message, and acknowledges complete ticks."""

    def __init__(self) -> None:
        super().__init__(RECORDER)
        self._newest_ns = {topic: 0 for topic in TOPICS if topic.period_ns == TICK_NS}
        self._acked_ns = 0
        self._ack = self.sender(RECORDER_ACK)
        for topic in TOPICS:
            self.node.create_subscription(
                topic.message_class,
                topic.name,
                self._callback(topic),
                reliable_qos(HISTORY, latched=True),
                raw=True,
            )
        self.node.create_timer(ACK_PERIOD_S, self._acknowledge)

    def _callback(self, topic: Topic) -> Callable[[bytes], None]:
        def keep_stamp(data: bytes) -> None:
            self._newest_ns[topic] = stamp_of(data)

        return keep_stamp if topic in self._newest_ns else lambda data: None

    def _acknowledge(self) -> None:
        complete = min(self._newest_ns.values())
        if complete > self._acked_ns:
            self._acked_ns = complete
            self._ack(complete)


def make_relay(name: str, ticks: int) -> Relay:
    """Return the stand-in for the node of that name."""
    if name == PLANT:
        return PlantRelay(ticks)
    if name == CONTROLLER:
        return ControllerRelay()
    if name == RECORDER:
        return RecorderRelay()
    return DriverRelay(name)


@click.command()
@click.argument('name', type=click.Choice(NODES))
@click.option('--ticks', type=click.IntRange(3), default=2500, show_default=True)
def main(name: str, ticks: int) -> None:
    """Run the stand-in for the node NAME; the plant's prints its measurements at the end."""
    prepare_middleware()
    rclpy.init(args=[], signal_handler_options=rclpy.SignalHandlerOptions.NO)
    relay = make_relay(name, ticks)
    with StopRequest() as stop:
        spin([relay.node], relay.done, stop)
    if isinstance(relay, PlantRelay) and not stop.signal:
        print(json.dumps(relay.result()))
    relay.node.destroy_node()
    rclpy.try_shutdown()
    sys.exit(128 + stop.signal if stop.signal else 0)


if __name__ == '__main__':
    main()
