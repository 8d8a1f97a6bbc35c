"""The servo controller against the document."""

import numpy as np
import pytest
from parts import physical

from ballbot_ros.controllers.design.linear_model import (
    PUBLISHED_GAIN,
    degree_state_space,
    design_servo,
)
from ballbot_ros.parameters import CONTROLLER, parameters_of
from ballbot_ros.robot.plant.model import state_space

GAIN = [-0.01504899, -1.56981134, -0.02700482, -0.23249821, -0.00712528]
PUBLISHED = [-0.015, -1.5698, -0.027, -0.2325, -0.0071]
POLES = [-241.85, -6.81, -5.09, -0.565 - 0.567j, -0.565 + 0.567j]


@pytest.fixture(scope='module')
def servo():
    return design_servo(physical())


def test_gains_equal_the_reference_to_six_digits(servo):
    np.testing.assert_allclose(servo.gain, GAIN, rtol=5e-7)


def test_gains_round_to_the_published_ones(servo):
    assert tuple(PUBLISHED) == PUBLISHED_GAIN
    digits = [len(str(gain).split('.')[1]) for gain in PUBLISHED]
    assert [round(g, n) for g, n in zip(servo.gain, digits, strict=True)] == PUBLISHED


def test_the_tables_gains_are_the_computed_ones_to_eight_decimals(servo):
    table = parameters_of(CONTROLLER)
    assert table['k_f'].default == tuple(round(gain, 8) for gain in servo.gain[:4])
    assert table['k_i'].default == round(servo.gain[4], 8)


def test_closed_loop_poles_are_the_documents(servo):
    np.testing.assert_allclose(np.sort_complex(servo.poles), POLES, atol=0.006)


def test_degrees_change_the_motor_constant_alone():
    p = physical()
    a, b = state_space(p)
    a_deg, b_deg = degree_state_space(p)
    np.testing.assert_array_equal(a_deg, a)
    np.testing.assert_allclose(b_deg, np.degrees(b[:, :1]), rtol=1e-14)


def test_the_published_gains_balance_too():
    a, b = np.zeros((5, 5)), np.zeros((5, 1))
    a[4, 0] = 1.0
    a[:4, :4], b[:4] = degree_state_space(physical())
    assert np.linalg.eigvals(a - b @ [PUBLISHED]).real.max() < 0.0


@pytest.mark.parametrize('name', ['gravity', 'body_mass', 'body_height', 'motor_resistance'])
@pytest.mark.parametrize('factor', [0.5, 2.0])
def test_the_loop_designed_for_another_robot_is_stable(name, factor):
    nominal = getattr(physical(), name)
    servo = design_servo(physical(**{name: factor * nominal}))
    assert servo.poles.real.max() < 0.0
    assert not np.allclose(servo.gain, GAIN, rtol=1e-3)
