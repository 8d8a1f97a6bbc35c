"""Stability over gain and dead time: what the model predicts is what runs show."""

import math
from dataclasses import replace

import numpy as np
import pytest
from unquantised import run_unquantised

from ballbot_ros.controllers.design.sampled_loop import LoopDelays, SampledLoop
from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.parameters import CONTROLLER, PLANT, ControllerParameters, ParameterSet
from ballbot_ros.parameters.timing import TICK_S

NEAR = (0.95, 0.98, 1.02, 1.05)
LOWEST, HIGHEST, GAINS = 0.4, 1.4, 2000
RUN_S = 30.0  # ten periods of the slowest oscillation of the document's loop
WINDOW = round(RUN_S / 4.0 / TICK_S)


def growth(parameters, gains, delay_ms):
    """Return the predicted growth of the loop's motions per tick for each gain."""
    delays = replace(LoopDelays.of(parameters), actuator=delay_ms)
    return np.abs(SampledLoop(parameters, delays).poles(gains)).max(axis=-1)


def gain_limits(parameters, delay_ms, lowest, highest):
    """Return the gains in a range at which the loop changes between stable and unstable."""
    gains = np.linspace(lowest, highest, GAINS)
    rates = np.log(growth(parameters, gains, delay_ms))
    (before,) = np.nonzero(rates[1:] * rates[:-1] < 0.0)
    parts = rates[before] / (rates[before] - rates[before + 1])
    return gains[before] + parts * (gains[before + 1] - gains[before])


def changed(parameters, gain, delay_ms, pitch_deg):
    result = ParameterSet()
    result.update(parameters)
    result.set(CONTROLLER, 'pwm_gain', gain * parameters.of(ControllerParameters).pwm_gain)
    result.set(PLANT, 'actuator_delay', delay_ms)
    result.set(PLANT, 'start_pitch_x', math.radians(pitch_deg))
    return result


def is_stable(parameters, gain, delay_ms):
    """Return whether a run without rounding decays.

    The pitch at its start is so small that the duty can grow a thousandfold before it reaches its
    limit. It does not decay if the duty gets there, or if the largest duty of the last quarter is
    not smaller than that of the quarter before.
    """
    values = changed(parameters, gain, delay_ms, 1e-3)
    values.set(PLANT, 'hold_time', 0.0)
    ticks = round(RUN_S / TICK_S)
    duties = np.abs(run_unquantised(values, ticks, until_saturated=True).duties)
    if len(duties) < ticks:
        return False
    return duties[-WINDOW:].max() < duties[-2 * WINDOW : -WINDOW].max()


@pytest.mark.parametrize('delay_ms', [0, 1, 3, 4, 7, 8, 12])
def test_close_to_its_limits_the_loop_without_rounding_is_as_stable_as_predicted(delay_ms):
    parameters = ParameterSet()
    limits = gain_limits(parameters, delay_ms, LOWEST, HIGHEST)
    assert limits.size
    for gain in np.outer(limits, NEAR).ravel():
        (predicted,) = growth(parameters, np.array([gain]), delay_ms) < 1.0
        assert is_stable(parameters, gain, delay_ms) == predicted, gain


def test_the_gain_is_relative_to_that_of_the_parameters():
    parameters = ParameterSet()
    low, high = gain_limits(parameters, 0, LOWEST, HIGHEST)
    parameters.set(CONTROLLER, 'pwm_gain', 0.8)
    np.testing.assert_allclose(
        gain_limits(parameters, 0, 0.5, 1.5), [low / 0.8, high / 0.8], rtol=1e-4
    )
    assert is_stable(parameters, 1.2, 0)
    assert not is_stable(parameters, 1.4, 0)


def end_of_run(gain):
    """Return the last duties of plane x in a run of 15 s with rounding; None if the robot falls."""
    loop = ClosedLoop(changed(ParameterSet(), gain, 0, 0.5))
    duties = []
    for tick in loop.ticks(15.0):
        if loop.plant.fallen:
            return None
        duties.append(tick.outputs.duty[0])
    return np.array(duties[-2500:], float)


def test_rounding_keeps_a_stable_loop_moving():
    nominal, near_the_lower_limit, ringing = map(end_of_run, (1.0, 0.54, 1.1))
    assert 2.0 < nominal.std() < 10.0
    assert np.abs(nominal).max() < 100.0
    assert near_the_lower_limit.std() > 2.0 * nominal.std()
    assert np.mean(np.abs(ringing) == 100.0) > 0.5
    assert end_of_run(0.4) is None
