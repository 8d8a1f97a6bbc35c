"""Pacing against a wall clock of our own."""

import pytest

from ballbot_ros.simulation import pacer
from ballbot_ros.simulation.pacer import Pacer


class WallClock:
    """Stands in for the module `time`."""

    def __init__(self):
        self.now = 100.0
        self.slept = 0.0

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        assert seconds > 0.0
        self.now += seconds
        self.slept += seconds


@pytest.fixture
def clock(monkeypatch):
    clock = WallClock()
    monkeypatch.setattr(pacer, 'time', clock)
    return clock


@pytest.mark.parametrize('factor', [0.1, 1.0, 10.0])
def test_a_thousand_ticks_last_four_seconds_of_scaled_time(clock, factor):
    pace = Pacer()
    for _ in range(1001):
        pace.wait(factor)
        clock.now += 1e-4 / factor
    assert clock.now - 100.0 == pytest.approx(4.0 / factor, rel=1e-3)
    assert pace.late == 0


def test_the_first_tick_does_not_wait(clock):
    Pacer().wait(1.0)
    assert clock.slept == 0.0


def test_factor_zero_never_waits(clock):
    pace = Pacer()
    for _ in range(100):
        pace.wait(0.0)
    assert clock.slept == 0.0
    assert pace.late == 0


def test_a_tick_that_is_a_little_late_is_made_up_for(clock):
    pace = Pacer()
    pace.wait(1.0)
    clock.now += 0.006
    pace.wait(1.0)
    pace.wait(1.0)
    assert clock.now - 100.0 == pytest.approx(0.008)
    assert pace.late == 0


def test_after_a_stall_it_counts_it_and_does_not_hurry(clock):
    pace = Pacer()
    pace.wait(1.0)
    clock.now += 5.0
    pace.wait(1.0)
    assert pace.late == 1
    begun = clock.now
    for _ in range(10):
        pace.wait(1.0)
    assert clock.now - begun == pytest.approx(0.040)
    assert pace.late == 1


@pytest.mark.parametrize('forget', [Pacer.restart, lambda pace: pace.wait(0.0)])
def test_a_restart_and_a_pause_at_factor_zero_forget_the_past(clock, forget):
    pace = Pacer()
    pace.wait(1.0)
    clock.now += 5.0
    forget(pace)
    pace.wait(1.0)
    assert pace.late == 0
    assert clock.slept == 0.0
