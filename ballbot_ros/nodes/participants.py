"""Finds out which participant of the lockstep is silent."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node

from ballbot_ros.messages.raw import decoder, stamp_of
from ballbot_ros.messages.topics import (
    DIAGNOSTICS,
    GAMEPAD_JOY,
    GYRO_IMU,
    JOINT_STATES,
    SONAR_RANGE,
    Topic,
)
from ballbot_ros.nodes.base import offered_qos
from ballbot_ros.nodes.inbox import hidden_node, raw_subscription, taken
from ballbot_ros.parameters import CONTROLLER, NODES, RECORDER
from ballbot_ros.simulation.lockstep import InputGate

_INPUTS = (GYRO_IMU, JOINT_STATES, SONAR_RANGE, GAMEPAD_JOY)
_DEPTH = 20


class Participants:
    """Looks at who is there, but only in a silence: reading costs time.

    Every node latches its newest messages. Who lives sends them to a subscription that is new; a
    process that has been killed or stopped does not, whatever of its last tick has still come
    and to whom.

    Parameters
    ----------
    node : rclpy.node.Node
        In whose namespace the topics are.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._inbox: Node | None = None
        self._subscriptions: dict[Topic, Any] = {}
        self._decode_diagnostics = decoder(DIAGNOSTICS.type_name)
        self._forget()

    def _forget(self) -> None:
        self._heard: set[str] = set()
        self._gate = InputGate({topic.name: topic.period_ns for topic in _INPUTS})

    def look(self) -> None:
        """Take what comes; the first time in a silence, begin to listen."""
        if self._inbox is None:
            self._listen()
        for topic, subscription in self._subscriptions.items():
            for data, _ in taken(subscription):
                self._hear(topic, data)

    def _listen(self) -> None:
        name = f'{self._node.get_name()}_participants'
        self._inbox = hidden_node(name, self._node.get_namespace())
        self._subscriptions = {
            topic: raw_subscription(self._inbox, topic, offered_qos(_DEPTH))
            for topic in (*_INPUTS, DIAGNOSTICS)
        }

    def _hear(self, topic: Topic, data: bytes) -> None:
        if topic is DIAGNOSTICS:
            for status in self._decode_diagnostics(data).status:
                self._heard.add(status.name.partition(':')[0])
        else:
            self._heard.add(str(topic.publisher))
            self._gate.put(topic.name, stamp_of(data), None)

    def rest(self) -> None:
        """Listen no longer: the silence is over."""
        if self._inbox is not None:
            self._inbox.destroy_node()
            self._inbox = None
            self._forget()

    def silent(self, stamp_ns: int, *, recorder: bool) -> str:
        """Return who is silent, after a look.

        Parameters
        ----------
        stamp_ns : int
            The tick that is not answered [ns].
        recorder : bool
            Whether it is the recorder's answer that lacks, not the controller's.
        """
        last = RECORDER if recorder else CONTROLLER
        inputs = {topic.name: str(topic.publisher) for topic in _INPUTS}
        unheard = {*inputs.values(), CONTROLLER, last} - self._heard
        lost = [name for name in NODES if name in unheard]
        late = [inputs[name] for name in self._gate.missing(stamp_ns)]
        return ', '.join(lost or late) or last
