"""Driver of the two gyros: true body rates in, readings out."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

from ballbot_ros.brick.gyro import Gyro
from ballbot_ros.messages.conversions import body_rates, fill_gyro, stamp_ns
from ballbot_ros.messages.topics import GYRO_IMU, PLANT_IMU
from ballbot_ros.nodes.base import BallbotNode, run_node
from ballbot_ros.parameters import GYRO


class GyroDriver(BallbotNode):
    """Answers every ``plant/imu`` with one ``gyro`` of the same stamp."""

    def __init__(self, values: Mapping[str, Any] | None = None) -> None:
        super().__init__(GYRO, values)
        self._device = Gyro(self.values)
        self._output = self.output(GYRO_IMU)
        self.listen(PLANT_IMU, self._on_truth)

    def _on_truth(self, truth: Any) -> None:
        now = stamp_ns(truth)
        fill_gyro(self._output.message, now, self._device.read(body_rates(truth), now))
        self._output.send(now)
        self.sampled(now)


def main() -> None:
    """Run the node."""
    sys.exit(run_node(GyroDriver))


if __name__ == '__main__':
    main()
