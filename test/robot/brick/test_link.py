"""The link between the brick's processors: the ages of its readings, and its phase."""

from collections import Counter

import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.parameters.timing import MILLISECOND_NS, TICK_NS
from ballbot_ros.robot.brick.link import (
    NO_LINK,
    Link,
    analog_age,
    drawn_link,
    is_sending,
    longest_analog_steps,
)

MS = MILLISECOND_NS

shares = st.floats(0.0, 1.0, exclude_max=True)
phases = st.sampled_from([0, 1])
periods_ms = st.floats(0.001, 20.0)
links = st.builds(drawn_link, phases, periods_ms, shares, shares, shares)
stamps = st.integers(0, 10**7).map(lambda number: number * MS)


def link_of(phase=0, converter_ms=3.1, converter=0.0):
    return drawn_link(phase, converter_ms, 0.0, converter, 0.0)


def test_a_link_sends_at_even_or_odd_milliseconds():
    assert [is_sending(link_of(0), number * MS) for number in range(4)] == [True, False] * 2
    assert [is_sending(link_of(1), number * MS) for number in range(4)] == [False, True] * 2


def test_ages_by_hand():
    # Conversions end at 1.0, 4.1, 7.2, 10.3 and 13.4 ms.
    link = Link(True, 0, 3_100_000, MS, 0)
    # At 4 ms, the frame is of 3 ms and has the values of 1 ms.
    expected = {4: 3.0, 5: 4.0, 6: 1.9, 7: 2.9, 8: 3.9, 9: 4.9, 10: 2.8, 11: 3.8, 12: 1.7}
    assert {at: analog_age(link, at * MS) / MS for at in expected} == expected


def test_a_frame_is_1_ms_old_where_the_link_sends_and_2_ms_where_it_reads():
    # Every frame has a value that was converted at its own time.
    for phase in (0, 1):
        link = Link(True, phase, MS, 0, 0)
        ages = [analog_age(link, number * MS) for number in range(8)]
        assert ages == ([MS, 2 * MS] if phase == 0 else [2 * MS, MS]) * 4


@given(links, stamps)
def test_an_age_is_that_of_the_newest_conversion_in_the_frame(link, stamp_ns):
    frame_ns = stamp_ns - (MS if is_sending(link, stamp_ns) else 2 * MS)
    measured_ns = stamp_ns - analog_age(link, stamp_ns)
    assert (measured_ns - link.converter_at_ns) % link.converter_ns == 0
    assert measured_ns <= frame_ns < measured_ns + link.converter_ns


@given(phases, periods_ms, shares, stamps)
def test_an_age_is_at_least_1_ms_and_less_than_2_ms_and_a_conversion(
    phase, period_ms, converter, stamp_ns
):
    link = link_of(phase, period_ms, converter)
    age_ns = analog_age(link, stamp_ns)
    assert MS <= age_ns < 2 * MS + link.converter_ns
    assert -(-age_ns // MS) <= longest_analog_steps(True, link.converter_ns / MS)


@pytest.mark.parametrize(
    ('period_ms', 'steps'), [(3.1, 6), (3.0, 5), (3.001, 6), (0.001, 3), (20.0, 22)]
)
def test_the_longest_age_in_steps(period_ms, steps):
    assert longest_analog_steps(True, period_ms) == steps
    assert longest_analog_steps(False, period_ms) == 0


@pytest.mark.parametrize('phase', [0, 1])
@pytest.mark.parametrize('period_ms', [3.1, 3.137, 2.9])
def test_all_ages_of_a_period_are_as_frequent(phase, period_ms):
    link = link_of(phase, period_ms, 0.3)
    frame_ns = MS if phase == 0 else 2 * MS
    count, parts = 4000, 10
    found = [analog_age(link, number * TICK_NS) - frame_ns for number in range(count)]
    assert all(0 <= age < link.converter_ns for age in found)
    parts_of_period = Counter(parts * age // link.converter_ns for age in found)
    assert sorted(parts_of_period) == list(range(parts))
    assert all(0.06 * count < each < 0.14 * count for each in parts_of_period.values())


def test_the_ages_at_the_ticks_step_through_the_converter_period():
    ages_us = [analog_age(link_of(), number * TICK_NS) // 1000 for number in range(31)]
    assert sorted(ages_us) == list(range(1000, 4100, 100))


@given(links, stamps)
def test_no_reading_measures_an_earlier_instant_than_the_one_before_it(link, start_ns):
    stamps_ns = [start_ns + number * MS for number in range(60)]
    instants = [stamp - analog_age(link, stamp) for stamp in stamps_ns]
    assert instants == sorted(instants)


@pytest.mark.parametrize('share', [0.0, 0.49, 0.5, 0.99])
def test_a_phase_of_minus_1_is_drawn(share):
    assert drawn_link(-1, 3.1, share, 0.0, 0.0).phase == (0 if share < 0.5 else 1)
    assert [drawn_link(phase, 3.1, share, 0.0, 0.0).phase for phase in (0, 1)] == [0, 1]


@given(periods_ms, shares)
def test_the_converter_ends_within_its_period_at_a_whole_microsecond(period_ms, share):
    link = link_of(0, period_ms, share)
    assert abs(link.converter_ns - period_ms * MS) <= 501
    assert link.converter_ns % 1000 == link.converter_at_ns % 1000 == 0
    assert 0 <= link.converter_at_ns < link.converter_ns
    assert abs(link.converter_at_ns - share * link.converter_ns) <= 1000


@given(shares)
def test_the_battery_voltage_is_from_2_to_12_ms_old(share):
    age_ns = drawn_link(0, 3.1, 0.0, 0.0, share).battery_age_ns
    assert age_ns % MS == 0
    assert 2 * MS <= age_ns < 12 * MS
    assert abs(age_ns - (2 + 10 * share) * MS) < MS + 1


def test_all_ages_of_the_battery_voltage_are_as_likely():
    drawn = [drawn_link(0, 3.1, 0.0, 0.0, number / 1000).battery_age_ns for number in range(1000)]
    assert Counter(drawn) == {age * MS: 100 for age in range(2, 12)}


def test_each_number_draws_its_own_part():
    plain = drawn_link(-1, 3.1, 0.0, 0.0, 0.0)
    assert plain == Link(True, 0, 3_100_000, 0, 2 * MS)
    assert drawn_link(-1, 3.1, 0.9, 0.0, 0.0) == plain._replace(phase=1)
    assert drawn_link(-1, 3.1, 0.0, 0.9, 0.0) == plain._replace(converter_at_ns=2_790_000)
    assert drawn_link(-1, 3.1, 0.0, 0.0, 0.9) == plain._replace(battery_age_ns=11 * MS)


def test_without_a_link_there_is_none():
    assert not NO_LINK.is_on
    assert NO_LINK.battery_age_ns == 0
