"""Stick signals."""

import math

import pytest
from hypothesis import strategies as st
from laws import given
from parts import step, steps

from ballbot_ros.engine.scenario.scenario import Segment, StickSignal

whole = st.integers(-100, 100)
milliseconds = st.lists(st.integers(0, 10_000), min_size=2, max_size=8).map(sorted)
segments = (
    milliseconds.filter(lambda times: times[0] < times[-1])
    .flatmap(
        lambda times: st.lists(whole, min_size=len(times), max_size=len(times)).map(
            lambda values: [(t / 1000, v) for t, v in zip(times, values, strict=True)]
        )
    )
    .map(lambda points: Segment('drawn', points))
)


def shifted(segment, seconds, sign=1):
    return Segment(segment.name, [(t + seconds, sign * v) for t, v in segment.points])


def test_no_signal_is_a_neutral_stick():
    assert [StickSignal().at(time) for time in (0.0, 1.0, 1e6)] == [0, 0, 0]


def test_outside_its_segments_a_stick_is_neutral():
    signal = StickSignal(
        [Segment('a', [(1.0, 50), (2.0, 50)]), Segment('b', [(3.0, -30), (4.0, -30)])]
    )
    times = (0.0, 0.999, 1.0, 1.999, 2.0, 2.999, 3.0, 3.999, 4.0, 1e6)
    assert [signal.at(time) for time in times] == [0, 0, 50, 50, 0, 0, -30, -30, 0, 0]


def test_a_segment_without_end_lasts():
    assert [step(1.0, 70).at(time) for time in (0.999, 1.0, 1e6)] == [0, 70, 70]


def test_where_two_segments_meet_the_later_one_acts():
    signal = steps((1.0, 80), (2.0, -80), (3.0, 0))
    assert [signal.at(time) for time in (1.0, 1.999, 2.0, 2.999, 3.0)] == [80, 80, -80, -80, 0]


def test_it_is_straight_between_two_points():
    signal = StickSignal([Segment('line', [(1.0, 0), (3.0, -100)])])
    assert [signal.at(1.0 + n / 10) for n in range(20)] == [-5 * n for n in range(20)]
    assert signal.at(3.0) == 0


def test_two_points_at_one_time_are_a_step():
    signal = StickSignal([Segment('stairs', [(0.0, 0), (1.0, 0), (1.0, 80), (2.0, 80), (2.0, 40)])])
    assert [signal.at(time) for time in (0.999, 1.0, 1.5, 1.999, 2.0)] == [0, 80, 80, 80, 0]


def test_values_between_are_rounded_half_up():
    signal = StickSignal([Segment('line', [(0.0, -1), (2.0, 1)])])
    assert [signal.at(time) for time in (0.25, 0.5, 0.75, 1.25, 1.5)] == [-1, 0, 0, 0, 1]


@given(segments)
def test_it_goes_through_its_points(segment):
    signal = StickSignal([segment])
    for index, (time, value) in enumerate(segment.points[:-1]):
        if time < segment.points[index + 1][0]:
            assert signal.at(time) == value


@given(segments, st.floats(0.0, 20.0))
def test_it_stays_between_the_values_of_its_points(segment, time):
    values = [0, *(value for _, value in segment.points)]
    at = StickSignal([segment]).at(time)
    assert isinstance(at, int)
    assert min(values) <= at <= max(values)


@given(segments, segments, st.floats(0.0, 30.0))
def test_a_signal_is_the_sum_of_its_segments(one, other, time):
    other = shifted(other, one.end)
    assert StickSignal([one, other]).at(time) == StickSignal([one]).at(time) + StickSignal(
        [other]
    ).at(time)


@given(segments, st.floats(0.0, 10.0))
def test_the_mirrored_signal_is_the_mirror_up_to_rounding(segment, time):
    mirrored = StickSignal([shifted(segment, 0.0, sign=-1)])
    assert abs(mirrored.at(time) + StickSignal([segment]).at(time)) <= 1


def test_a_segment_has_its_start_and_end():
    segment = Segment('a', [(1.0, 0), (2.0, 5), (4.5, 0)])
    assert (segment.start, segment.end) == (1.0, 4.5)
    assert step(1.0, 3).segments[0].end == math.inf


@pytest.mark.parametrize('time', [0.0, 0.5, 1.0])
def test_a_segment_that_begins_at_zero_acts_from_the_first_tick_on(time):
    assert step(0.0, -100).at(time) == -100
