"""The messages of a run without a graph: same topics and content as from the nodes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from operator import attrgetter

from ballbot_ros.brick.brick import DeviceInputs
from ballbot_ros.controllers.interface import Program
from ballbot_ros.messages.controller_messages import ControllerMessages
from ballbot_ros.messages.conversions import encode_sticks
from ballbot_ros.messages.devices import DEVICE_MESSAGES
from ballbot_ros.messages.outputs import MakeSend
from ballbot_ros.messages.plant_messages import PlantMessages
from ballbot_ros.messages.topics import GAMEPAD_JOY
from ballbot_ros.parameters import ParameterSet, PlantParameters, Value
from ballbot_ros.plant.ground_truth import Push
from ballbot_ros.simulation.closed_loop import Tick
from ballbot_ros.teleop.arbiter import SCENARIO
from ballbot_ros.world.world import World

RUN_NAME = '1'
"""Name of the run: without a graph there is one run, and no other plant."""


class RunMessages:
    """Creates the messages that the nodes would publish, in causal order."""

    def __init__(self, make: MakeSend, parameters: ParameterSet) -> None:
        self.plant = PlantMessages(make)
        self.plant.ball_radius = parameters.of(PlantParameters).ball_radius
        self._devices = []
        for each in DEVICE_MESSAGES:
            encode = each.encoder(parameters.of(each.device.parameters))
            self._devices.append((attrgetter(each.device.field), encode, make(each.sample)))
        self._send_sticks = make(GAMEPAD_JOY)
        self._controller = ControllerMessages(make)

    def begin(self, start_ns: int, world: World | None, pushes: Iterable[Push]) -> None:
        """Create the messages at the start of a run."""
        self.plant.announce(start_ns, RUN_NAME)
        self.plant.begin(start_ns, world)
        for number, push in enumerate(pushes, 1):
            self.plant.push(push, number)

    def retuned(self, now_ns: int, values: Mapping[str, Value]) -> None:
        """Create the message of parameters that change before the tick at `now_ns` [ns]."""
        self._controller.retuned(now_ns, values)

    def tick(self, tick: Tick, program: Program, source: str = SCENARIO) -> None:
        """Create the messages of a tick; `source` names the input in command."""
        now_ns = tick.truth.stamp_ns
        self.plant.truth(tick.truth, wall_hit=tick.wall_hit)
        self._drivers(now_ns, tick.inputs, source)
        self._controller.tick(now_ns, tick.outputs, program)

    def _drivers(self, now_ns: int, inputs: DeviceInputs, source: str) -> None:
        for reading_of, encode, send in self._devices:
            reading = reading_of(inputs)
            if reading is not None:
                send(now_ns, encode(now_ns, reading))
        if inputs.sticks is not None:
            self._send_sticks(now_ns, encode_sticks(now_ns, inputs.sticks, source))
