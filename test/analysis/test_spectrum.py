"""The spectrum of a run: its density is a variance per Hz, and its marks are the predictions."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot_ros.analysis.figure_parts import Interval
from ballbot_ros.analysis.limit_cycle import (
    balancing_ticks,
    draw_spectrum,
    power_density,
    spectrum_table,
)
from ballbot_ros.analysis.loop_summary import PredictedFrequency
from ballbot_ros.analysis.report import loop_of
from ballbot_ros.engine.trajectory import Trajectory
from ballbot_ros.parameters import ParameterSet

RATE_HZ = 250.0


@pytest.mark.parametrize('hz', [2.5, 60.0, 124.0, 125.0])
def test_the_integral_of_the_density_is_the_variance(hz):
    time = np.arange(20_000) / RATE_HZ
    wave = 3.0 * np.cos(2.0 * np.pi * hz * time)
    noise = np.random.default_rng(1).normal(size=len(time))
    for values in (wave, noise, wave + noise):
        frequency, power = power_density(values, 1000)
        assert power.sum() * frequency[1] == pytest.approx(values.var(), rel=0.03)
    frequency, power = power_density(wave, 1000)
    assert abs(frequency[power.argmax()] - hz) < 1e-9


def balancing(run):
    """Return begin and end of the longest time of balancing [s]; nothing if there is none."""
    time = run.trajectory.time[balancing_ticks(run)]
    return (time[0], time[-1]) if len(time) else ()


def test_the_longest_time_of_balancing_has_no_gap(short_assessment):
    run = short_assessment.run
    assert balancing(run) == pytest.approx((1.004, 2.996))
    kept = np.delete(np.arange(len(run.trajectory.time)), 400)
    columns = {name: value for name, value in vars(run.trajectory).items() if len(value)}
    gap = Trajectory(**{name: column[kept] for name, column in columns.items()})
    assert balancing(replace(run, trajectory=gap)) == pytest.approx((1.604, 2.996))
    lost = (Interval(2.0, 3.0, 'out_of_control'),)
    assert balancing(replace(run, states=lost)) == pytest.approx((1.0, 1.996))
    never = (Interval(0.0, 3.0, 'calibration'),)
    assert balancing(replace(run, states=never)) == ()
    assert spectrum_table(replace(run, states=never)) == {}


@pytest.mark.parametrize('case', ['predicted', 'nothing predicted', 'at rest'])
def test_the_predictions_are_named_above_the_curves(short_assessment, case):
    predicted = loop_of(short_assessment.run).predictions if case == 'predicted' else []
    table = dict(spectrum_table(short_assessment.run))
    if case == 'at rest':
        table |= {name: 0.0 * values for name, values in table.items() if name != 'frequency_hz'}
    figure = draw_spectrum(table, predicted)
    figure.draw_without_rendering()
    strip, *rows = figure.axes
    names = [text.get_text() for text in strip.texts]
    if case != 'predicted':
        assert names == []
        return
    assert names == [
        '0.343 Hz: 0.523 times the gain',
        '56.9 Hz: 3.67 ms more dead time of the gyro',
        '62.7 Hz: 3.46 ms more dead time of the motors',
        '125 Hz: 0.93 ms more dead time of the encoders',
        '125 Hz: 1.05 times the gain',
        '125 Hz: rings',
    ]
    boxes = [text.get_window_extent() for text in strip.texts]
    for number, box in enumerate(boxes):
        assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1
        assert not any(box.overlaps(other) for other in boxes[:number])
        assert not any(box.overlaps(axes.bbox) for axes in rows)
    for axes in rows:
        marks = [line.get_xdata()[0] for line in axes.lines if line.get_linestyle() == ':']
        assert sorted(marks) == pytest.approx(sorted(each.hz for each in predicted))


def test_a_loop_that_grows_predicts_only_that(short_assessment):
    run = short_assessment.run
    parameters = ParameterSet()
    parameters.set('plant_sim', 'actuator_delay', 4)
    loop = loop_of(replace(run, attached=replace(run.attached, parameters=parameters)))
    (only,) = loop.predictions
    assert isinstance(only, PredictedFrequency)
    assert (round(only.hz, 1), only.reason) == (57.9, 'grows')
