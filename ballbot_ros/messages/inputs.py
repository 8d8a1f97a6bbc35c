"""The controller's inputs: their topics, and what the brick reads from each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ballbot_ros.brick.brick import DeviceInputs
from ballbot_ros.messages.conversions import decode_battery_mv, decode_sticks
from ballbot_ros.messages.devices import DEVICE_MESSAGES
from ballbot_ros.messages.topics import BATTERY_STATE, GAMEPAD_JOY, Topic


@dataclass(frozen=True)
class _Input:
    """A topic, the device input that it fills, and the function that reads its messages."""

    topic: Topic
    field: str
    read: Callable[[bytes], Any]


_CONTROLLER_INPUTS = (
    *(_Input(each.sample, each.device.field, each.reading) for each in DEVICE_MESSAGES),
    _Input(GAMEPAD_JOY, 'sticks', decode_sticks),
    _Input(BATTERY_STATE, 'battery_mv', decode_battery_mv),
)
_TOPIC_OF = {each.field: each.topic for each in _CONTROLLER_INPUTS}
_TOPICS = tuple(_TOPIC_OF[field] for field in DeviceInputs._fields)

INPUT_READERS: dict[Topic, Callable[[bytes], Any]] = {
    each.topic: each.read for each in _CONTROLLER_INPUTS
}
"""For each topic, the function that reads its messages."""


def device_inputs(sample: Callable[[Topic], Any]) -> DeviceInputs:
    """Return the inputs of a tick; `sample` gives the sample of a topic, None if it has none."""
    return DeviceInputs._make([sample(topic) for topic in _TOPICS])
