"""Plant, devices and control program in one process, without messages.

It runs the same objects as the nodes, in the order that the lockstep imposes on the graph. Its
duties are therefore bit-identical to the graph's.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from ballbot_ros.brick.brick import DeviceInputs, DeviceOutputs
from ballbot_ros.codegen.implementation import implementation_for
from ballbot_ros.controllers.interface import Program
from ballbot_ros.parameters import ControllerParameters, ParameterSet
from ballbot_ros.plant.ground_truth import GroundTruth
from ballbot_ros.simulation.robot import ExternalInputs, Robot
from ballbot_ros.timing import FIRST_TICK_NS, MILLISECOND_NS, SECOND_NS, TICK_NS


class Tick(NamedTuple):
    """One tick of the loop: the true state, the device readings and the resulting outputs."""

    truth: GroundTruth
    wall_hit: bool
    inputs: DeviceInputs
    outputs: DeviceOutputs


class ClosedLoop(Robot):
    """The whole robot: plant, devices and control program.

    The other parameters and attributes, and the errors, are those of :class:`Robot`.

    Parameters
    ----------
    program : Program or None
        The control program; None for the one that the controller's parameters select.

    Attributes
    ----------
    program : Program
        The control program.
    """

    def __init__(
        self,
        parameters: ParameterSet,
        scenario: ExternalInputs | None = None,
        start_ns: int = FIRST_TICK_NS,
        program: Program | None = None,
        recorded: Mapping[str, Mapping[int, Any]] = MappingProxyType({}),
    ) -> None:
        super().__init__(parameters, scenario, start_ns, recorded)
        self.program = program or implementation_for(parameters.of(ControllerParameters)).make()

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
        elapsed_ms = (now_ns - self.start_ns) // MILLISECOND_NS
        outputs = self.program.tick(elapsed_ms, now_ns // MILLISECOND_NS, inputs)
        self.plant.tick(*outputs.duty)
        return Tick(truth, wall_hit, inputs, outputs)
