"""The LQG controller that ships."""

import numpy as np
import pytest
from robot import physical
from shipped_controllers import duties, exchanged, run_shipped

from ballbot_ros.controllers.lqg import LQG, LQGParameters, discrete_model, measurement
from ballbot_ros.timing import TICK_S

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


def test_feedforward_is_the_back_emf_of_a_rolling_ball():
    model = physical()
    psi, voltage, *_ = LQG.design(LQGParameters(), model).feedforward
    assert psi == pytest.approx(0.0, abs=1e-9)
    assert voltage == pytest.approx(np.radians(1.0) * model.beta / model.alpha)


@pytest.mark.parametrize(
    'scenario',
    ['push', 'remote_wall', 'hardware_standing', 'hardware_forward_backward'],
)
def test_it_passes_shipped_scenarios(scenario):
    result = run_shipped(REFERENCE, scenario)
    assert result.passed, result.reason


def test_it_drives_by_itself():
    result = run_shipped(REFERENCE, 'autonomous')
    assert result.passed, result.reason


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


def test_its_planes_are_alike():
    assert exchanged(REFERENCE)


def test_the_same_run_has_the_same_duties():
    first, again = (duties(REFERENCE, profile='hardware', seed=3)[0] for _ in range(2))
    assert (first == again).all()
    assert first.any()


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


def test_a_fallen_robot_stops_its_motors():
    duty, loop = duties(REFERENCE, 'plant_sim.start_pitch_x=0.2')
    assert loop.plant.fallen
    assert not duty[-50:].any()
    assert loop.program.operating_state == 'out_of_control'
