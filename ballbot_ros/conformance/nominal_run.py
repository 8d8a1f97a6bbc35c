"""The messages of the graph around a node under test."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from ballbot_ros.messages.outputs import Send
from ballbot_ros.messages.run_messages import RunMessages
from ballbot_ros.messages.topics import BATTERY_STATE, RUN, Topic
from ballbot_ros.parameters import MAX_DELAY_MS, PLANT, ParameterSet
from ballbot_ros.simulation.closed_loop import ClosedLoop

START_PITCH = 0.07
"""Pitch at the start [rad], so that a controller has something to do."""

Message = tuple[Topic, bytes]


class TickMessages(NamedTuple):
    """All messages of a tick but those of the node under test, in causal order.

    `battery` is the newest message about the battery, which the plant repeats when it asks again.
    """

    stamp_ns: int
    messages: tuple[Message, ...]
    battery: Message

    def repeated(self) -> tuple[Message, ...]:
        """Return the messages with which the plant asks again."""
        others = [each for each in self.messages if each[0] is not BATTERY_STATE]
        clock, *rest = others
        return (clock, self.battery, *rest)


def nominal_run(role: str, start_ns: int) -> Iterator[TickMessages]:
    """Yield the ticks of a run that begins at `start_ns` [ns], in which the robot balances.

    The messages of the `role` under test are left out. The others do not depend on its answers.
    """
    parameters = ParameterSet()
    parameters.set(PLANT, 'start_pitch_x', START_PITCH)
    loop = ClosedLoop(parameters, start_ns=start_ns)
    # The node may be a driver with any dead time, of whole physics steps of 1 ms.
    loop.plant.keep_steps(2 * MAX_DELAY_MS)
    sent: list[Message] = []

    def make(topic: Topic) -> Send:
        def send(stamp_ns: int, data: bytes) -> None:
            if topic.publisher != role and topic is not RUN:
                sent.append((topic, data))

        return send

    messages = RunMessages(make, parameters)
    messages.begin(start_ns, loop.world, loop.pushes)
    battery: Message = (BATTERY_STATE, b'')
    while True:
        tick = loop.tick()
        messages.tick(tick, loop.program)
        messages.plant.send_unrecorded(tick.truth)
        battery = next((each for each in sent if each[0] is BATTERY_STATE), battery)
        yield TickMessages(tick.truth.stamp_ns, tuple(sent), battery)
        sent.clear()
