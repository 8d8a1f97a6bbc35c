"""The roles of a graph without recorder as processes that pass messages by Unix datagram sockets.

Each process waits for a message, answers it, and waits again. The messages are as long as the
robot's, but only their stamps change; nothing is simulated or computed, and nothing can be lost. So
it is the lower limit of what a graph of this shape costs in Python on this machine.
"""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import click

from ballbot_ros.lockstep.lockstep import InputGate
from ballbot_ros.parameters import CONTROLLER, GAMEPAD, NODES, PLANT, RECORDER
from ballbot_ros.parameters.timing import FIRST_TICK_NS, SECOND_NS, TICK_NS
from ballbot_ros.recording.messages.devices import DEVICE_MESSAGES, INPUT_READERS
from ballbot_ros.recording.messages.topics import (
    CLOCK,
    MOTOR_DUTY,
    PLANT_JOINT_STATES,
    TOPICS,
    Topic,
)

ROLES = tuple(role for role in NODES if role != RECORDER)

TRUTHS = {each.device.parameters.node: each.truth for each in DEVICE_MESSAGES} | {
    GAMEPAD: PLANT_JOINT_STATES
}
"""The plant's topic that each driver answers."""
SAMPLES = {topic.publisher: topic for topic in INPUT_READERS if topic.publisher in TRUTHS}

MESSAGE_BYTES = {
    'sensor_msgs/msg/Imu': 328,
    'nav_msgs/msg/Odometry': 728,
    'sensor_msgs/msg/BatteryState': 100,
    'rosgraph_msgs/msg/Clock': 12,
}
"""Lengths of the robot's messages of some types [byte]."""
OTHER_BYTES = 150
MAX_BYTES = 1024
START_S = 30.0


class Post:
    """The socket of a role, whose file is in a common folder."""

    def __init__(self, folder: Path, role: str) -> None:
        self._folder = folder
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(folder / role))

    def await_others(self) -> None:
        """Wait for the other roles."""
        deadline_s = time.monotonic() + START_S
        while not all((self._folder / role).exists() for role in ROLES):
            if time.monotonic() > deadline_s:
                raise click.ClickException('not all processes have started')
            time.sleep(0.01)

    def sender(self, topic: Topic, role: str) -> Callable[[int], None]:
        """Return a function that sends a message of a topic with a stamp [ns] to a role."""
        head = bytes([TOPICS.index(topic)])
        body = bytes(MESSAGE_BYTES.get(topic.type_name, OTHER_BYTES) - 8)
        address = str(self._folder / role)

        def send(now_ns: int) -> None:
            self._socket.sendto(head + now_ns.to_bytes(8, 'little') + body, address)

        return send

    def received(self) -> Iterator[tuple[Topic, int]]:
        """Yield the topics and stamps [ns] of the messages as they arrive."""
        while True:
            data = self._socket.recv(MAX_BYTES)
            yield TOPICS[data[0]], int.from_bytes(data[1:9], 'little')


def run_plant(post: Post, ticks: int) -> float:
    """Send the truth of each tick, and wait for its duty; return the real-time factor."""
    outputs = [
        (SAMPLES[role].period_ns, post.sender(topic, role)) for role, topic in TRUTHS.items()
    ]
    outputs += [
        (topic.period_ns, post.sender(topic, CONTROLLER))
        for topic in (CLOCK, *INPUT_READERS)
        if topic.publisher == PLANT
    ]
    post.await_others()
    received = post.received()
    begun_s = time.monotonic()
    for number in range(ticks):
        now_ns = FIRST_TICK_NS + number * TICK_NS
        for period_ns, send in outputs:
            if now_ns % period_ns == 0:
                send(now_ns)
        while next(received) != (MOTOR_DUTY, now_ns):
            pass
    return ticks * TICK_NS / SECOND_NS / (time.monotonic() - begun_s)


def run_driver(post: Post, role: str) -> None:
    """Answer each truth with a sample."""
    send = post.sender(SAMPLES[role], CONTROLLER)
    for _, now_ns in post.received():
        send(now_ns)


def run_controller(post: Post) -> None:
    """Answer when every due input has arrived."""
    gate = InputGate({topic.name: topic.period_ns for topic in INPUT_READERS})
    send_duty, next_ns = post.sender(MOTOR_DUTY, PLANT), FIRST_TICK_NS
    for topic, now_ns in post.received():
        if topic is CLOCK or not gate.put(topic.name, now_ns, None):
            continue
        if gate.ready(next_ns):
            send_duty(next_ns)
            next_ns += TICK_NS


@click.command()
@click.argument('role', type=click.Choice(ROLES))
@click.argument('folder', type=click.Path(path_type=Path))
@click.option('--ticks', type=click.IntRange(1), default=2500, show_default=True)
def main(role: str, folder: Path, ticks: int) -> None:
    """Run a ROLE, which meets the others in FOLDER; the plant prints its speed at the end."""
    post = Post(folder, role)
    if role == PLANT:
        print(json.dumps({'real_time_factor': run_plant(post, ticks)}))
    elif role == CONTROLLER:
        run_controller(post)
    else:
        run_driver(post, role)


if __name__ == '__main__':
    main()
