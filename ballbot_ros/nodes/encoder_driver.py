"""Driver of the motor encoders: true shaft angles in, whole degrees out."""

from __future__ import annotations

import sys
from typing import Any

from ballbot_ros.brick.encoder import Encoder
from ballbot_ros.messages.conversions import motor_angles, stamp_ns
from ballbot_ros.messages.devices import fill_encoders
from ballbot_ros.messages.topics import JOINT_STATES, PLANT_JOINT_STATES
from ballbot_ros.nodes.base import NO_SAMPLE, BallbotNode, run_node
from ballbot_ros.nodes.participation import Participation
from ballbot_ros.parameters import EncoderParameters


class EncoderDriver(BallbotNode[EncoderParameters]):
    """Answers every ``plant/joint_states`` with one ``joint_states`` of the same stamp."""

    def __init__(self, parameters: EncoderParameters | None = None) -> None:
        super().__init__(EncoderParameters, parameters)
        self._device = Encoder()
        self._output = self.output(JOINT_STATES)
        self._participation = Participation(self)
        self.listen(PLANT_JOINT_STATES, self._on_truth)

    def _on_truth(self, truth: Any) -> None:
        now = stamp_ns(truth)
        if not self._participation.includes(now):
            return
        try:
            reading = self._device.read(motor_angles(truth), now)
        except NO_SAMPLE as error:
            self.ignore(PLANT_JOINT_STATES, error)
            return
        fill_encoders(self._output.message, now, reading)
        self._output.send(now)
        self.sampled(now)


def main() -> None:
    """Run the node."""
    sys.exit(run_node(EncoderDriver))
