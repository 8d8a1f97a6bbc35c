"""Dead time is a function of parameters, seed and stamp, and samples never go back in time."""

import random

import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.brick.dead_time import DeadTime, drawn_delay, mean_delay, sample_age
from ballbot_ros.plant.delayed_duty import DelayedDuty
from ballbot_ros.timing import SLOW_PERIOD_NS, STEP_NS, TICK_NS

FIRST = 250

steps = st.integers(0, 100)
seeds = st.integers(0, 2**63 - 1)
periods = st.sampled_from([TICK_NS, SLOW_PERIOD_NS])


def ages(delay, jitter, seed=1, device='gyro', period_ns=TICK_NS, count=600):
    dead_time = DeadTime(device, period_ns, delay, jitter, seed)
    return [dead_time.age((FIRST + number) * period_ns) for number in range(count)]


@given(steps, steps, st.integers(0, 2**53 - 1))
def test_a_drawn_delay_is_within_its_bounds(delay, jitter, bits):
    assert delay <= drawn_delay(delay, jitter, bits / 2**53) <= delay + jitter


def test_all_delays_are_equally_likely():
    dead_time = DeadTime('actuator', TICK_NS, 3, 4, 1)
    drawn = [dead_time.delay(number * TICK_NS) for number in range(10_000)]
    assert [round(drawn.count(delay) / 1e4, 1) for delay in range(2, 9)] == [0, *5 * [0.2], 0]


@given(steps, seeds, periods)
def test_without_jitter_every_sample_has_the_same_age(delay, seed, period_ns):
    assert ages(delay, 0, seed, period_ns=period_ns, count=9) == [delay] * 9


@pytest.mark.parametrize(('delay', 'jitter'), [(3, 0), (0, 1), (2, 4), (0, 12), (7, 50)])
@pytest.mark.parametrize('period_ns', [TICK_NS, SLOW_PERIOD_NS])
def test_the_mean_is_that_of_many_samples(delay, jitter, period_ns):
    drawn = ages(delay, jitter, period_ns=period_ns, count=20_000)
    mean = mean_delay(delay, jitter, period_ns // STEP_NS)
    assert mean == pytest.approx(sum(drawn) / len(drawn), rel=0.02)
    assert delay <= mean < delay + jitter / 2.0 + 1e-9


@pytest.mark.parametrize(('delay', 'jitter'), [(3, 0), (0, 5), (2, 9), (0, 40)])
def test_the_duty_that_acts_has_the_mean_dead_time(delay, jitter):
    delayed = DelayedDuty(DeadTime('actuator', TICK_NS, delay, jitter, 1))
    ages_ticks = []
    for tick in range(1, 10_000):
        delayed.command((tick, 0), tick * TICK_NS)
        for step in range(4):
            acting = delayed.at(tick * TICK_NS + step * STEP_NS)[0]
            if tick > 50:
                ages_ticks.append(tick - acting)
    mean_ms = 4.0 * sum(ages_ticks) / len(ages_ticks)
    assert mean_ms == pytest.approx(mean_delay(delay, jitter, 4), rel=0.02)


@given(steps, steps, seeds, periods)
def test_no_sample_measures_an_earlier_instant_than_the_one_before_it(
    delay, jitter, seed, period_ns
):
    found = ages(delay, jitter, seed, period_ns=period_ns)
    assert all(delay <= age <= delay + jitter for age in found)
    instants = [number * period_ns - age * STEP_NS for number, age in enumerate(found)]
    assert instants == sorted(instants)


@given(st.lists(steps, min_size=60, max_size=60), steps, st.sampled_from([4, 20]))
def test_the_age_is_that_of_the_newest_measurement_that_has_arrived(draws, delay, period):
    jitter = max(draws)
    delays = [delay + each for each in draws]
    count = jitter // period + 1
    for now in range(count, len(delays)):
        newest = max(sample * period - delays[sample] for sample in range(now + 1))
        assert now * period - sample_age(delays[now::-1][:count], period) == newest


def test_the_order_of_the_samples_changes_no_age():
    expected = ages(5, 40)
    dead_time = DeadTime('gyro', TICK_NS, 5, 40, 1)
    order = list(range(600)) * 2
    random.Random(5).shuffle(order)
    for number in order:
        assert dead_time.age((FIRST + number) * TICK_NS) == expected[number]


@pytest.mark.parametrize('other', [{'seed': 2}, {'device': 'encoder'}, {'jitter': 21}])
def test_other_seeds_and_devices_have_other_ages(other):
    assert len(set(ages(5, 20))) > 10
    assert ages(5, 20) == ages(5, 20)
    assert ages(**{'delay': 5, 'jitter': 20, **other}) != ages(5, 20)
