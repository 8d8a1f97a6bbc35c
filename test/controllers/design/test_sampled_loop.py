"""The model of the loop that runs, against the running code with the quantisers off."""

from dataclasses import astuple, replace

import control
import numpy as np
import pytest
from parts import START_NS
from unquantised import run_unquantised

from ballbot_ros.controllers.design.linear_model import DesignError
from ballbot_ros.controllers.design.loop_analysis import analyse_sampled
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
from ballbot_ros.controllers.document import axis
from ballbot_ros.controllers.document.axis import ProgramConstants
from ballbot_ros.controllers.document.program import max_motor_voltage
from ballbot_ros.parameters import ControllerParameters, ParameterSet, PlantParameters
from ballbot_ros.parameters.files import assign_values
from ballbot_ros.parameters.timing import TICK_NS, TICK_S
from ballbot_ros.robot.brick.sensors import battery_mv
from ballbot_ros.robot.plant.ground_truth import Push
from ballbot_ros.robot.plant.integration import zero_order_hold
from ballbot_ros.robot.plant.laws import max_voltage
from ballbot_ros.robot.plant.model import PhysicalParameters, state_space

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


@pytest.mark.parametrize('period_ms', [2.0, 3.0, 4.0, 6.0, 8.0])
def test_another_period_of_the_program_is_that_of_its_loop(monkeypatch, period_ms):
    """The program with another constant for its period, and a plane that it moves."""
    parameters = parameters_with({'controller.pwm_offset': 0.0})
    monkeypatch.setattr(axis, 'TS1_PERIOD', np.float64(period_ms))
    own = parameters.of(ControllerParameters)
    own = replace(own, a_d=own.a_d ** (period_ms / 4), a_gd=own.a_gd ** (period_ms / 4))
    gains, *others = axis.constants_of(ProgramConstants.of(own))
    constants = tuple(map(np.float64, gains)), *map(np.float64, others)
    plant = parameters.of(PlantParameters)
    p = PhysicalParameters.from_parameters(plant)
    volts = max_voltage(plant.battery_voltage, plant.voltage_slope, plant.voltage_offset)
    transition, held = zero_order_hold(*state_space(p), period_ms * 1e-3)
    motor_volts = max_motor_voltage(np.float64(battery_mv(plant.battery_voltage)))
    plane, state, moved = np.array([0.0, 1e-15, 0.0, 0.0]), (np.float64(0.0),) * 6, []
    for _ in range(40):
        gyro, angle = np.degrees(plane[3]), np.degrees(p.ratio * (plane[0] - plane[1]))
        state, _, duty = axis.control(constants, state, gyro, angle, np.float64(0.0), motor_volts)
        plane = transition @ plane + held[:, 0] * volts * duty / 100
        moved.append(plane)
    a, _ = SampledLoop(parameters, LoopDelays(), period_ms).closed()
    x = np.zeros(len(a))
    x[1] = 1e-15
    for expected in moved:
        x = a @ x
        np.testing.assert_allclose(x[:4], expected, rtol=1e-7, atol=1e-9 * abs(expected).max())


def test_no_period_lets_the_documents_gains_bear_the_link_of_a_brick():
    borne = {
        period_ms: analyse_sampled(ParameterSet(), period_ms).margins
        for period_ms in (2.0, 3.0, 4.0, 6.0, 8.0)
    }
    values = {period: margins and margins.dead_time_ms.value for period, margins in borne.items()}
    assert values == {
        2.0: pytest.approx(3.74, abs=0.01), 3.0: pytest.approx(2.85, abs=0.01),
        4.0: pytest.approx(3.46, abs=0.01), 6.0: None, 8.0: None,
    }  # fmt: skip


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
