"""The model predictive controller that ships."""

import sys

import numpy as np
import pytest
from shipped_controllers import duties

pytest.importorskip('osqp')

from ballbot_ros.controllers.driving import NO_REFERENCE
from ballbot_ros.controllers.lqg import TrackingTask
from ballbot_ros.controllers.mpc import HORIZON, MPC, LimitedRegulator, MPCParameters, Predictions
from ballbot_ros.errors import ControllerError

MPC_NAME = 'mpc'
NO_LIMIT = 'controller.user.pitch_limit=45'


def designed(**changes):
    return MPC.design(MPCParameters(**changes), MPC().model)


def voltage_for(regulator, error, limits):
    task = TrackingTask(NO_REFERENCE, (0.0,) * 5, error, 0.0, 0.0)
    return regulator.voltage(task, limits)


def test_without_a_limit_in_sight_it_is_the_lqg():
    of_lqg, _ = duties('lqg')
    of_mpc, _ = duties(MPC_NAME, NO_LIMIT)
    assert (of_lqg == of_mpc).all()


def test_predictions_are_those_of_the_closed_loop():
    """Simulate the regulator with added voltages, tick by tick."""
    p = designed()
    predictions = Predictions.of(p)
    a, b = np.eye(5), np.append(p.input_effect[:4], 0.0)
    a[:4, :4] = np.reshape(p.transition, (5, 5))[:4, :4]
    a[4, 0] = 0.004
    random = np.random.default_rng(1)
    state, added = random.normal(size=5), random.normal(size=HORIZON)
    expected_voltage = predictions.voltage @ state + predictions.voltage_response @ added
    expected_pitch = predictions.pitch @ state + predictions.pitch_response @ added
    for tick in range(HORIZON):
        voltage = added[tick] - np.dot(p.feedback, state)
        assert voltage == pytest.approx(expected_voltage[tick], rel=1e-9, abs=1e-9)
        state = a @ state + b * voltage
        assert state[1] == pytest.approx(expected_pitch[tick], rel=1e-9, abs=1e-9)


def test_a_dead_time_does_not_change_what_a_voltage_does_once_it_acts():
    p = designed()
    late = designed(actuator_delay=6.0)
    for matrix, same in zip(Predictions.of(p), Predictions.of(late), strict=True):
        np.testing.assert_allclose(matrix, same, rtol=1e-9, atol=1e-12)


def test_it_keeps_to_the_voltage_that_there_is():
    p = designed(pitch_limit=45.0)
    made = LimitedRegulator(p)
    error = (0.0, 6.0, 0.0, 60.0, 0.0)
    wanted = -np.dot(p.feedback, error)
    high = 0.8 * wanted
    assert voltage_for(made, error, (-8.0, high)) == pytest.approx(high, abs=0.01)
    assert voltage_for(made, error, (-8.0, 1.5 * wanted)) == pytest.approx(wanted)


def test_it_leans_less_than_the_lqg_if_the_pitch_is_limited():
    error = (-100.0, 0.0, 0.0, 0.0, 0.0)  # far from the reference: leaning brings it back
    p = designed(pitch_limit=45.0)
    free, limited = LimitedRegulator(p), LimitedRegulator(designed(pitch_limit=0.5))
    limits = (-8.0, 8.0)
    pitches = Predictions.of(p).pitch @ error
    assert abs(pitches).max() > 1.0
    voltages = [abs(voltage_for(each, error, limits)) for each in (limited, free)]
    assert voltages[0] < 0.9 * voltages[1]


def test_a_missing_solver_is_told(monkeypatch):
    monkeypatch.setitem(sys.modules, 'osqp', None)
    with pytest.raises(ControllerError, match=r'osqp not found .*pip install "ballbot_ros\[mpc\]"'):
        MPC()


def test_it_is_not_portable():
    assert not MPC.portable
