"""Policies as controllers: observations, duties, held duties."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest

from ballbot_ros.controllers.controller import NO_READINGS, next_readings
from ballbot_ros.controllers.policy import (
    NOTHING_OBSERVED,
    PolicyController,
    duty_of,
    observation_of,
    observed,
    observer_tick,
)
from ballbot_ros.parameters import ControllerParameters, quantity
from ballbot_ros.robot.brick.brick import NO_SAMPLE, Inputs

SETTINGS = ControllerParameters()


def readings(elapsed_ms, gyro=(600, 600), encoder=(0, 0), sticks=(0, 0)):
    return next_readings(NO_READINGS, elapsed_ms, Inputs(*gyro, *encoder, 80, 8003, *sticks))


@pytest.mark.parametrize(
    ('action', 'duty'),
    [
        ((0.0, -0.0), (0, 0)),
        ((1.0, -1.0), (100, -100)),
        ((7.0, -1e300), (100, -100)),
        ((0.005, -0.005), (1, 0)),  # halves up
        (np.array([0.125, 0.126], np.float32), (13, 13)),
    ],
)
def test_an_action_is_a_share_of_full_duty(action, duty):
    assert duty_of(action) == duty
    assert all(type(each) is int for each in duty_of(action))


@pytest.mark.parametrize(
    'action',
    [(math.nan, 0.0), (0.0, math.inf), (1.0,), (1.0, 2.0, 3.0), None, ('a', 1), (10**400, 0)],
)
def test_an_action_that_is_not_two_finite_numbers_is_refused(action):
    with pytest.raises(ValueError, match=r'^the action .+ is not two finite numbers$'):
        duty_of(action)


@pytest.mark.parametrize('step_ms', [0, -4, 2, 6, '20', 4.0, True])
def test_a_period_that_is_not_a_multiple_of_a_tick_is_refused(step_ms):
    with pytest.raises(ValueError, match='is not a multiple of 4'):
        type('Odd', (Counting,), {'step_ms': step_ms})()


def observe(state, is_calibrated=False, gyro=(600, 600), encoder=(0, 0), sticks=(0, 0)):
    return observer_tick(state, Inputs(*gyro, *encoder, 80, 8003, *sticks), is_calibrated)


def test_rates_are_means_without_the_offset():
    state = NOTHING_OBSERVED
    for tick in range(250):
        state = observe(state, gyro=(600 + tick % 2, 590))
        assert not state.is_calibrated
    state = observe(state, is_calibrated=True, gyro=(604, 580), encoder=(3, -4))
    assert state.is_calibrated
    assert observation_of(state, SETTINGS)[:5] == (3.5, -10.0, 3.0, -4.0, 8.003)
    state = observed(state)
    for gyro in (601, 602, 606):
        state = observe(state, gyro=(gyro, 590))
    assert observation_of(state, SETTINGS)[:2] == (2.5, 0.0)


def test_a_device_without_a_new_sample_keeps_its_reading():
    state = observe(NOTHING_OBSERVED, sticks=(-50, 100))
    nothing_new = Inputs(600, 600, 5, 6, NO_SAMPLE, NO_SAMPLE, NO_SAMPLE, NO_SAMPLE)
    again = observer_tick(state, nothing_new, False)
    assert again[8:] == state[8:]
    assert observer_tick(state, nothing_new._replace(sonar_cm=-1), False).distance_cm == 255


def test_the_commanded_rates_are_those_of_the_sticks():
    for sticks, rates in (((-50, 100), (190.0, 380.0)), ((127, -128), (-380.0, -380.0))):
        state = observe(NOTHING_OBSERVED, sticks=sticks)
        assert observation_of(state, SETTINGS)[5:] == (80.0, *rates)


@dataclass(frozen=True)
class Unit:
    unit: float = quantity(0.01, '1', (0.0, 1.0), 'first action')


class Counting(PolicyController):
    """Acts every 20 ms: 1 %, 2 %, 3 %, …"""

    step_ms = 20

    def make_policy(self):
        actions = iter(range(1, 100))
        return lambda observation: (next(actions) / 100.0, 0.0)


def test_the_duty_is_held_between_actions():
    controller = Counting()
    duties = [controller.tick(readings(4 * tick))[0] for tick in range(265)]
    assert duties[:250] == [0] * 250
    assert duties[250:] == [1] * 5 + [2] * 5 + [3] * 5


class Estimates(NamedTuple):
    actions: int = 0


def count(p, state, observation):
    assert len(observation) == 5
    return Estimates(state.actions + 1), (p.unit * (state.actions + 1), 0.0)


class CountingOnNumbers(PolicyController[Unit]):
    """The same as a function on numbers."""

    policy = count
    step_ms = 20

    @classmethod
    def initial_state(cls, constants):
        return Estimates()


def test_a_policy_on_numbers_acts_as_any_other():
    one, other = Counting(), CountingOnNumbers()
    acts = other.make_policy()
    for tick in range(265):
        assert one.tick(readings(4 * tick)) == other.tick(readings(4 * tick))
        assert one.operating_state is other.operating_state
    assert [acts((0.0,) * 5) for _ in range(2)] == [(0.01, 0.0), (0.02, 0.0)]


def test_weights_of_a_policy_change_while_it_runs():
    controller = CountingOnNumbers()
    controller.retune(Unit(0.1), SETTINGS)
    assert [controller.tick(readings(4 * tick))[0] for tick in range(256)][-6:] == [10] * 5 + [20]
