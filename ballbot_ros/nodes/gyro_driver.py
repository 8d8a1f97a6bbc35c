"""Driver of the two gyros: true body rates in, readings out."""

from __future__ import annotations

import sys
from typing import Any

from ballbot_ros.brick.gyro import Gyro
from ballbot_ros.messages.conversions import body_rates, stamp_ns
from ballbot_ros.messages.devices import fill_gyro
from ballbot_ros.messages.topics import GYRO_IMU, PLANT_IMU
from ballbot_ros.nodes.base import NO_SAMPLE, BallbotNode, run_node
from ballbot_ros.nodes.participation import Participation
from ballbot_ros.parameters import GyroParameters
from ballbot_ros.simulation.lockstep import Run


class GyroDriver(BallbotNode[GyroParameters]):
    """Answers every ``plant/imu`` with one ``gyro`` of the same stamp."""

    def __init__(self, parameters: GyroParameters | None = None) -> None:
        super().__init__(GyroParameters, parameters)
        self._device = Gyro(self.parameters)
        self._output = self.output(GYRO_IMU)
        self._participation = Participation(self, self._on_run)
        self.listen(PLANT_IMU, self._on_truth)

    def _on_run(self, run: Run) -> None:
        self._device = Gyro(self.parameters)

    def _on_truth(self, truth: Any) -> None:
        now = stamp_ns(truth)
        if not self._participation.includes(now):
            return
        try:
            reading = self._device.read(body_rates(truth), now)
        except NO_SAMPLE as error:
            self.ignore(PLANT_IMU, error)
            return
        fill_gyro(self._output.message, now, reading)
        self._output.send(now)
        self.sampled(now)


def main() -> None:
    """Run the node."""
    sys.exit(run_node(GyroDriver))
