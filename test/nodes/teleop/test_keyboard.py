"""Keys that are pressed and repeated, without reports of their release."""

import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.nodes.teleop.terminal import HELD_S, KeyboardSticks


@pytest.fixture
def keys():
    return KeyboardSticks(100)


@pytest.mark.parametrize(
    ('arrow', 'sticks'),
    [('up', (-50, 0)), ('down', (50, 0)), ('left', (0, -50)), ('right', (0, 50))],
)
def test_an_arrow_counts_as_held_for_half_a_second(keys, arrow, sticks):
    assert keys.sticks(0.0) == (0, 0)
    keys.arrow(arrow, 1.0)
    assert keys.sticks(1.0) == sticks
    assert keys.sticks(1.0 + HELD_S) == sticks
    assert keys.sticks(1.01 + HELD_S) == (0, 0)


def test_a_repeated_arrow_stays_held(keys):
    for tick in range(100):
        keys.arrow('up', tick * 0.03)
        assert keys.sticks(tick * 0.03) == (-50, 0)


def test_arrows_of_both_sticks_make_a_diagonal_and_opposite_ones_replace_each_other(keys):
    keys.arrow('up', 0.0)
    keys.arrow('right', 0.3)
    assert keys.sticks(0.4) == (-50, 50)
    keys.arrow('left', 0.4)
    assert keys.sticks(0.45) == (-50, -50)
    assert keys.sticks(0.6) == (0, -50)


def test_hold_keeps_the_direction_until_stop_or_another_arrow(keys):
    keys.arrow('up', 0.0)
    keys.hold(0.1)
    assert keys.holds
    assert keys.sticks(60.0) == (-50, 0)
    keys.change_speed(1)
    assert keys.sticks(60.0) == (-60, 0)
    keys.arrow('left', 61.0)
    assert not keys.holds
    assert keys.sticks(61.0) == (0, -60)
    keys.hold(61.1)
    keys.stop()
    assert keys.sticks(61.1) == (0, 0)


def test_hold_has_no_effect_without_a_direction(keys):
    keys.arrow('up', 0.0)
    keys.hold(1.0)
    assert not keys.holds
    assert keys.sticks(1.0) == (0, 0)


def test_the_key_speed_stays_between_one_step_and_full(keys):
    speeds = []
    for step in [1] * 7 + [-1] * 12:
        keys.change_speed(step)
        speeds.append(keys.speed_percent)
    assert max(speeds) == 100
    assert min(speeds) == speeds[-1] == 10


@given(
    st.lists(
        st.sampled_from(['up', 'down', 'left', 'right', 'hold', 'stop', '+', '-']), max_size=30
    ),
    st.integers(1, 127),
)
def test_no_sequence_of_keys_exceeds_the_full_stick(names, full):
    keys = KeyboardSticks(full)
    for number, name in enumerate(names):
        now = number * 0.2
        if name in ('+', '-'):
            keys.change_speed(1 if name == '+' else -1)
        elif name == 'hold':
            keys.hold(now)
        elif name == 'stop':
            keys.stop()
            assert keys.sticks(now) == (0, 0)
        else:
            keys.arrow(name, now)
        assert all(abs(value) <= full for value in keys.sticks(now))
