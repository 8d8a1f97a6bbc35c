"""The robot without its control program: plant, devices and external inputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

from ballbot_ros.brick.battery_monitor import battery_mv
from ballbot_ros.brick.brick import DeviceInputs
from ballbot_ros.parameters import GamepadParameters, ParameterSet, PlantParameters
from ballbot_ros.plant.ground_truth import GroundTruth, Push
from ballbot_ros.plant.plant import Plant
from ballbot_ros.scenario.scenario import Scenario
from ballbot_ros.simulation.devices import DEVICES, AnyDevice, Read
from ballbot_ros.timing import BATTERY_PERIOD_NS, FIRST_TICK_NS
from ballbot_ros.world.world import World

_BATTERY, _STICKS = (DeviceInputs._fields.index(name) for name in ('battery_mv', 'sticks'))


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
    sampled: Callable[[GroundTruth], Any]
    read: Read[Any, Any]

    @classmethod
    def of(
        cls, device: AnyDevice, parameters: ParameterSet, recorded: Mapping[int, Any]
    ) -> _SampledDevice:
        input_index = DeviceInputs._fields.index(device.field)
        values = parameters.of(device.parameters)
        read = device.make(values)
        if recorded:
            simulate = read

            def read(measured: Any, stamp_ns: int) -> Any:
                sample = recorded.get(stamp_ns)
                return simulate(measured, stamp_ns) if sample is None else sample

        return cls(device.period_ns, input_index, device.sampled(values), read)


class Robot:
    """Plant, devices and external inputs; whoever computes the duties moves it by `plant.tick`.

    Parameters
    ----------
    scenario : Scenario or ExternalInputs, or None
        Stick signals and pushes; None for a neutral stick and no push.
    recorded : mapping of str to mapping of int to object
        Recorded samples that replace those of a device, by its field and their stamps [ns].

    Attributes
    ----------
    start_ns : int
        Sim time of the first tick [ns].
    plant : Plant
        The plant.
    world : World or None
        None for an unlimited floor without walls.
    pushes : sequence of Push
        Those of the external inputs.

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
        recorded: Mapping[str, Mapping[int, Any]] = MappingProxyType({}),
    ) -> None:
        self.start_ns = start_ns
        self.world = World.of(parameters.of(PlantParameters))
        self.plant = Plant(parameters.of(PlantParameters), start_ns, self.world)
        self._devices = [
            _SampledDevice.of(each, parameters, recorded.get(each.field, {})) for each in DEVICES
        ]
        dead_times = [each.dead_time(parameters.of(each.parameters)) for each in DEVICES]
        self.plant.keep_steps(max(each.longest for each in dead_times))
        self._no_samples = [None] * len(DeviceInputs._fields)
        self._scenario = scenario or Scenario()
        self.pushes = self._scenario.pushes_from(start_ns)
        for push in self.pushes:
            self.plant.push(push)

    def sample(self, truth: GroundTruth) -> DeviceInputs:
        """Return the samples of the devices and sticks that are due at the time of `truth`."""
        now_ns = truth.stamp_ns
        samples: list[Any] = self._no_samples.copy()
        for period_ns, input_index, sampled, read in self._devices:
            if now_ns % period_ns == 0:
                samples[input_index] = read(sampled(truth), now_ns)
        if now_ns % BATTERY_PERIOD_NS == 0:
            samples[_BATTERY] = battery_mv(truth.battery_voltage)
        if now_ns % GamepadParameters.period_ns == 0:
            samples[_STICKS] = self._scenario.sticks_at((now_ns - self.start_ns) * 1e-9)
        return DeviceInputs._make(samples)
