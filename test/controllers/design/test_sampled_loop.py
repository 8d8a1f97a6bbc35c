"""The model of the loop that runs, against the running code with the quantisers off."""

from dataclasses import astuple

import control
import numpy as np
import pytest
from parts import START_NS
from unquantised import run_unquantised

from ballbot_ros.controllers.design.linear_model import DesignError
from ballbot_ros.controllers.design.sampled_loop import (
    DUTY,
    ENCODER_ERROR,
    FORCE,
    GYRO_ERROR,
    INPUTS,
    STICK,
    LoopDelays,
    SampledLoop,
)
from ballbot_ros.parameters import ParameterSet
from ballbot_ros.parameters.files import assign_values
from ballbot_ros.parameters.timing import TICK_NS, TICK_S
from ballbot_ros.robot.plant.ground_truth import Push

PUSH_N, PUSH_TICKS, STICK_PERCENT = 0.01, 10, 1.0

VARIANTS = [
    {},
    {'plant_sim.actuator_delay': 1},
    {'plant_sim.actuator_delay': 4},
    {'plant_sim.actuator_delay': 7},
    {'gyro_driver.delay': 2},
    {'gyro_driver.delay': 4},
    {'encoder_driver.delay': 3},
    {'encoder_driver.delay': 12},
    {'plant_sim.actuator_delay': 2, 'gyro_driver.delay': 5, 'encoder_driver.delay': 9},
    {'controller.a_d': 0.5, 'controller.a_gd': 0.99, 'controller.a_r': 0.9},
    {'controller.a_gd': 1.0},
    {'controller.k_i': 0.0, 'controller.pwm_gain': 0.7},
    {'plant_sim.battery_voltage': 7.1, 'plant_sim.body_mass': 0.9, 'plant_sim.ball_friction': 0.01},
]


def parameters_with(values=()):
    parameters = ParameterSet()
    assign_values(parameters, {'plant_sim.hold_time': 0.0, **dict(values)})
    return parameters


def respond(loop, ticks, **inputs):
    """Return states and duties of the closed model for arrays of inputs, one value a tick."""
    a, b = loop.closed()
    signal = np.zeros((ticks, len(INPUTS)))
    for name, values in inputs.items():
        signal[: len(values), INPUTS.index(name)] = values
    states = np.zeros((ticks, len(loop.states)))
    for tick in range(1, ticks):
        states[tick] = a @ states[tick - 1] + b @ signal[tick - 1]
    return states, states @ loop.c + signal @ loop.d


def difference(values, number, ticks):
    """Return the largest relative difference of model and code, for a stick and a push."""
    parameters = parameters_with(values)
    end_ns = START_NS + PUSH_TICKS * TICK_NS
    push = Push(START_NS, end_ns, (PUSH_N, 0.0))
    run_states, run_duties = run_unquantised(
        parameters, ticks, number=number, stick=STICK_PERCENT, pushes=[push]
    )
    states, duties = respond(
        SampledLoop(parameters), ticks,
        **{STICK: np.full(ticks, STICK_PERCENT), FORCE: np.full(PUSH_TICKS, PUSH_N)},
    )  # fmt: skip
    assert abs(run_duties).max() < 100.0
    pairs = [(run_duties, duties), *zip(run_states.T, states[:, :4].T, strict=True)]
    return max(abs(run - model).max() / abs(run).max() for run, model in pairs)


@pytest.mark.parametrize('values', VARIANTS, ids=str)
def test_the_model_answers_as_the_running_code_does(values):
    ticks = 500 if is_stable(values) else 40
    assert difference(values, np.float64, ticks) < 1e-9


@pytest.mark.parametrize('values', VARIANTS, ids=str)
def test_in_single_precision_it_differs_by_rounding(values):
    ticks = 250 if is_stable(values) else 40
    assert 1e-9 < difference(values, np.float32, ticks) < 1e-3


def is_stable(values):
    return abs(SampledLoop(parameters_with(values)).poles()).max() < 1.0


def test_the_loop_is_unstable_with_one_tick_of_dead_time():
    values = {'plant_sim.actuator_delay': 4}
    assert abs(SampledLoop(parameters_with(values)).poles()).max() == pytest.approx(
        1.1236, abs=1e-4
    )
    push = Push(START_NS, START_NS + TICK_NS, (1e-9, 0.0))
    _, duties = run_unquantised(parameters_with(values), 150, pushes=[push])
    peaks = [abs(duties[tick : tick + 25]).max() for tick in (50, 125)]
    assert peaks[1] / peaks[0] == pytest.approx(1.1236**75, rel=0.05)


@pytest.mark.parametrize('values', [
    {},
    {'controller.a_gd': 0.9},
    {'controller.a_gd': 0.0},
    {'controller.k_i': 0.0},
])  # fmt: skip
def test_what_the_feedback_does_not_move_is_no_pole_of_it(values):
    loop = SampledLoop(parameters_with(values))
    a, _ = loop.closed()
    every = np.linalg.eigvals(a)
    poles = loop.poles()
    assert not np.isclose(poles, 1.0, atol=1e-9).any()
    for pole in poles:
        assert abs(every - pole).min() < 1e-6


def test_without_the_drift_filter_the_estimated_pitch_never_decays():
    poles = SampledLoop(parameters_with({'controller.a_gd': 1.0})).poles()
    assert np.isclose(poles, 1.0, atol=1e-9).sum() == 1


def test_opening_and_closing_the_loop_by_python_control_gives_its_poles():
    loop = SampledLoop(parameters_with({'gyro_driver.delay': 3}))
    closed = control.feedback(loop.open_loop())
    np.testing.assert_allclose(
        np.sort_complex(closed.poles()), np.sort_complex(loop.poles()), atol=1e-9
    )
    assert closed.dt == TICK_S


@pytest.mark.parametrize('source', [GYRO_ERROR, ENCODER_ERROR, DUTY])
def test_the_duty_for_an_error_is_the_same_with_and_without_the_reference(source):
    loop = SampledLoop(ParameterSet())
    _, expected = respond(loop, 200, **{source: [1.0]})
    system = loop.duty_for(source)
    _, duty = control.impulse_response(system, np.arange(200) * TICK_S)
    np.testing.assert_allclose(duty * TICK_S, expected, rtol=1e-9, atol=1e-9)


def test_a_dead_time_between_steps_lies_between_its_neighbours():
    def fastest(actuator):
        return min(
            SampledLoop(ParameterSet(), LoopDelays(actuator)).poles(), key=lambda pole: pole.real
        ).real

    whole = fastest(0.0), fastest(1.0)
    assert whole[0] < fastest(0.25) < fastest(0.5) < whole[1]
    assert fastest(1e-9) == pytest.approx(whole[0], abs=1e-6)


def test_a_dead_time_with_jitter_counts_with_its_mean():
    parameters = parameters_with({'gyro_driver.delay': 1, 'gyro_driver.delay_jitter': 2})
    assert astuple(LoopDelays.of(parameters)) == pytest.approx((0.0, 2.0, 0.0))
    parameters = parameters_with({'plant_sim.actuator_delay_jitter': 12})
    assert LoopDelays.of(parameters).actuator == pytest.approx(5.27, abs=0.05)


def test_another_controller_is_refused_in_one_line():
    with pytest.raises(DesignError, match=r"^[^\n]*document's program only[^\n]*pid$"):
        SampledLoop(parameters_with({'controller.implementation': 'pid'}))
