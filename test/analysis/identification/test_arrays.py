"""Functions on plain numbers, which also run on arrays."""

import numpy as np
import pytest
from parts import physical

from ballbot_ros.analysis.identification.experiment import for_arrays
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
    return *NONLINEAR, states(random, shape), 4.0 * random.normal(size=shape), 0.02, -0.01


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
        np.testing.assert_allclose(found[(..., *index)], expected, rtol=1e-12, atol=0.0)


def test_the_function_on_numbers_stays_as_it_is():
    for_arrays(advance_nonlinear)
    state = advance_nonlinear(*NONLINEAR, (0.0, 0.1, 1.0, 0.5), 2.0, *NO_FORCE)
    assert all(type(each) is float for each in state)
