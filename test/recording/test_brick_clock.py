"""Stamps of a brick's packets: the steps of its clock, at the time of the PC."""

from dataclasses import replace

import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.recording.brick_clock import BrickClock
from ballbot_ros.robot.brick.bluetooth import LogPacket

MS, S = 10**6, 10**9
PACKET = LogPacket(0, 0, 0, 8000, 0, 0, 0, 0, 0, 0, 0, 255)


def packets(*times_ms):
    return [replace(PACKET, time_ms=time_ms % 2**32) for time_ms in times_ms]


def stamps(clock, now_ns, *times_ms):
    """Return stamp [ns] and whether a run begins, of packets of which the last one arrives now."""
    return [each[1:] for each in clock.stamped(packets(*times_ms), now_ns)]


def test_the_last_packet_of_the_first_ones_arrives_now():
    assert stamps(BrickClock(), 100 * S, 2000, 2100) == [
        (100 * S - 100 * MS, True),
        (100 * S, False),
    ]


@given(st.lists(st.tuples(st.integers(4, 1500), st.integers(0, 1500)), max_size=20))
def test_the_radio_delays_no_stamp(steps):
    """The delays [ms] differ; the stamps have the steps of the brick's clock, also as it wraps."""
    clock, brick_ms = BrickClock(), 2**32 - 5000
    ((first_ns, begins),) = stamps(clock, 50 * S, brick_ms)
    assert begins
    elapsed_ms = 0
    for step_ms, delay_ms in steps:
        elapsed_ms += step_ms
        now_ns = 50 * S + (elapsed_ms + delay_ms) * MS
        assert stamps(clock, now_ns, brick_ms + elapsed_ms) == [(first_ns + elapsed_ms * MS, False)]


@pytest.mark.parametrize(
    ('pause_s', 'brick_ms', 'begins'),
    [
        (7.0, 9000, False),  # the same program, which has gone on meanwhile
        (7.0, 1000, True),  # started again
        (7.0, 400_000, True),  # another brick
    ],
)
def test_a_program_can_start_again_while_there_is_no_connection(pause_s, brick_ms, begins):
    clock = BrickClock()
    stamps(clock, 100 * S, 2000)
    clock.on_connection()
    now_ns = round((100 + pause_s) * S)
    assert stamps(clock, now_ns, brick_ms) == [(now_ns, begins)]


def test_a_radio_that_stalls_for_seconds_delays_no_stamp():
    """The packets come together, or one by one."""
    clock = BrickClock()
    stamps(clock, 100 * S, 2000)
    times_ms = [*range(2100, 9000, 100)]
    found = stamps(clock, 110 * S, *times_ms)
    assert found == [(100 * S + (ms - 2000) * MS, False) for ms in times_ms]
    assert stamps(clock, 110 * S, 9000) == [(107 * S, False)]


def test_a_wrong_clock_in_between_begins_no_run_and_stamps_still_increase():
    clock = BrickClock()
    stamps(clock, 100 * S, 2000)
    assert stamps(clock, 100 * S + 100 * MS, 99_000_000) == [(100 * S + 100 * MS, False)]
    assert stamps(clock, 100 * S + 200 * MS, 2200) == [(100 * S + 200 * MS, False)]
