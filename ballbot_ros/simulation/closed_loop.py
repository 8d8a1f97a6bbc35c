"""Plant, devices and control program in one process, without messages.

It runs the same objects as the nodes, in the order that the lockstep imposes on the graph. Its
duties are therefore bit-identical to the graph's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

from ballbot_ros.brick.battery_monitor import battery_mv
from ballbot_ros.brick.brick import DeviceInputs, DeviceOutputs
from ballbot_ros.codegen.implementation import implementation_for
from ballbot_ros.controllers.interface import Program
from ballbot_ros.parameters import (
    ControllerParameters,
    GamepadParameters,
    ParameterSet,
    PlantParameters,
)
from ballbot_ros.plant.ground_truth import GroundTruth, Push
from ballbot_ros.plant.plant import Plant
from ballbot_ros.scenario.scenario import Scenario
from ballbot_ros.simulation.devices import DEVICES, AnyDevice, Read
from ballbot_ros.timing import BATTERY_PERIOD_NS, FIRST_TICK_NS, MILLISECOND_NS, SECOND_NS, TICK_NS
from ballbot_ros.world.world import World

_BATTERY, _STICKS = (DeviceInputs._fields.index(name) for name in ('battery_mv', 'sticks'))


class Tick(NamedTuple):
    """One tick of the loop: the true state, the device readings and the resulting outputs."""

    truth: GroundTruth
    wall_hit: bool
    inputs: DeviceInputs
    outputs: DeviceOutputs


class ExternalInputs(Protocol):
    """External inputs of a run, from a scenario or a recording."""

    def sticks_at(self, time: float) -> tuple[int, int]:
        """Return the sticks at `time` [s] from the start of the run."""
        ...

    def pushes_from(self, start_ns: int) -> Sequence[Push]:
        """Return the pushes of a run that begins at sim time `start_ns`."""
        ...


class _SampledDevice(NamedTuple):
    """A device, unpacked for the loop: its period [ns] and its index in the inputs of a tick."""

    period_ns: int
    input_index: int
    measured: Callable[[GroundTruth], Any]
    read: Read[Any, Any]

    @classmethod
    def of(
        cls, device: AnyDevice, parameters: ParameterSet, recorded: Mapping[int, Any]
    ) -> _SampledDevice:
        input_index = DeviceInputs._fields.index(device.field)
        read = device.make(parameters.of(device.parameters))
        if recorded:
            simulate = read

            def read(measured: Any, stamp_ns: int) -> Any:
                sample = recorded.get(stamp_ns)
                return simulate(measured, stamp_ns) if sample is None else sample

        return cls(device.period_ns, input_index, device.measured, read)


class ClosedLoop:
    """The whole robot: plant, devices and control program.

    Parameters
    ----------
    scenario : Scenario or ExternalInputs, or None
        Stick signals and pushes; None for a neutral stick and no push.
    program : Program or None
        The control program; None for the one that the controller's parameters select.
    recorded : mapping of str to mapping of int to object
        Recorded samples that replace those of a device, by its field and their stamps [ns].

    Attributes
    ----------
    program : Program
        The control program.
    world : World or None
        None for an unlimited floor without walls.

    Raises
    ------
    WorldError
        If the map can't be read, or the start position is blocked.
    """

    def __init__(
        self,
        parameters: ParameterSet,
        scenario: ExternalInputs | None = None,
        start_ns: int = FIRST_TICK_NS,
        program: Program | None = None,
        recorded: Mapping[str, Mapping[int, Any]] = MappingProxyType({}),
    ) -> None:
        self._start_ns = start_ns
        self.world = World.of(parameters.of(PlantParameters))
        self.plant = Plant(parameters.of(PlantParameters), self._start_ns, self.world)
        self._devices = [
            _SampledDevice.of(each, parameters, recorded.get(each.field, {})) for each in DEVICES
        ]
        self._no_samples = [None] * len(DeviceInputs._fields)
        self.program = program or implementation_for(parameters.of(ControllerParameters)).make()
        self._scenario = scenario or Scenario()
        self.pushes = self._scenario.pushes_from(self._start_ns)
        for push in self.pushes:
            self.plant.push(push)

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
        elapsed_ns = now_ns - self._start_ns
        samples: list[Any] = self._no_samples.copy()
        for period_ns, input_index, measured, read in self._devices:
            if now_ns % period_ns == 0:
                samples[input_index] = read(measured(truth), now_ns)
        if now_ns % BATTERY_PERIOD_NS == 0:
            samples[_BATTERY] = battery_mv(truth.battery_voltage)
        if now_ns % GamepadParameters.period_ns == 0:
            samples[_STICKS] = self._scenario.sticks_at(elapsed_ns * 1e-9)
        inputs = DeviceInputs._make(samples)
        outputs = self.program.tick(elapsed_ns // MILLISECOND_NS, now_ns // MILLISECOND_NS, inputs)
        self.plant.tick(*outputs.duty)
        return Tick(truth, wall_hit, inputs, outputs)
