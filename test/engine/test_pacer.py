"""Pacing against a simulated wall clock."""

import pytest

from ballbot_ros.engine.pacer import Pacer


class PacedLoop:
    """Runs ticks as soon as the pacer allows."""

    def __init__(self):
        self.pacer = Pacer()
        self.now_s = self.start_s = 100.0

    def tick(self, factor):
        self.now_s += self.pacer.delay_s(factor, self.now_s)
        self.pacer.on_tick(factor, self.now_s)

    @property
    def elapsed_s(self):
        return self.now_s - self.start_s


@pytest.fixture
def loop():
    return PacedLoop()


@pytest.mark.parametrize('factor', [0.1, 1.0, 10.0])
def test_a_thousand_ticks_last_four_seconds_of_scaled_time(loop, factor):
    for _ in range(1001):
        loop.tick(factor)
        loop.now_s += 1e-4 / factor
    assert loop.elapsed_s == pytest.approx(4.0 / factor, rel=1e-3)
    assert loop.pacer.late_ticks == 0


def test_the_first_tick_does_not_wait(loop):
    loop.tick(1.0)
    assert loop.elapsed_s == 0.0


def test_factor_zero_never_waits(loop):
    for _ in range(100):
        loop.tick(0.0)
    assert loop.elapsed_s == 0.0
    assert loop.pacer.late_ticks == 0


def test_a_slight_delay_is_caught_up(loop):
    loop.tick(1.0)
    loop.now_s += 0.006
    loop.tick(1.0)
    loop.tick(1.0)
    assert loop.elapsed_s == pytest.approx(0.008)
    assert loop.pacer.late_ticks == 0


@pytest.mark.parametrize(('late_s', 'late_ticks'), [(0.0079, 0), (0.0081, 1), (5.0, 1)])
def test_a_stall_is_counted_and_not_caught_up(loop, late_s, late_ticks):
    loop.tick(1.0)
    loop.now_s += late_s
    loop.tick(1.0)
    assert loop.pacer.late_ticks == late_ticks


def test_after_a_stall_the_pace_is_the_usual_one(loop):
    loop.tick(1.0)
    loop.now_s += 5.0
    loop.tick(1.0)
    begun_s = loop.now_s
    for _ in range(10):
        loop.tick(1.0)
    assert loop.now_s - begun_s == pytest.approx(0.040)
    assert loop.pacer.late_ticks == 1


@pytest.mark.parametrize('forget', [lambda loop: loop.pacer.restart(), lambda loop: loop.tick(0.0)])
def test_a_restart_and_a_pause_at_factor_zero_forget_the_past(loop, forget):
    loop.tick(1.0)
    loop.now_s += 5.0
    forget(loop)
    before_s = loop.now_s
    loop.tick(1.0)
    assert loop.pacer.late_ticks == 0
    assert loop.now_s == before_s
