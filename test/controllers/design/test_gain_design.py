"""Gains for the loop as it runs: the cost they minimise, the poles they give, what they bear."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import assume
from hypothesis import strategies as st
from laws import given
from parts import physical
from unquantised import run_unquantised

from ballbot_ros.controllers.design.gain_design import DISTURBANCE_N, GainDesign, set_gains
from ballbot_ros.controllers.design.linear_model import (
    Q_DIAGONAL,
    R_WEIGHT,
    DesignError,
    design_servo,
)
from ballbot_ros.controllers.design.loop_analysis import ROUNDING, analyse_sampled
from ballbot_ros.controllers.design.sampled_loop import (
    ENCODER_ERROR,
    FORCE,
    GYRO_ERROR,
    INPUTS,
    LoopDelays,
    SampledLoop,
)
from ballbot_ros.parameters import ParameterSet, PlantParameters
from ballbot_ros.parameters.files import assign_values
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.robot.plant.laws import max_voltage

DOCUMENT = design_servo(physical()).gain
QUIET_FILTERS = {'controller.a_d': 0.975}
QUIET_WEIGHTS = (0.034, 0.0067, 0.0016, 0.012, 0.00084), 1.0


def parameters_with(values=()):
    parameters = ParameterSet()
    assign_values(parameters, dict(values))
    return parameters


def with_gains(gains, values=()):
    parameters = parameters_with(values)
    set_gains(parameters, gains)
    return parameters


def design(values=(), delay=None):
    return GainDesign(parameters_with(values), None if delay is None else LoopDelays(delay))


@cache
def regulator(delay):
    """Return the regulator with the document's weights, and its gains."""
    designed = design(delay=delay)
    return designed, np.array(designed.regulator(Q_DIAGONAL, R_WEIGHT))


FACTORS = st.tuples(*[st.floats(0.6, 1.3)] * 5)


@given(FACTORS, st.sampled_from([0.0, 3.0, 8.0]), st.sampled_from([1.0, 0.99]))
def test_the_gradient_is_that_of_the_cost(factors, delay, discount):
    designed, gains = regulator(delay)
    gains = gains * factors
    cost = designed.cost(gains, Q_DIAGONAL, R_WEIGHT, discount)
    assume(math.isfinite(cost.value))
    steps = np.diag(1e-5 * abs(gains))
    differences = [
        designed.cost(gains + step, Q_DIAGONAL, R_WEIGHT, discount).value
        - designed.cost(gains - step, Q_DIAGONAL, R_WEIGHT, discount).value
        for step in steps
    ]
    expected = 2.0 * steps.sum(axis=1) * cost.gradient
    np.testing.assert_allclose(differences, expected, rtol=1e-3, atol=1e-7 * cost.value)


def test_the_cost_is_the_mean_of_the_loop_with_noise():
    q, r = QUIET_WEIGHTS
    designed = design(QUIET_FILTERS, delay=6.0)
    gains = designed.regulator(q, r)
    loop = SampledLoop(with_gains(gains, QUIET_FILTERS), LoopDelays(6.0))
    a, b = loop.closed()
    deviation = np.zeros(len(INPUTS))
    for name, size in ((GYRO_ERROR, ROUNDING), (ENCODER_ERROR, ROUNDING), (FORCE, DISTURBANCE_N)):
        deviation[INPUTS.index(name)] = size
    plant = parameters_with().of(PlantParameters)
    volts = max_voltage(plant.battery_voltage, plant.voltage_slope, plant.voltage_offset) / 100.0
    covariance = np.zeros_like(a)
    noise = (b * deviation) @ (b * deviation).T
    for _ in range(30_000):  # 2 minutes; the slowest motion takes 10 s
        covariance = a @ covariance @ a.T + noise
    factors = np.zeros((6, len(loop.states)))
    for row, name in zip(factors, ('theta', 'psi', 'theta_dot', 'psi_dot'), strict=False):
        row[loop.states.index(name)] = np.degrees(1.0)
    factors[4, loop.states.index('sum_theta_diff')] = TICK_S
    factors[5] = volts * loop.c
    variances = np.diag(factors @ covariance @ factors.T)
    direct = np.sum((volts * loop.d * deviation) ** 2)
    mean = np.dot(variances, (*q, r)) + r * direct
    assert designed.cost(gains, q, r).value == pytest.approx(mean, rel=1e-6)


@pytest.mark.parametrize('delay', [0.0, 8.0])
def test_no_neighbour_of_the_regulator_is_cheaper(delay):
    designed, gains = regulator(delay)
    least = designed.cost(gains, Q_DIAGONAL, R_WEIGHT).value
    generator = np.random.default_rng(2)
    for step in generator.uniform(-0.02, 0.02, (200, 5)):
        assert designed.cost(gains * (1.0 + step), Q_DIAGONAL, R_WEIGHT).value >= least


@pytest.mark.parametrize('delay', [0.0, 4.0, 13.5, 50.0, 100.0])
@pytest.mark.parametrize('filters', [
    {}, {'controller.a_d': 0.975}, {'controller.a_d': 0.0, 'controller.a_gd': 0.99},
])  # fmt: skip
def test_the_regulator_makes_the_loop_stable_that_it_was_designed_for(filters, delay):
    gains = design(filters, delay).regulator(Q_DIAGONAL, R_WEIGHT)
    loop = SampledLoop(with_gains(gains, filters), LoopDelays(delay))
    assert abs(loop.poles()).max() < 1.0


def test_the_running_code_stands_with_a_dead_time_that_it_was_designed_for():
    def pitch(gains):
        values = {'plant_sim.hold_time': 0.0, 'plant_sim.start_pitch_x': 1e-4}
        parameters = with_gains(gains, {**values, 'plant_sim.actuator_delay': 30})
        states, _ = run_unquantised(parameters, 1500)
        return abs(states[-250:, 1]).max()

    assert pitch(design(delay=30.0).regulator(Q_DIAGONAL, R_WEIGHT)) < 1e-5
    assert pitch(DOCUMENT) > 1e-2


def test_heavier_duty_gives_a_quieter_loop():
    noise = []
    for factor in (0.1, 1.0, 10.0):
        gains = design().regulator(Q_DIAGONAL, factor * R_WEIGHT)
        noise.append(analyse_sampled(with_gains(gains)).samples.rounding_noise)
    assert noise[0] > noise[1] > noise[2]
    assert noise[1] < 0.5 * analyse_sampled(with_gains(DOCUMENT)).samples.rounding_noise


@given(FACTORS, st.sampled_from([0.0, 2.5, 8.0]))
def test_the_gains_come_back_from_their_poles(factors, delay):
    designed, gains = regulator(delay)
    gains = gains * factors
    poles = np.log(designed.poles(gains)) / TICK_S
    assume((poles.real < -1e-3).all())
    # Slow poles first; one on the negative real axis in z is none of a pair in s.
    possible = sorted((each for each in poles if abs(each.imag) < 600.0), key=lambda s: -s.real)
    chosen = possible[:5]
    if chosen[-1].imag and not np.isclose(chosen[-1], np.conj(chosen[-2])):
        chosen = possible[1:6] if not possible[0].imag else possible[:4] + possible[6:7]
    assume(len(chosen) == 5 and np.isclose(sum(each.imag for each in chosen), 0.0))
    distances = abs(np.subtract.outer(chosen, chosen))[~np.eye(5, dtype=bool)]
    assume(distances.min() > 0.01)
    np.testing.assert_allclose(designed.with_poles(chosen), gains, rtol=1e-5)


def test_the_loop_has_the_poles_that_were_asked_for():
    asked = [-0.3, -0.6 + 0.6j, -0.6 - 0.6j, -5.0, -7.0]
    designed = design()
    poles = SampledLoop(with_gains(designed.with_poles(asked))).poles()
    for pole in asked:
        assert abs(poles - np.exp(pole * TICK_S)).min() < 1e-6


@pytest.mark.parametrize(('poles', 'message'), [
    ([-1.0, -2.0, -3.0], '5 poles are needed, one for each gain: got 3'),
    ([-1.0, -2.0, -3.0, -4.0, 1.0], 'the pole 1 1/s needs a real part below -0.001 1/s'),
    ([-1.0, -2.0, -3.0, -4.0, math.nan], 'needs a real part below'),
    ([-1.0, -2.0, -3.0, -4.0, -5 + 1j], 'the pole -5+1j 1/s needs its conjugate'),
    ([-1.0, -2.0, -3.0, -3.0, -4.0], 'the pole -3 1/s is given twice'),
    ([-1.0, -2.0, -3.0, -4 + 800j, -4 - 800j], 'oscillates faster than 125 Hz'),
    ([-0.2, -1.6, -12.0, -7 + 7j, -7 - 7j], 'no design: the motion of a pole at .* does not'),
])  # fmt: skip
def test_impossible_poles_are_refused_in_one_line(poles, message):
    with pytest.raises(DesignError, match=f'^[^\n]*{message.replace("+", "[+]")}[^\n]*$'):
        design().with_poles([complex(pole) for pole in poles])


@pytest.mark.parametrize(('q', 'r'), [
    ((1.0, 1.0, 1.0, 1.0, -1.0), 1.0),
    ((1.0, 1.0, 1.0, 1.0, math.nan), 1.0),
    (Q_DIAGONAL, 0.0),
    (Q_DIAGONAL, -1.0),
])  # fmt: skip
def test_weights_that_are_not_allowed_are_refused_in_one_line(q, r):
    with pytest.raises(DesignError, match=r'^no linear quadratic regulator: [^\n]*negative$'):
        design().regulator(q, r)


def test_a_pitch_that_drifts_has_no_regulator():
    with pytest.raises(DesignError, match=r'^no gains are found with which the loop is stable$'):
        design({'controller.a_gd': 1.0}).regulator(Q_DIAGONAL, R_WEIGHT)
