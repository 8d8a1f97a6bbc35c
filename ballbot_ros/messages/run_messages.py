"""The messages of a run without a graph: same topics and content as from the nodes."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from operator import attrgetter

from ballbot_ros.brick.brick import DeviceInputs
from ballbot_ros.controller.interface import Program
from ballbot_ros.messages.controller_messages import ControllerMessages
from ballbot_ros.messages.conversions import fill_sticks
from ballbot_ros.messages.devices import DEVICE_MESSAGES
from ballbot_ros.messages.outputs import EncodedOutput, Sink
from ballbot_ros.messages.plant_messages import PlantMessages
from ballbot_ros.messages.topics import GAMEPAD_JOY
from ballbot_ros.parameters import ParameterSet, PlantParameters
from ballbot_ros.plant.ground_truth import GroundTruth, Push
from ballbot_ros.simulation.closed_loop import Tick
from ballbot_ros.teleop.arbiter import SCENARIO
from ballbot_ros.world.world import World

RUN_NAME = '1'
"""Name of the run: without a graph there is one run, and no other plant."""


class RunMessages:
    """Creates the messages that the nodes would publish, in causal order.

    Parameters
    ----------
    sink : callable
        Receives the messages.
    parameters : ParameterSet
    """

    def __init__(self, sink: Sink, parameters: ParameterSet) -> None:
        make = partial(EncodedOutput, sink=sink)
        self._plant = PlantMessages(make)
        self._plant.ball_radius = parameters.of(PlantParameters).ball_radius
        self._devices = []
        for each in DEVICE_MESSAGES:
            output = make(each.sample)
            each.describe(output.message, parameters.of(each.device.parameters))
            self._devices.append((attrgetter(each.device.field), each.fill, output))
        self._gamepad = make(GAMEPAD_JOY)
        self._controller = ControllerMessages(make)

    def begin(self, start_ns: int, world: World | None, pushes: Iterable[Push]) -> None:
        """Create the messages at the start of a run."""
        self._plant.announce(start_ns, RUN_NAME)
        self._plant.begin(start_ns, world)
        for number, push in enumerate(pushes, 1):
            self._plant.push(push, number)

    def truth(self, truth: GroundTruth, *, wall_hit: bool) -> None:
        """Create the plant's messages at a tick."""
        self._plant.truth(truth, wall_hit=wall_hit)

    def stop_motors(self, last_ns: int) -> None:
        """Create the plant's message at the end of a run that did not complete."""
        self._plant.stop_motors(last_ns)

    def tick(self, tick: Tick, program: Program, source: str = SCENARIO) -> None:
        """Create the messages of a tick; `source` names the input in command."""
        now_ns = tick.truth.stamp_ns
        self.truth(tick.truth, wall_hit=tick.wall_hit)
        self._drivers(now_ns, tick.inputs, source)
        self._controller.tick(now_ns, tick.outputs, program)

    def _drivers(self, now_ns: int, inputs: DeviceInputs, source: str) -> None:
        for reading_of, fill, output in self._devices:
            reading = reading_of(inputs)
            if reading is not None:
                fill(output.message, now_ns, reading)
                output.send(now_ns)
        if inputs.sticks is not None:
            fill_sticks(self._gamepad.message, now_ns, inputs.sticks, source)
            self._gamepad.send(now_ns)
