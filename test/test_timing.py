"""The start times of runs."""

from hypothesis import strategies as st
from laws import given

from ballbot_ros.parameters.timing import (
    BATTERY_PERIOD_NS,
    FIRST_TICK_NS,
    SLOW_PERIOD_NS,
    TICK_NS,
    next_start_ns,
)


def test_all_periods_are_in_phase_at_the_start_of_a_run():
    assert FIRST_TICK_NS == 1_000_000_000
    assert (TICK_NS, SLOW_PERIOD_NS, BATTERY_PERIOD_NS) == (4_000_000, 20_000_000, 100_000_000)
    assert all(
        FIRST_TICK_NS % period == 0 for period in (TICK_NS, SLOW_PERIOD_NS, BATTERY_PERIOD_NS)
    )


@given(st.integers(0, 10**15))
def test_a_new_run_begins_in_phase_and_later(now):
    start = next_start_ns(now)
    assert start > now
    assert start % BATTERY_PERIOD_NS == 0
    assert start - now <= 2 * BATTERY_PERIOD_NS
