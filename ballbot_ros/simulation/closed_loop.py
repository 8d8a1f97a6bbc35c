"""Plant, devices and control program in one process, without messages.

It runs the very objects that the nodes run, in the order in which the lockstep makes the graph
run them, so its duties equal the graph's to the bit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ballbot_ros.brick.battery_monitor import battery_mv
from ballbot_ros.brick.brick import DeviceInputs, DeviceOutputs
from ballbot_ros.brick.encoder import Encoder
from ballbot_ros.brick.gyro import Gyro
from ballbot_ros.brick.sonar import Sonar
from ballbot_ros.codegen.implementation import program_maker
from ballbot_ros.parameters import CONTROLLER, GYRO, PLANT, SONAR, ParameterSet
from ballbot_ros.plant.plant import Plant
from ballbot_ros.plant.truth import Truth
from ballbot_ros.scenario.scenario import Scenario
from ballbot_ros.simulation.timing import BATTERY_NS, FIRST_TICK_NS, MILLISECOND_NS, SLOW_NS


class Tick(NamedTuple):
    """One tick of the loop: the truth, what the devices made of it, and the answer."""

    truth: Truth
    inputs: DeviceInputs
    outputs: DeviceOutputs


class ClosedLoop:
    """The whole robot.

    Parameters
    ----------
    parameters : ParameterSet
    scenario : Scenario or None
        Stick signals and pushes; None for a neutral stick and no push.

    Attributes
    ----------
    plant : Plant
    program : Program
        What the controller's parameter `implementation` names
    """

    def __init__(self, parameters: ParameterSet, scenario: Scenario | None = None) -> None:
        self._start_ns = FIRST_TICK_NS
        self.plant = Plant(parameters.values(PLANT), self._start_ns)
        self._gyro = Gyro(parameters.values(GYRO))
        self._encoder = Encoder()
        self._sonar = Sonar(parameters.values(SONAR))
        self.program = program_maker(parameters.values(CONTROLLER))()
        self._scenario = scenario or Scenario()
        for push in self._scenario.pushes_from(self._start_ns):
            self.plant.push(push)

    def tick(self) -> Tick:
        """Run one tick: sample the devices, run the tasks due, move the plant by 4 ms."""
        truth = self.plant.truth()
        now = truth.stamp_ns
        slow = now % SLOW_NS == 0
        elapsed = now - self._start_ns
        inputs = DeviceInputs(
            gyro=self._gyro.read(truth.psi_rate, now),
            revolutions=self._encoder.read(truth.motor_angle),
            sonar_cm=self._sonar.read(math.inf, now) if slow else None,
            battery_mv=battery_mv(truth.battery_voltage) if now % BATTERY_NS == 0 else None,
            sticks=self._scenario.sticks_at(elapsed * 1e-9) if slow else None,
        )
        outputs = self.program.tick(elapsed // MILLISECOND_NS, now // MILLISECOND_NS, inputs)
        self.plant.tick(*outputs.duty)
        return Tick(truth, inputs, outputs)
