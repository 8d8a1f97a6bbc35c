"""Margins against their definitions: at each the loop oscillates, within it does not."""

import math
from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest

from ballbot_ros.controllers.design import loop_analysis
from ballbot_ros.controllers.design.linear_model import ideal_loop
from ballbot_ros.controllers.design.loop_analysis import (
    LoopResponse,
    Pole,
    analyse_ideal,
    analyse_sampled,
    dead_time_margin_ms,
)
from ballbot_ros.controllers.design.sampled_loop import (
    ENCODER_ERROR,
    GYRO_ERROR,
    INPUTS,
    LoopDelays,
    SampledLoop,
)
from ballbot_ros.parameters import ControllerParameters, ParameterSet
from ballbot_ros.parameters.files import assign_values, read_parameter_file
from ballbot_ros.parameters.timing import TICK_S

CONFIG = Path(__file__).parents[3] / 'config'
TURN = 2.0 * math.pi

VARIANTS = [
    {},
    {'plant_sim.actuator_delay': 2, 'encoder_driver.delay': 4},
    {'controller.pwm_gain': 0.7, 'controller.a_gd': 0.998},
    {'plant_sim.body_mass': 0.9, 'plant_sim.actuator_delay': 1},
]
"""Stable loops."""


def parameters_with(values):
    parameters = ParameterSet()
    assign_values(parameters, values)
    return parameters


@pytest.fixture(scope='module', params=VARIANTS, ids=str)
def case(request):
    parameters = parameters_with(request.param)
    return parameters, SampledLoop(parameters), analyse_sampled(parameters)


@pytest.fixture(scope='module')
def ideal():
    parameters = ParameterSet()
    return ideal_loop(parameters), analyse_ideal(parameters).margins


def size(poles):
    return abs(np.asarray(poles)).max()


def slowest(loop, factor):
    """Return the largest real part of the poles in continuous time, with a factor of the loop."""
    return np.linalg.eigvals(loop.A - factor * loop.B @ loop.C).real.max()


# As it runs


def test_the_loop_is_stable_between_its_gains_only(case):
    _, loop, analysis = case
    low, high = analysis.margins.gain_low.value, analysis.margins.gain_high.value
    assert low < 1.0 < high
    for inside, outside in ((low * 1.001, low * 0.999), (high * 0.999, high * 1.001)):
        assert size(loop.poles(inside)) < 1.0 < size(loop.poles(outside))
    for gain in np.geomspace(low * 1.001, high * 0.999, 50):
        assert size(loop.poles(gain)) < 1.0


def test_at_the_limits_of_the_gain_it_oscillates_at_the_named_frequency(case):
    _, loop, analysis = case
    for limit in (analysis.margins.gain_low, analysis.margins.gain_high):
        pole = max(loop.poles(limit.value), key=abs)
        assert abs(pole) == pytest.approx(1.0, abs=1e-6)
        assert abs(np.angle(pole)) == pytest.approx(2.0 * math.pi * limit.hz * TICK_S, rel=1e-3)


def test_it_bears_a_lag_or_lead_up_to_its_phase_margin(case):
    _, loop, analysis = case
    margin = math.radians(analysis.margins.phase_deg.value)
    opened = loop.open_loop()

    def turned(angle):
        return size(np.linalg.eigvals(opened.A - np.exp(1j * angle) * opened.B @ opened.C))

    assert max(turned(0.99 * margin), turned(-0.99 * margin)) < 1.0
    assert max(turned(1.01 * margin), turned(-1.01 * margin)) > 1.0


@pytest.mark.parametrize('name', ['actuator', 'gyro', 'encoder'])
def test_it_bears_a_dead_time_up_to_its_margin(case, name):
    parameters, _, analysis = case
    delays = LoopDelays.of(parameters)
    margin = {
        'actuator': analysis.margins.dead_time_ms,
        'gyro': analysis.samples.gyro_dead_time_ms,
        'encoder': analysis.samples.encoder_dead_time_ms,
    }[name].value

    def delayed(extra):
        more = replace(delays, **{name: getattr(delays, name) + extra})
        return size(SampledLoop(parameters, more).poles())

    assert delayed(0.999 * margin) < 1.0 < delayed(1.001 * margin)
    for extra in np.linspace(0.0, 0.999 * margin, 20):
        assert delayed(extra) < 1.0


def test_the_sensitivity_peak_and_the_disk_margin_bound_each_other(case):
    _, loop, analysis = case
    peak, disk = analysis.margins.sensitivity.value, analysis.margins.disk
    # |S - 1/2| is within a half of |S|, and 1/disk is the largest |S - 1/2|.
    assert peak - 0.501 < 1.0 / disk < peak + 0.501
    response = LoopResponse(loop.open_loop())
    assert peak >= (1.0 / abs(1.0 + response.values)).max()


def test_gain_and_phase_may_change_together_within_the_disk(case):
    _, loop, analysis = case
    opened, half = loop.open_loop(), analysis.margins.disk / 2.0
    for angle in np.linspace(0.0, 2.0 * np.pi, 24):
        change = 0.99 * half * np.exp(1j * angle)
        factor = (1.0 + change) / (1.0 - change)
        assert size(np.linalg.eigvals(opened.A - factor * opened.B @ opened.C)) < 1.0


@pytest.mark.parametrize('source', [GYRO_ERROR, ENCODER_ERROR])
def test_white_noise_gives_the_predicted_duty(case, source):
    _, loop, analysis = case
    a, b = loop.closed()
    column = INPUTS.index(source)
    state, squares = b[:, column], loop.d[column] ** 2
    for _ in range(40_000):
        squares += (loop.c @ state) ** 2
        state = a @ state
    predicted = {
        GYRO_ERROR: analysis.samples.gyro_noise,
        ENCODER_ERROR: analysis.samples.encoder_noise,
    }[source]
    assert predicted == pytest.approx(math.sqrt(squares), rel=1e-6)


def test_the_documents_loop_as_it_runs():
    analysis = analyse_sampled(ParameterSet())
    margins = analysis.margins
    assert margins.gain_low.value == pytest.approx(0.523, abs=0.001)
    assert margins.gain_high == pytest.approx((1.0508, 125.0), abs=1e-4)
    assert margins.dead_time_ms == pytest.approx((3.458, 62.67), abs=0.01)
    assert analysis.ringing.value == pytest.approx(-0.9374, abs=1e-4)
    assert analysis.ringing.oscillation_hz == pytest.approx(125.0)
    samples = analysis.samples
    assert samples.gyro_dead_time_ms == pytest.approx((3.67, 56.9), abs=0.05)
    assert samples.encoder_dead_time_ms == pytest.approx((0.93, 125.0), abs=0.05)
    assert samples.rounding_noise == pytest.approx(16.31, abs=0.01)
    assert analysis.unstable is None


def test_a_pole_that_hardly_decays_does_not_hide_the_one_that_oscillates():
    analysis = analyse_sampled(parameters_with({'controller.k_i': -1e-7}))
    assert analysis.margins.dead_time_ms.hz == pytest.approx(62.7, abs=0.1)
    assert analysis.samples.gyro_dead_time_ms.hz == pytest.approx(56.9, abs=0.1)


def test_a_loop_that_is_not_stable_has_no_margins():
    analysis = analyse_sampled(parameters_with({'controller.pwm_gain': 1.1}))
    assert analysis.unstable.value == pytest.approx(-1.0605, abs=1e-4)
    assert (analysis.margins, analysis.samples) == (None, None)


def test_the_margin_of_the_dead_time_alone_is_that_of_the_analysis():
    draws, found = np.random.default_rng(1), []
    for gains in ('document', 'quiet'):
        shipped = read_parameter_file(CONFIG / f'gains/{gains}.yaml')
        for spread in (0.0, *[0.3] * 5):
            parameters = ParameterSet()
            parameters.update(shipped)
            factors = np.exp(spread * draws.standard_normal(4))
            k_f = np.array(shipped.of(ControllerParameters).k_f) * factors
            parameters.set('controller', 'k_f', k_f.tolist())
            found.append(dead_time_margin_ms(parameters))
            margins = analyse_sampled(parameters).margins
            assert found[-1] == (margins.dead_time_ms.value if margins else 0.0)
    assert 0.0 in found
    assert len(set(found)) > 5


def test_a_motion_that_never_decays_is_not_stable_but_does_not_grow():
    pole = analyse_sampled(parameters_with({'controller.a_gd': 1.0})).unstable
    assert pole.value == pytest.approx(1.0)
    assert not pole.is_growing


# Ideal


def test_an_optimal_loop_has_the_classical_margins(ideal):
    _, margins = ideal
    assert margins.gain_low.value < 0.5
    assert margins.gain_high.value == math.inf
    assert margins.phase_deg.value > 60.0
    assert margins.sensitivity.value == pytest.approx(1.0, abs=1e-6)


def test_the_ideal_loop_is_stable_between_its_gains_only(ideal):
    loop, margins = ideal
    low = margins.gain_low.value
    assert slowest(loop, 1.001 * low) < 0.0 < slowest(loop, 0.999 * low)
    assert slowest(loop, 1e4) < 0.0


def test_the_ideal_loop_bears_a_phase_lag_up_to_its_margin(ideal):
    loop, margins = ideal
    margin = math.radians(margins.phase_deg.value)
    assert slowest(loop, np.exp(-0.99j * margin)) < 0.0 < slowest(loop, np.exp(-1.01j * margin))


def test_the_ideal_loop_bears_a_dead_time_up_to_its_margin(ideal):
    loop, margins = ideal

    def slowest_pole(delay_ms):
        dead_time = control.tf2ss(*control.pade(delay_ms * 1e-3, 6))
        return control.feedback(control.series(dead_time, loop)).poles().real.max()

    margin = margins.dead_time_ms.value
    assert slowest_pole(0.97 * margin) < 0.0 < slowest_pole(1.03 * margin)


def test_an_integral_that_is_not_used_is_no_part_of_the_ideal_loop():
    analysis = analyse_ideal(parameters_with({'controller.k_i': 0.0}))
    assert len(analysis.poles) == 4
    assert analysis.unstable is None


@pytest.mark.parametrize(('value', 'dt', 'hz', 'oscillation_hz', 'damping'), [
    (complex(-3.0, 4.0), 0.0, 5.0 / (2.0 * math.pi), 4.0 / (2.0 * math.pi), 0.6),
    (complex(-1.0), 0.004, 125.0, 125.0, 0.0),
    (complex(-20.0), 0.004, math.hypot(125.0, math.log(20.0) / 0.004 / TURN), 125.0, -0.69),
    (complex(0.5), 0.004, math.log(2.0) / 0.004 / TURN, 0.0, 1.0),
    (complex(2.0), 0.004, math.log(2.0) / 0.004 / TURN, 0.0, -1.0),
    (complex(0.0, 1.0), 0.004, 62.5, 62.5, 0.0),
    (complex(0.0), 0.0, 0.0, 0.0, 0.0),
])  # fmt: skip
def test_the_motion_of_a_pole(value, dt, hz, oscillation_hz, damping):
    pole = Pole.of(value, dt)
    assert (pole.hz, pole.oscillation_hz) == pytest.approx((hz, oscillation_hz))
    assert pole.damping == pytest.approx(damping, abs=0.005)


def test_beyond_the_longest_dead_time_that_is_tried_there_is_no_limit(monkeypatch):
    monkeypatch.setattr(loop_analysis, 'MAX_DEAD_TIME_MS', 2.0)
    analysis = analyse_sampled(ParameterSet())
    assert analysis.margins.dead_time_ms.value == math.inf
    assert analysis.samples.encoder_dead_time_ms.value == pytest.approx(0.93, abs=0.01)
