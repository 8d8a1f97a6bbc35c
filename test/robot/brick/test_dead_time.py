"""Dead time is a function of parameters, seed and stamp, and samples never go back in time."""

import random

import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.engine.devices import sample_age, uniform_pair
from ballbot_ros.engine.plant_tick import NEVER_NS, duty_at, note_duty, waiting_count
from ballbot_ros.parameters.timing import SLOW_PERIOD_NS, STEP_NS, TICK_NS
from ballbot_ros.robot.brick.sensors import drawn_delay, mean_delay
from ballbot_ros.robot.random_numbers import device_number, noise_key

FIRST = 250

steps = st.integers(0, 100)
seeds = st.integers(0, 2**63 - 1)
periods = st.sampled_from([TICK_NS, SLOW_PERIOD_NS])


def age(number, delay, jitter, seed=1, device='gyro', period_ns=TICK_NS):
    key, stamp_ns = noise_key(seed), (FIRST + number) * period_ns
    return sample_age(delay, jitter, key, device_number(device), period_ns, stamp_ns)


def ages(delay, jitter, count=600, **where):
    return [age(number, delay, jitter, **where) for number in range(count)]


def drawn(delay, jitter, number, device='actuator'):
    """Return the dead time of a duty or of a sample, without regard to those before it."""
    chance, _ = uniform_pair(noise_key(1), device_number(device), number)
    return drawn_delay(delay, jitter, chance) if jitter else delay


@given(steps, steps, st.integers(0, 2**53 - 1))
def test_a_drawn_delay_is_within_its_bounds(delay, jitter, bits):
    assert delay <= drawn_delay(delay, jitter, bits / 2**53) <= delay + jitter


def test_all_delays_are_equally_likely():
    found = [drawn(3, 4, number) for number in range(10_000)]
    assert [round(found.count(delay) / 1e4, 1) for delay in range(2, 9)] == [0, *5 * [0.2], 0]


@given(steps, seeds, periods)
def test_without_jitter_every_sample_has_the_same_age(delay, seed, period_ns):
    assert ages(delay, 0, seed=seed, period_ns=period_ns, count=9) == [delay] * 9


@pytest.mark.parametrize(('delay', 'jitter'), [(3, 0), (0, 1), (2, 4), (0, 12), (7, 50)])
@pytest.mark.parametrize('period_ns', [TICK_NS, SLOW_PERIOD_NS])
def test_the_mean_is_that_of_many_samples(delay, jitter, period_ns):
    found = ages(delay, jitter, period_ns=period_ns, count=20_000)
    mean = mean_delay(delay, jitter, period_ns // STEP_NS)
    assert mean == pytest.approx(sum(found) / len(found), rel=0.02)
    assert delay <= mean < delay + jitter / 2.0 + 1e-9


@pytest.mark.parametrize(('delay', 'jitter'), [(3, 0), (0, 5), (2, 9), (0, 40)])
def test_the_duty_that_acts_has_the_mean_dead_time(delay, jitter):
    count = waiting_count(delay + jitter, False)
    effects_ns, duties = [NEVER_NS] * count, [0] * (2 * count)
    ages_ticks = []
    for tick in range(1, 10_000):
        delay_ns = drawn(delay, jitter, tick) * STEP_NS
        note_duty(effects_ns, duties, tick * TICK_NS, delay_ns, tick, 0)
        for step in range(4):
            now_ns = tick * TICK_NS + step * STEP_NS
            acting, _, _ = duty_at(effects_ns, duties, now_ns, now_ns + STEP_NS)
            if tick > 50:
                ages_ticks.append(tick - acting)
    mean_ms = 4.0 * sum(ages_ticks) / len(ages_ticks)
    assert mean_ms == pytest.approx(mean_delay(delay, jitter, 4), rel=0.02)


@given(steps, steps, seeds, periods)
def test_no_sample_measures_an_earlier_instant_than_the_one_before_it(
    delay, jitter, seed, period_ns
):
    found = ages(delay, jitter, seed=seed, period_ns=period_ns)
    assert all(delay <= age <= delay + jitter for age in found)
    instants = [number * period_ns - age * STEP_NS for number, age in enumerate(found)]
    assert instants == sorted(instants)


@given(steps, steps, st.sampled_from([TICK_NS, SLOW_PERIOD_NS]))
def test_the_age_is_that_of_the_newest_measurement_that_has_arrived(delay, jitter, period_ns):
    period = period_ns // STEP_NS
    delays = [drawn(delay, jitter, number, 'gyro') for number in range(FIRST + 60)]
    for now in range(60):
        arrived = (each * period - delays[each] for each in range(FIRST + now + 1))
        found = age(now, delay, jitter, period_ns=period_ns)
        assert (FIRST + now) * period - found == max(arrived)


def test_the_order_of_the_samples_changes_no_age():
    expected = ages(5, 40)
    order = list(range(600)) * 2
    random.Random(5).shuffle(order)
    for number in order:
        assert age(number, 5, 40) == expected[number]


@pytest.mark.parametrize('other', [{'seed': 2}, {'device': 'encoder'}, {'jitter': 21}])
def test_other_seeds_and_devices_have_other_ages(other):
    assert len(set(ages(5, 20))) > 10
    assert ages(5, 20) == ages(5, 20)
    assert ages(**{'delay': 5, 'jitter': 20} | other) != ages(5, 20)
