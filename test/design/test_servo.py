"""The servo controller against the document, and its margins against their definitions."""

import control
import numpy as np
import pytest
from robot import physical

from ballbot_ros.design.servo import PUBLISHED_GAIN, degree_state_space, design_servo
from ballbot_ros.design.state_feedback import DesignError
from ballbot_ros.parameters import CONTROLLER, parameters_of
from ballbot_ros.plant.model import state_space

GAIN = [-0.01504899, -1.56981134, -0.02700482, -0.23249821, -0.00712528]
PUBLISHED = [-0.015, -1.5698, -0.027, -0.2325, -0.0071]
POLES = [-241.85, -6.81, -5.09, -0.565 - 0.567j, -0.565 + 0.567j]


@pytest.fixture(scope='module')
def servo():
    return design_servo(physical())


@pytest.fixture(scope='module')
def loop(servo):
    """The plant with the integral of theta, and the feedback of the controller."""
    a = np.zeros((5, 5))
    a[:4, :4] = servo.a
    a[4, 0] = 1.0
    return a, np.vstack([servo.b, [[0.0]]]), servo.gain[np.newaxis]


def slowest(a):
    return np.linalg.eigvals(a).real.max()


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


def test_the_published_gains_balance_too(loop):
    a, b, _ = loop
    assert slowest(a - b @ [PUBLISHED]) < 0.0


def test_an_optimal_loop_has_the_classical_margins(servo):
    lower, upper = servo.gain_margins
    assert lower < 0.5
    assert upper == np.inf
    assert servo.phase_margin_deg > 60.0


def test_the_loop_is_stable_between_its_gain_margins_only(servo, loop):
    a, b, gain = loop
    lower, _ = servo.gain_margins
    assert slowest(a - 1.001 * lower * b @ gain) < 0.0 < slowest(a - 0.999 * lower * b @ gain)
    assert slowest(a - 1e4 * b @ gain) < 0.0


def test_the_loop_tolerates_a_phase_lag_up_to_its_phase_margin(servo, loop):
    a, b, gain = loop

    def with_lag(degrees):
        return a - np.exp(-1j * np.radians(degrees)) * b @ gain

    margin = servo.phase_margin_deg
    assert slowest(with_lag(0.99 * margin)) < 0.0 < slowest(with_lag(1.01 * margin))


def test_the_loop_tolerates_a_dead_time_up_to_its_delay_margin(servo, loop):
    a, b, gain = loop
    open_loop = control.ss(a, b, gain, [[0.0]])

    def slowest_pole(delay):
        dead_time = control.tf2ss(*control.pade(delay, 6))
        return control.feedback(control.series(dead_time, open_loop)).poles().real.max()

    margin = servo.delay_margin_s
    assert slowest_pole(0.97 * margin) < 0.0 < slowest_pole(1.03 * margin)


def test_the_loop_tolerates_one_tick_of_delay(servo):
    assert servo.delay_margin_s > 4e-3


def test_a_motor_without_torque_is_refused_in_one_line():
    with pytest.raises(DesignError, match=r'^[^\n]*not controllable[^\n]*$'):
        design_servo(physical(torque_constant=0.0))


@pytest.mark.parametrize('change', [
    {'q_diagonal': (1.0, 1.0)},
    {'q_diagonal': (0.0,) * 5},
    {'r': 0.0},
    {'r': -1.0},
    {'r': np.nan},
])  # fmt: skip
def test_weights_without_a_solution_are_refused_in_one_line(change):
    with pytest.raises(DesignError, match=r'^no linear quadratic regulator: [^\n]+$'):
        design_servo(physical(), **change)


@pytest.mark.parametrize('name', ['gravity', 'body_mass', 'body_height', 'motor_resistance'])
@pytest.mark.parametrize('factor', [0.5, 2.0])
def test_the_loop_designed_for_another_robot_is_stable(name, factor):
    nominal = getattr(physical(), name)
    servo = design_servo(physical(**{name: factor * nominal}))
    assert servo.poles.real.max() < 0.0
    assert not np.allclose(servo.gain, GAIN, rtol=1e-3)
