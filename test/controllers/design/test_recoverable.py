"""The states from which the motors can catch the robot, against the plant under full duty."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from parts import make_plant

from ballbot_ros.controllers.design.linear_model import DesignError
from ballbot_ros.controllers.design.loop_analysis import recoverable_states
from ballbot_ros.parameters import PLANT, ParameterSet

BALL_RATES, PITCH_RATES = st.floats(-10.0, 10.0), st.floats(-2.0, 2.0)
SHARE_OF_A_TICK = 1e-3


def shares_after_a_tick(share, theta_dot, psi_dot):
    """Return the share of the limit a tick after a state with a share, for each of some duties."""
    limit = recoverable_states(ParameterSet())
    _, along_psi, *along_rates = limit.direction
    psi = (share - np.dot(along_rates, (theta_dot, psi_dot))) / along_psi
    start = 0.0, float(psi), theta_dot, psi_dot
    assert limit.share(np.array(start)) == pytest.approx(share)
    shares = {}
    for duty in (-100, 0, 100):
        plant = make_plant(fall_angle=1.5)
        plant.state = plant.state._replace(x=start)
        plant.tick(duty, 0)
        shares[duty] = float(limit.share(np.array(plant.state.x)))
    return shares


@given(BALL_RATES, PITCH_RATES)
def test_full_duty_brings_back_what_is_within_the_limit(theta_dot, psi_dot):
    shares = shares_after_a_tick(1.0 - SHARE_OF_A_TICK, theta_dot, psi_dot)
    assert min(shares.values()) < 1.0 - SHARE_OF_A_TICK


@given(BALL_RATES, PITCH_RATES)
def test_no_duty_brings_back_what_is_beyond_the_limit(theta_dot, psi_dot):
    shares = shares_after_a_tick(1.0 + SHARE_OF_A_TICK, theta_dot, psi_dot)
    assert min(shares.values()) > 1.0 + SHARE_OF_A_TICK


def test_a_lower_voltage_allows_less_in_proportion():
    parameters = ParameterSet()
    full = recoverable_states(parameters)
    parameters.set(PLANT, 'dead_zone', 50.0)
    half = recoverable_states(parameters)
    np.testing.assert_allclose(half.direction, 2.0 * full.direction)
    assert half.rate == full.rate == pytest.approx(6.10, abs=0.01)


@pytest.mark.parametrize(('name', 'value', 'problem'), [
    ('gravity', 0.0, '0 unstable poles'),
    ('voltage_slope', 0.0, 'motors cannot move'),
])  # fmt: skip
def test_what_cannot_be_decided_is_refused(name, value, problem):
    parameters = ParameterSet()
    parameters.set(PLANT, name, value)
    with pytest.raises(DesignError, match=problem):
        recoverable_states(parameters)
