"""The LQG controller that ships."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from parts import physical
from shipped_controllers import duties, run_shipped

from ballbot_ros.controllers.lqg import (
    LQG,
    LQGParameters,
    discrete_model,
    late_voltages,
    measurement,
)
from ballbot_ros.errors import ControllerError
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.timing import TICK_MS, TICK_S

REFERENCE = 'lqg'
HEAVY = {'body_mass': 0.9}
LIGHT = {'body_mass': 0.5}


def closed_loop(designed, model):
    """Return the transition (10, 10) of plant, filter and integral from tick to tick.

    The filter's state is its prediction. The gyro's drift is constant, and not in the state of the
    plant.
    """
    plant, effect = discrete_model(model)
    effect = effect[:, :1]
    a = np.reshape(designed.transition, (5, 5))
    b = np.reshape(designed.input_effect, (5, 1))
    gain = np.reshape(designed.filter_gain, (5, 2))
    k = np.reshape(designed.feedback, (1, 5))
    c = measurement(model.ratio)
    to_filter = np.hstack([gain @ c[:, :4], np.eye(5) - gain @ c, np.zeros((5, 1))])
    integral = np.eye(1, 10, 9)
    voltage = -k[:, :4] @ to_filter[:4] - k[:, 4:] * integral
    return np.vstack(
        [
            np.hstack([plant, np.zeros((4, 6))]) + effect @ voltage,
            a @ to_filter + b @ voltage,
            integral + TICK_S * to_filter[:1],
        ]
    )


@pytest.mark.parametrize('changes', [{}, HEAVY, LIGHT, {'motor_resistance': 9.0}])
def test_the_designed_loop_is_stable(changes):
    designed = LQG.design(LQGParameters(), physical())
    assert abs(np.linalg.eigvals(closed_loop(designed, physical(**changes)))).max() < 1.0


def test_the_design_follows_the_model():
    light, heavy = (LQG.design(LQGParameters(), physical(**each)) for each in (LIGHT, HEAVY))
    assert light.feedback != heavy.feedback
    assert light.filter_gain != heavy.filter_gain


@given(st.integers(0, 60), st.integers(0, 10**6))
def test_the_prediction_over_a_dead_time_is_the_motion_of_the_plant(delay_ms, seed):
    model, generator = physical(), np.random.default_rng(seed)
    lead, effects = late_voltages(model, float(delay_ms))
    step, effect = discrete_model(model, 1e-3)
    voltages = generator.uniform(-8.0, 8.0, effects.shape[1])  # the newest first
    start = generator.uniform(-1.0, 1.0, 4)

    def acting(ms):
        """Return the voltage that acts `ms` after a tick; the newest does after the dead time."""
        return voltages[-((ms - delay_ms) // TICK_MS)]

    states = [start]
    for ms in range(max(delay_ms, TICK_MS)):
        states.append(step @ states[-1] + effect[:, 0] * acting(ms))
    np.testing.assert_allclose(
        lead @ [*start, *voltages[1:]], states[delay_ms], rtol=1e-9, atol=1e-9
    )
    transition, _ = discrete_model(model)
    after = transition @ start + effects[:4] @ voltages
    np.testing.assert_allclose(after, states[TICK_MS], rtol=1e-9, atol=1e-9)


def test_without_a_dead_time_nothing_is_predicted():
    lead, effects = late_voltages(physical(), 0.0)
    np.testing.assert_array_equal(lead, np.eye(4))
    np.testing.assert_array_equal(effects[:4], discrete_model(physical())[1][:, :1])
    assert effects[4] == 0.0


@pytest.mark.parametrize(('name', 'values'), [('lead', (1.0, 2.0)), ('input_effect', (1.0,) * 5)])
def test_a_design_for_another_dead_time_is_refused(name, values):
    p = replace(LQG.design(LQGParameters(actuator_delay=8.0), physical()), **{name: values})
    with pytest.raises(ControllerError, match=f'^user.{name} needs .* 8 ms, not {len(values)}'):
        LQG.constants(p, physical(), ControllerParameters())


@pytest.mark.parametrize('delay_ms', [8, 30])
def test_it_stands_with_a_dead_time_that_it_knows(delay_ms):
    dead_time_ms = [f'plant_sim.actuator_delay={delay_ms}']
    knows = [*dead_time_ms, f'controller.user.actuator_delay={delay_ms}']
    result = run_shipped(REFERENCE, assignments=knows)
    assert result.passed, result.reason
    assert result.metrics['duty_rms_percent'] < 10.0
    assert run_shipped(REFERENCE, assignments=dead_time_ms).metrics['duty_rms_percent'] > 50.0


def test_feedforward_is_the_back_emf_of_a_rolling_ball():
    model = physical()
    psi, voltage, *_ = LQG.design(LQGParameters(), model).feedforward
    assert psi == pytest.approx(0.0, abs=1e-9)
    assert voltage == pytest.approx(np.radians(1.0) * model.beta / model.alpha)


def test_it_needs_much_less_duty_than_the_document():
    document, lqg = (run_shipped(each) for each in ('python', REFERENCE))
    assert lqg.passed, lqg.reason
    for metric in ('duty_rms_percent', 'position_rms_m'):
        assert lqg.metrics[metric] < 0.65 * document.metrics[metric]


@pytest.mark.parametrize('changes', [HEAVY, LIGHT])
def test_it_stands_on_a_robot_that_its_model_does_not_know(changes):
    result = run_shipped(
        REFERENCE,
        'hardware_standing',
        assignments=['plant_sim.duration=10']
        + [f'plant_sim.{name}={value}' for name, value in changes.items()],
    )
    assert result.passed, result.reason


def test_it_finds_the_drift_of_the_gyro():
    _, loop = duties(
        REFERENCE,
        'gyro_driver.drift=2.0',
        'gyro_driver.drift_period=120.0',
        ticks=5000,
        profile='hardware',
    )
    estimated, true = loop.program.x.psi, np.degrees(loop.plant.truth().psi[0])
    assert abs(estimated - true) < 2.0  # the drift adds up to tens of degrees
