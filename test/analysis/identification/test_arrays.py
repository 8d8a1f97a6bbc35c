"""Functions on plain numbers, which also run on arrays."""

import numpy as np
import pytest
from parts import physical

from ballbot_ros.analysis.identification.experiment import for_arrays
from ballbot_ros.analysis.identification.segment_model import advance_arrays, advance_segments
from ballbot_ros.engine.compilation import compiled
from ballbot_ros.robot.plant.integration import (
    advance_linear,
    advance_nonlinear,
    discrete_matrices,
    equations_of,
)
from ballbot_ros.robot.plant.laws import max_voltage, motor_current, shaft_angle

DT = 1e-3
LINEAR = discrete_matrices(physical(), DT)
NONLINEAR = equations_of(physical(ball_friction=0.001)), physical().alpha, DT
NO_FORCE = (0.0, 0.0)


def states(random, shape):
    return tuple(random.normal(scale=scale, size=shape) for scale in (5.0, 0.4, 10.0, 3.0))


def linear(random, shape):
    return *LINEAR, states(random, shape), 4.0 * random.normal(size=shape), *NO_FORCE


def nonlinear(random, shape):
    planes = states(random, shape), states(random, shape)
    return *NONLINEAR, *planes, *4.0 * random.normal(size=(2, *shape)), 0.02, -0.01, 0.0, 0.03


def current(random, shape):
    return *random.normal(scale=5.0, size=(3, *shape)), 1.1, random.uniform(1.0, 9.0, shape)


def voltage(random, shape):
    return random.uniform(0.0, 10.0, shape), 0.001089, -0.625


def shaft(random, shape):
    return *random.normal(size=(2, *shape)), 0.3


def number(argument, index):
    """Return one element of an argument, as plain numbers."""
    if isinstance(argument, tuple):
        return tuple(number(each, index) for each in argument)
    return float(argument[index]) if isinstance(argument, np.ndarray) else argument


@pytest.mark.parametrize(
    ('function', 'arguments'),
    [
        (advance_linear, linear),
        (advance_nonlinear, nonlinear),
        (motor_current, current),
        (max_voltage, voltage),
        (shaft_angle, shaft),
    ],
    ids=lambda each: each.__name__,
)
def test_arrays_give_what_numbers_give(function, arguments):
    shape = (3, 40)
    values = arguments(np.random.default_rng(7), shape)
    found = np.array(for_arrays(function)(*values))
    for index in np.ndindex(shape):
        expected = function(*number(values, index))
        assert found[(..., *index)].tobytes() == np.array(expected).tobytes()


def test_the_function_on_numbers_stays_as_it_is():
    for_arrays(advance_nonlinear)
    planes = advance_nonlinear(*NONLINEAR, *2 * [(0.0, 0.1, 1.0, 0.5)], 2.0, 1.0, *2 * NO_FORCE)
    assert all(type(each) is float for plane in planes for each in plane)


def test_compiled_segments_move_as_arrays_do():
    random = np.random.default_rng(3)
    robots = [physical(), physical(body_height=0.15, ball_friction=0.001)]
    constants = np.array([(*equations_of(each), each.alpha) for each in robots])
    state, voltage = np.array(states(random, (2, 2, 30))), 4.0 * random.normal(size=(2, 2, 30))
    state[:, :, 1, 0] = np.inf
    dt = random.uniform(0.0, DT, 30)
    with np.errstate(invalid='ignore'):
        expected = advance_arrays(constants, dt, state, voltage)
        each = advance_segments(constants, dt, state, voltage)
    np.testing.assert_array_equal(each, expected)
    pytest.importorskip('numba')
    found = compiled(advance_segments)(constants, dt, state, voltage)
    np.testing.assert_array_equal(found, expected)
