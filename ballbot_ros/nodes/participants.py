"""Finds out which participant of the lockstep is silent."""

from __future__ import annotations

from typing import Any

from ballbot_ros.messages.raw import stamp_of
from ballbot_ros.messages.topics import GAMEPAD_JOY, GYRO_IMU, JOINT_STATES, SONAR_RANGE
from ballbot_ros.nodes.base import BallbotNode
from ballbot_ros.parameters import CONTROLLER
from ballbot_ros.simulation.lockstep import InputGate

_INPUTS = (GYRO_IMU, JOINT_STATES, SONAR_RANGE, GAMEPAD_JOY)


class Participants:
    """Looks at the controller's inputs, but only in a silence: reading them costs time."""

    def __init__(self, node: BallbotNode) -> None:
        self._node = node
        self._gate = InputGate({topic.name: topic.period_ns for topic in _INPUTS})
        self._subscriptions: list[Any] = []

    def look(self) -> None:
        """Begin to read the inputs; the latched newest samples come at once."""
        if self._subscriptions:
            return
        for topic in _INPUTS:
            self._subscriptions.append(self._node.listen(topic, self._keep(topic.name), raw=True))

    def _keep(self, name: str) -> Any:
        return lambda data: self._gate.put(name, stamp_of(data), None)

    def silent(self, stamp_ns: int) -> str:
        """Return the nodes that lack an answer of that stamp."""
        missing = self._gate.missing(stamp_ns)
        nodes = [str(topic.publisher) for topic in _INPUTS if topic.name in missing]
        return ', '.join(nodes) or CONTROLLER
