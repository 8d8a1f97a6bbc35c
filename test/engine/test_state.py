"""Constants and states are numbers, and a state is all that a robot needs to continue."""

import numpy as np

from ballbot_ros.controllers.document.axis import ProgramConstants
from ballbot_ros.controllers.document.program import INITIAL_STATE, tick_constants
from ballbot_ros.engine.devices import numbers_of
from ballbot_ros.engine.plant_tick import initial_state, plant_constants
from ballbot_ros.engine.run import robot_constants
from ballbot_ros.parameters import DEVICES, ControllerParameters, PlantParameters


def numbers_in(value):
    """Yield the numbers of nested tuples; anything else as it is."""
    if isinstance(value, tuple):
        for each in value:
            yield from numbers_in(each)
    else:
        yield value


def test_constants_and_states_are_numbers():
    """An array would have a count of references, and make the compiled code four times slower."""
    plant = plant_constants(numbers_of(PlantParameters()), 10**9)
    constants = robot_constants(plant, *(numbers_of(each()) for each in DEVICES))
    law = tick_constants(ProgramConstants.of(ControllerParameters()))
    state = initial_state(constants.plant, 10**9)
    for each in numbers_in((constants, law, state, INITIAL_STATE)):
        assert isinstance(each, bool | int | float | np.float32 | np.uint64), each
