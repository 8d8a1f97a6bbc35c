"""Limit cycles: found in what goes on and on, not in noise, ringing, transients or a drive."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.analysis.limit_cycle import find_limit_cycle, limit_cycles
from ballbot_ros.analysis.loop_summary import PredictedFrequency
from ballbot_ros.analysis.observations import limit_cycle_sentences
from ballbot_ros.analysis.report import loop_of
from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.engine.scenario.scenario import ScheduledPush
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.recording.messages.topics import CONTROLLER_STATE, MOTOR_DUTY


def wave(hz, seconds=20.0, phase=0.3):
    return np.sin(2.0 * np.pi * hz * TICK_S * np.arange(round(seconds / TICK_S)) + phase)


def noise(seconds=20.0, seed=1):
    return np.random.default_rng(seed).normal(size=round(seconds / TICK_S))


@given(st.floats(0.4, 120.0), st.floats(3.0, 100.0), st.floats(0.0, 0.2), st.integers(0, 1000))
def test_a_sine_in_noise_is_found(hz, amplitude, noisiness, seed):
    duty = amplitude * (wave(hz) + noisiness * noise(seed=seed))
    found = find_limit_cycle(duty, 0.01 * amplitude * wave(hz, phase=1.0))
    assert found.hz == pytest.approx(hz, rel=0.02)
    assert 0.9 * amplitude < found.duty < (1.05 + noisiness) * amplitude
    assert found.pitch == pytest.approx(0.01 * amplitude, rel=0.1)


@pytest.mark.parametrize('ticks', [2500, 2501])
def test_a_duty_that_alternates_is_a_cycle_of_half_the_sampling_rate(ticks):
    duty = 63.0 * (-1.0) ** np.arange(ticks)
    found = find_limit_cycle(duty, 0.001 * duty)
    assert found.hz == pytest.approx(125.0)
    assert found.duty == pytest.approx(63.0, rel=1e-4)
    assert found.pitch == pytest.approx(0.063, rel=1e-4)
    assert found.share == pytest.approx(1.0, rel=1e-4)


def test_the_amplitude_of_a_square_wave_is_its_height():
    duty = 20.0 * np.sign(wave(2.0))
    assert find_limit_cycle(duty, duty).duty == pytest.approx(20.0, rel=0.25)


def ringing(damping, hz=125.0, seconds=40.0, seed=3):
    """Return noise through a pole with a low damping."""
    radius = np.exp(-damping * 2.0 * np.pi * hz * TICK_S)
    values = np.zeros(round(seconds / TICK_S))
    random = np.random.default_rng(seed).normal(size=len(values))
    for tick in range(1, len(values)):
        values[tick] = -radius * values[tick - 1] + random[tick]
    return 10.0 * values


@pytest.mark.parametrize('duty', [
    np.zeros(2500),
    np.full(2500, 7.0),
    10.0 * noise(),
    10.0 * np.cumsum(noise()),
    30.0 * wave(3.0) * np.exp(-np.arange(5000) / 1000.0),
    30.0 * wave(3.0) * np.exp(np.arange(5000) / 1000.0 - 5.0),
    np.concatenate([np.zeros(3000), 30.0 * wave(3.0, 8.0)]),
    0.4 * wave(3.0),
    30.0 * wave(0.1),
    ringing(0.0206),
    np.zeros(0),
    np.ones(1),
    np.arange(3.0),
], ids=[
    'rest', 'constant', 'noise', 'wandering', 'fading', 'growing', 'late', 'less than a percent',
    'too few cycles', 'ringing', 'nothing', 'one tick', 'three ticks',
])  # fmt: skip
def test_what_does_not_go_on_is_no_limit_cycle(duty):
    assert find_limit_cycle(duty, duty) is None


@pytest.fixture(scope='module')
def unstable(make_run):
    path, _ = make_run('stationary', '--set=controller.pwm_gain=1.1')
    return read_run(path)


def test_the_unstable_loop_has_a_limit_cycle_where_it_is_predicted(unstable):
    x, y = limit_cycles(unstable)
    assert (x.hz, y) == (pytest.approx(125.0, rel=1e-3), None)
    assert 80.0 < x.duty <= 100.0
    predicted = loop_of(unstable).predictions
    (sentence,) = limit_cycle_sentences(unstable, predicted)
    assert sentence.startswith('Limit cycle at 125 Hz in plane x: duty ±')
    assert sentence.endswith('The nearest predicted frequency is 125 Hz (grows).')
    (sentence,) = limit_cycle_sentences(unstable, [])
    assert 'predicted' not in sentence


def test_the_nearest_prediction_is_nearest_in_octaves(unstable):
    predicted = [PredictedFrequency(90.0, 'nearer'), PredictedFrequency(175.0, 'farther')]
    (sentence,) = limit_cycle_sentences(unstable, predicted)
    assert sentence.endswith('90 Hz (nearer).') == (125.0 / 90.0 < 175.0 / 125.0)
    (sentence,) = limit_cycle_sentences(unstable, [PredictedFrequency(60.0, 'an octave away')])
    assert 'predicted' not in sentence


def test_a_run_of_the_documents_loop_has_none(short_assessment):
    none = 'No limit cycle found above 4 Hz.'
    assert limit_cycle_sentences(short_assessment.run, []) == [none]
    predicted = [PredictedFrequency(125.0, 'rings'), PredictedFrequency(3.0, '2 times the gain')]
    (explained,) = limit_cycle_sentences(short_assessment.run, predicted)
    assert explained.startswith(f'{none} The linear model of the loop rings at 125 Hz: ')
    assert explained.endswith('dies away after each disturbance, whereas a limit cycle lasts.')


def test_an_oscillation_that_is_driven_is_none(unstable):
    state = unstable.series[CONTROLLER_STATE]
    values = state.values.astype(float).copy()
    values[:, 8] = 0.2 * (-1.0) ** np.arange(len(values))
    driven = replace(state, values=values)
    run = replace(unstable, series={**unstable.series, CONTROLLER_STATE: driven})
    assert limit_cycles(run) == (None, None)


def test_after_a_push_is_the_time_that_counts(unstable):
    def pushed(end):
        pushes = (ScheduledPush(end - 0.1, 0.1, force=1.0),)
        scenario = replace(unstable.attached.scenario, pushes=pushes)
        return replace(unstable, attached=replace(unstable.attached, scenario=scenario))

    assert limit_cycle_sentences(pushed(8.0), [])[0].startswith('Limit cycle at 125 Hz')
    assert limit_cycle_sentences(pushed(9.99), []) == []


@pytest.mark.parametrize('missing', [MOTOR_DUTY, CONTROLLER_STATE])
def test_without_what_tells_nothing_is_observed(unstable, missing):
    series = {topic: each for topic, each in unstable.series.items() if topic is not missing}
    assert limit_cycle_sentences(replace(unstable, series=series), []) == []
