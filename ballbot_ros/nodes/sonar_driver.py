"""Driver of the ultrasonic sensor: true pose in, whole centimetres out."""

from __future__ import annotations

import sys
from typing import Any

from ballbot_ros.brick.sonar import Sonar
from ballbot_ros.messages.conversions import ball_position
from ballbot_ros.messages.devices import fill_sonar
from ballbot_ros.messages.raw import decoder, stamp_of
from ballbot_ros.messages.topics import PLANT_ODOM, SONAR_RANGE
from ballbot_ros.nodes.base import NO_SAMPLE, BallbotNode, run_node
from ballbot_ros.nodes.participation import Participation
from ballbot_ros.parameters import SonarParameters
from ballbot_ros.simulation.lockstep import Run
from ballbot_ros.simulation.timing import SLOW_NS
from ballbot_ros.world.sonar_beam import SonarBeam


class SonarDriver(BallbotNode[SonarParameters]):
    """Answers ``plant/odom`` at multiples of 20 ms with one ``sonar`` of the same stamp."""

    def __init__(self, parameters: SonarParameters | None = None) -> None:
        super().__init__(SonarParameters, parameters)
        self._device = Sonar(self.parameters)
        self._beam = SonarBeam(self.parameters)
        self._decode = decoder(PLANT_ODOM.type_name)
        self._output = self.output(SONAR_RANGE)
        self._participation = Participation(self, self._on_run)
        self.listen(PLANT_ODOM, self._on_truth, raw=True)

    def check(self, parameters: SonarParameters) -> None:
        """Find out whether the sensor can look at such a map."""
        SonarBeam(parameters)

    def _on_run(self, run: Run) -> None:
        self._device = Sonar(self.parameters)
        self._beam = SonarBeam(self.parameters)

    def _on_truth(self, truth: Any) -> None:
        now = stamp_of(truth)
        if now % SLOW_NS or not self._participation.includes(now):
            return
        try:
            distance = self._beam.distance_m(ball_position(self._decode(truth)))
            reading = self._device.read(distance, now)
        except NO_SAMPLE as error:
            self.ignore(PLANT_ODOM, error)
            return
        fill_sonar(self._output.message, now, reading)
        self._output.send(now)
        self.sampled(now)


def main() -> None:
    """Run the node."""
    sys.exit(run_node(SonarDriver))
