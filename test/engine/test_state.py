"""Constants and states are numbers, and a state is all that a robot needs to continue."""

import pickle

import numpy as np
import pytest
from parts import make_loop, run_loop, steps

from ballbot_ros.controllers.document.axis import ProgramConstants, constants_of
from ballbot_ros.controllers.document.program import INITIAL_STATE
from ballbot_ros.engine.devices import numbers_of
from ballbot_ros.engine.plant_tick import initial_state, plant_constants
from ballbot_ros.engine.run import robot_constants
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.parameters import DEVICES, ControllerParameters, PlantParameters

ROBOT = {
    'plant_sim.plant_model': 'nonlinear',
    'plant_sim.battery_model': 'draining',
    'plant_sim.backlash': 0.02,
    'plant_sim.actuator_delay': 1,
    'plant_sim.actuator_delay_jitter': 2,
    'plant_sim.map': 'track',
    'gyro_driver.noise': 0.7,
    'gyro_driver.delay_jitter': 1,
    'sonar_driver.noise_cm': 3.0,
}
DRIVING = Scenario(vertical=steps((0.0, 0), (1.5, -60), (3.0, 40)))


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
    law = constants_of(ProgramConstants.of(ControllerParameters()))
    state = initial_state(constants.plant, 10**9)
    for each in numbers_in((constants, law, state, INITIAL_STATE)):
        assert isinstance(each, bool | int | float | np.float32 | np.uint64), each


@pytest.mark.parametrize('after_s', [0.5, 2.0])
def test_after_a_restore_a_thousand_ticks_are_the_same(after_s):
    loop, other = (make_loop(ROBOT, DRIVING) for _ in range(2))
    run_loop(loop, after_s)
    saved = pickle.loads(pickle.dumps((loop.plant.save_state(), loop.program.state)))
    expected = run_loop(loop, 4.0)
    run_loop(other, 0.3)
    plant, other.program.state = saved
    other.plant.restore_state(plant)
    assert run_loop(other, 4.0) == expected
