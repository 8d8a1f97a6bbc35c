"""Stick signals."""

from hypothesis import strategies as st
from laws import given

from ballbot_ros.scenario.signal import Signal

whole = st.integers(-100, 100)
times = st.lists(st.integers(0, 10_000), min_size=1, max_size=8).map(sorted)
signals = times.flatmap(
    lambda ms: st.lists(whole, min_size=len(ms), max_size=len(ms)).map(
        lambda values: Signal([(t / 1000, v) for t, v in zip(ms, values, strict=True)])
    )
)


def test_no_signal_is_a_neutral_stick():
    assert [Signal().at(time) for time in (0.0, 1.0, 1e6)] == [0, 0, 0]


def test_it_is_zero_before_the_first_point_and_keeps_the_last_value():
    signal = Signal([(1.0, 50), (2.0, -30)])
    assert [signal.at(time) for time in (0.0, 0.999, 2.0, 2.001, 1e6)] == [0, 0, -30, -30, -30]


def test_it_is_straight_between_two_points():
    signal = Signal([(1.0, 0), (3.0, -100)])
    assert [signal.at(1.0 + n / 10) for n in range(21)] == [-5 * n for n in range(21)]


def test_two_points_at_one_time_are_a_step():
    signal = Signal([(0.0, 0), (1.0, 0), (1.0, 80), (2.0, 80), (2.0, -80)])
    assert [signal.at(time) for time in (0.999, 1.0, 1.5, 1.999, 2.0, 3.0)] == [
        0,
        80,
        80,
        80,
        -80,
        -80,
    ]


def test_values_between_are_rounded_half_up():
    signal = Signal([(0.0, -1), (2.0, 1)])
    assert [signal.at(time) for time in (0.25, 0.5, 0.75, 1.25, 1.5)] == [-1, 0, 0, 0, 1]


@given(signals)
def test_it_goes_through_its_points(signal):
    for index, (time, value) in enumerate(signal.points):
        is_last_at_this_time = all(time < later for later, _ in signal.points[index + 1 :])
        if is_last_at_this_time:
            assert signal.at(time) == value


@given(signals, st.floats(0.0, 20.0))
def test_it_stays_between_the_values_of_its_points(signal, time):
    values = [0, *(value for _, value in signal.points)]
    at = signal.at(time)
    assert isinstance(at, int)
    assert min(values) <= at <= max(values)


@given(signals, st.floats(0.0, 10.0))
def test_the_mirrored_signal_is_the_mirror_up_to_rounding(signal, time):
    mirrored = Signal([(t, -v) for t, v in signal.points])
    assert abs(mirrored.at(time) + signal.at(time)) <= 1
