"""Segments lie in usable time, without gaps and overlaps, and begin with the gears in contact."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.analysis.identification.experiment import ENCODER, Experiment
from ballbot_ros.analysis.identification.segments import MAX_SEGMENTS, TURNING_READINGS, cut
from ballbot_ros.analysis.identification.segments import SEGMENT_TICKS as LENGTH
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.parameters.timing import STEPS_PER_TICK, TICK_S

GEAR_PLAY = 0.07
PLAY_OR_NOT = st.sampled_from([0.0, GEAR_PLAY])


def make_experiment(usable, *, turns=None, seed=1, **of):
    """Return an experiment with random duties and with encoders that turn by `turns`."""
    count = len(usable)
    random = np.random.default_rng(seed)
    encoder = np.zeros((count, 2)) if turns is None else np.cumsum(turns, axis=0, dtype=float)
    return Experiment(
        name='test',
        plant=PlantParameters(**of),
        duty=random.integers(-100, 101, (count, 2)).astype(float),
        readings={ENCODER: encoder},
        battery=np.full(count, 8.0),
        battery_count=0.0,
        usable=np.array(usable, np.bool_),
    )


def pieces(draw, values, count, longest):
    """Return `count` values in pieces of up to `longest` that are equal."""
    found = []
    while len(found) < count:
        found += [draw(values)] * draw(st.integers(1, longest))
    return np.array(found[:count])


@st.composite
def experiments(draw, backlash=PLAY_OR_NOT):
    count = draw(st.integers(0, 1500))
    usable = pieces(draw, st.sampled_from([True, True, True, False]), count, 500)
    turns = [pieces(draw, st.integers(-2, 2), count, 60) for _ in range(2)]
    return make_experiment(
        usable,
        turns=np.stack(turns, axis=1),
        seed=draw(st.integers(0, 1000)),
        backlash=draw(backlash),
        actuator_delay=draw(st.integers(0, 20)),
    )


@given(experiments())
def test_segments_are_equally_long_and_do_not_overlap(experiment):
    segments = cut(experiment)
    assert segments.length == LENGTH
    assert (np.diff(segments.starts) >= LENGTH).all()
    assert segments.seconds == pytest.approx(segments.count * LENGTH * TICK_S)
    for values in (*segments.readings.values(), segments.battery, segments.duty):
        assert len(values) == segments.count


@given(experiments())
def test_segments_lie_in_usable_time_with_the_duties_that_act_in_them(experiment):
    delay = experiment.plant.actuator_delay
    segments = cut(experiment)
    for start, duty, before in zip(
        segments.starts, segments.duty, segments.duty_before, strict=True
    ):
        steps = start * STEPS_PER_TICK + np.arange(-1, LENGTH * STEPS_PER_TICK)
        ticks = (steps - delay) // STEPS_PER_TICK
        assert ticks[0] >= 0
        assert experiment.usable[ticks[0] : start + LENGTH].all()
        np.testing.assert_array_equal(np.vstack([before, duty]), experiment.duty[ticks])


@given(experiments())
def test_segments_hold_the_readings_from_their_starts(experiment):
    segments = cut(experiment)
    for start, readings in zip(segments.starts, segments.readings[ENCODER], strict=True):
        expected = experiment.readings[ENCODER][start : start + LENGTH]
        np.testing.assert_array_equal(readings, expected)


@given(experiments(backlash=st.just(GEAR_PLAY)))
def test_with_gear_play_both_encoders_turn_one_way_before_a_segment(experiment):
    segments = cut(experiment)
    for start, contact in zip(segments.starts, segments.contact, strict=True):
        shown = experiment.readings[ENCODER][start - TURNING_READINGS : start + 1]
        for turns, side in zip(np.sign(np.diff(shown, axis=0)).T, contact, strict=True):
            assert set(turns) == {-side}


def test_gears_without_play_need_not_turn():
    still = np.ones(3 * LENGTH + 10, np.bool_)
    assert cut(make_experiment(still)).count == 3
    assert cut(make_experiment(still, backlash=GEAR_PLAY)).count == 0


def test_readings_that_show_a_time_before_their_segment_are_missing():
    experiment = make_experiment(np.ones(3 * LENGTH, np.bool_))
    for age, missing in ((0, 0), (1, 1), (4, 1), (5, 2)):
        readings = cut(replace(experiment, ages={ENCODER: age})).readings[ENCODER]
        assert np.isnan(readings[:, :missing]).all(), age
        assert not np.isnan(readings[:, missing:]).any(), age


def test_segments_of_a_long_experiment_are_spread_evenly():
    whole = 2.5 * MAX_SEGMENTS
    experiment = make_experiment(np.ones(round(whole * LENGTH) + 10, np.bool_))
    segments = cut(experiment)
    assert segments.count == MAX_SEGMENTS
    assert segments.starts[0] < LENGTH
    assert segments.starts[-1] >= (whole - 1.0) * LENGTH
    assert set(np.diff(segments.starts)) <= {2 * LENGTH, 3 * LENGTH}


@pytest.mark.parametrize(
    'usable',
    [
        np.zeros(0, np.bool_),
        np.zeros(2000, np.bool_),
        np.arange(2000) % LENGTH > 0,
        np.ones(LENGTH, np.bool_),
    ],
)
def test_where_nothing_is_usable_there_is_no_segment(usable):
    segments = cut(make_experiment(usable))
    assert (segments.count, segments.length, segments.seconds) == (0, LENGTH, 0.0)


def test_dropped_segments_are_gone_from_all_parts():
    segments = cut(make_experiment(np.ones(6 * LENGTH, np.bool_)))
    dropped = np.arange(segments.count) == 1
    left = segments.without(dropped)
    assert left.count == segments.count - 1
    np.testing.assert_array_equal(left.starts, segments.starts[~dropped])
    np.testing.assert_array_equal(left.duty, segments.duty[~dropped])
    np.testing.assert_array_equal(left.duty_before, segments.duty_before[~dropped])
    np.testing.assert_array_equal(left.battery, segments.battery[~dropped])
    np.testing.assert_array_equal(left.contact, segments.contact[~dropped])
    np.testing.assert_array_equal(left.readings[ENCODER], segments.readings[ENCODER][~dropped])
