"""Plant, devices and control program in one process, without messages.

It runs the same objects as the nodes, in the order that the lockstep imposes on the graph. Its
duties are therefore bit-identical to the graph's.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

from ballbot_ros.controllers.codegen.implementation import implementation_for
from ballbot_ros.controllers.interface import Program
from ballbot_ros.engine.brick_tasks import BrickTasks
from ballbot_ros.engine.devices import numbers_of
from ballbot_ros.engine.plant import Plant
from ballbot_ros.engine.run import longest_age, robot_constants, sample
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.parameters import (
    DEVICES,
    ControllerParameters,
    ParameterSet,
    PlantParameters,
    SonarParameters,
)
from ballbot_ros.parameters.timing import FIRST_TICK_NS, SECOND_NS, SLOW_PERIOD_NS, TICK_NS
from ballbot_ros.robot.brick.bluetooth import NEUTRAL
from ballbot_ros.robot.brick.brick import DeviceInputs, DeviceOutputs, from_numbers
from ballbot_ros.robot.brick.fault_effects import fault_row, packet_time
from ballbot_ros.robot.brick.faults import all_faults, late_steps
from ballbot_ros.robot.plant.ground_truth import GroundTruth, Push
from ballbot_ros.robot.world.sonar_beam import check_rays
from ballbot_ros.robot.world.world import World


class ExternalInputs(Protocol):
    """External inputs of a run, from a scenario or a recording."""

    def sticks_at(self, time: float) -> tuple[int, int]:
        """Return the sticks at `time` [s] from the start of the run."""
        ...

    def pushes_from(self, start_ns: int) -> Sequence[Push]:
        """Return the pushes of a run that begins at sim time `start_ns`."""
        ...


class Tick(NamedTuple):
    """One tick of the loop: the true state, the device readings and the resulting outputs."""

    truth: GroundTruth
    wall_hit: bool
    inputs: DeviceInputs
    outputs: DeviceOutputs


class ClosedLoop:
    """The whole robot: plant, devices and control program.

    It raises WorldError if the map can't be read, or the start position is blocked. Without a map,
    `world` is None.

    Parameters
    ----------
    scenario : Scenario or ExternalInputs, or None
        Stick signals and pushes; None for a neutral stick and no push.
    start_ns : int
        Sim time of the first tick [ns].
    program : Program or None
        The control program; None for the one that the controller's parameters select.
    recorded : mapping of str to mapping of int to object
        Recorded samples that replace those of a device, by its field and their stamps [ns].
    """

    def __init__(
        self,
        parameters: ParameterSet,
        scenario: ExternalInputs | None = None,
        start_ns: int = FIRST_TICK_NS,
        program: Program | None = None,
        recorded: Mapping[str, Mapping[int, Any]] = MappingProxyType({}),
    ) -> None:
        self.start_ns = start_ns
        self.world = World.of(parameters.of(PlantParameters))
        faults = all_faults(parameters.of)
        row = fault_row(faults, start_ns)
        self.plant = Plant(parameters.of(PlantParameters), start_ns, self.world, row)
        check_rays(parameters.of(SonarParameters))
        devices = (parameters.of(each) for each in DEVICES)
        self._constants = robot_constants(self.plant.constants, *map(numbers_of, devices))
        self.plant.keep_steps(longest_age(self._constants) + late_steps(faults))
        self._recorded = {name: samples for name, samples in recorded.items() if samples}
        self._scenario = scenario or Scenario()
        self.pushes = self._scenario.pushes_from(start_ns)
        for push in self.pushes:
            self.plant.push(push)
        settings = parameters.of(ControllerParameters)
        self.program = program or implementation_for(settings).make()
        self.tasks = BrickTasks(settings, start_ns)

    def copy(self, program: Program, scenario: ExternalInputs) -> ClosedLoop:
        """Return a loop in the same state, which goes on by itself.

        It gets a copy of the program, and the sticks of `scenario` from then on; pushes remain.
        """
        twin = copy(self)
        twin.plant, twin.tasks, twin.program = self.plant.copy(), self.tasks.copy(), program
        twin._scenario = scenario
        return twin

    def sample(self) -> DeviceInputs:
        """Return the samples of the devices and sticks that are due now."""
        plant, now_ns, sticks = self.plant, self.plant.time_ns, NEUTRAL
        if now_ns % SLOW_PERIOD_NS == 0:
            sent_ns = packet_time(plant.faults, now_ns, plant.constants.key)
            sticks = self._scenario.sticks_at((sent_ns - self.start_ns) * 1e-9)
        inputs = from_numbers(
            sample(
                self._constants, plant.state, *sticks, plant.kept_steps, plant.sides, plant.faults
            )
        )
        if self._recorded:
            inputs = inputs._replace(
                **{
                    name: samples[now_ns]
                    for name, samples in self._recorded.items()
                    if now_ns in samples
                }
            )
        return inputs

    def ticks(self, duration: float) -> Iterator[Tick]:
        """Run for `duration` [s], or until a wall hit ends the run; yield each tick."""
        for _ in range(round(duration * SECOND_NS) // TICK_NS):
            if self.plant.stopped:
                return
            yield self.tick()

    def tick(self) -> Tick:
        """Run one tick: sample the devices, run the due tasks, advance the plant by 4 ms."""
        truth, wall_hit = self.plant.truth(), self.plant.wall_hit
        now_ns = truth.stamp_ns
        inputs = self.sample()
        outputs = self.tasks.tick(self.program, now_ns, inputs)
        self.plant.tick(*outputs.duty, outputs.delay_ns)
        return Tick(truth, wall_hit, inputs, outputs)
