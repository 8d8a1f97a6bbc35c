"""The document's law with the drift filter that ships."""

import numpy as np
import pytest
from parts import physical
from shipped_controllers import duties, run_shipped

from ballbot_ros.controllers.drift_filter import Lean, lean_constants, observed_lean
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.robot.plant.model import state_space

REFERENCE = 'drift_filter'
STRONG_DRIFT = ['gyro_driver.drift=2.0', 'gyro_driver.drift_period=120.0']


def test_a_lean_that_the_ball_shows_is_no_error():
    """Sample a linear plane under a random voltage: the observer believes a true pitch."""
    model = physical()
    a, b = state_space(model)
    constants, lean = lean_constants(5.0, model), Lean(0.0, 0.0)
    random = np.random.default_rng(1)
    state, step, errors = np.zeros(4), TICK_S / 100, []
    for _ in range(250):
        voltage = random.normal()
        before = state[1]
        for _ in range(100):
            state = state + step * (a @ state + b[:, 0] * voltage)
        mean_psi = (before + state[1]) / 2.0
        lean, error = observed_lean(constants, lean, mean_psi, state[2], state[3])
        errors.append(error)
    assert abs(np.cumsum(errors)).max() < 0.01 * abs(state[1])


def test_a_pitch_of_a_ball_at_rest_is_an_error():
    constants, lean = lean_constants(5.0, physical()), Lean(0.0, 0.0)
    psi, drift = 0.0, 0.5
    for _ in range(round(60.0 / TICK_S)):
        psi += TICK_S * (drift - lean.offset_error)
        lean, error = observed_lean(constants, lean, psi, 0.0, 0.0)
        psi -= error
    assert psi == pytest.approx(0.0, abs=1e-3)
    assert lean.offset_error == pytest.approx(drift, abs=1e-3)


def test_it_stands_where_the_document_falls():
    long = [*STRONG_DRIFT, 'plant_sim.duration=70']
    document, filtered = (
        run_shipped(each, 'hardware_standing', assignments=long) for each in ('python', REFERENCE)
    )
    assert document.metrics['peak_pitch_deg'] > 15.0
    assert filtered.metrics['peak_pitch_deg'] < 3.0


def test_its_pitch_drifts_less_than_the_document_s():
    errors = []
    for controller in ('python', REFERENCE):
        _, loop = duties(controller, ticks=7500, profile='hardware')
        estimated, true = loop.program.x.psi, np.degrees(loop.plant.truth().psi[0])
        errors.append(abs(float(estimated) - true))
    assert errors[1] < 0.5 * errors[0]
