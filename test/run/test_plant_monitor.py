"""Observation of a running graph."""

import os
import time
from itertools import count
from types import SimpleNamespace

import pytest

from ballbot_ros.lockstep.liveness import ThreadTime
from ballbot_ros.nodes.processes import HEARTBEAT_FD_ENV, Heartbeat, HeartbeatSender
from ballbot_ros.run import separate_processes
from ballbot_ros.run.separate_processes import (
    PLANT_BUSY_S,
    PLANT_SILENCE_S,
    PlantMonitor,
    PlantWatchdog,
)


@pytest.fixture
def monitor():
    with PlantMonitor() as monitor:
        yield monitor


IDLE = {1: ThreadTime(cpu_s=1.0, queued_s=0.0, is_runnable=False)}


def test_a_plant_that_never_reports_hangs(monitor, monkeypatch):
    times_s = count(time.monotonic(), 0.1)
    monkeypatch.setattr(
        separate_processes, 'time', SimpleNamespace(monotonic=lambda: next(times_s))
    )
    # Replace the plant's processor time, which would not match the simulated clock.
    monkeypatch.setattr(
        separate_processes, 'threads_by_process', lambda pids: dict.fromkeys(pids, IDLE)
    )
    looks = next(look for look in count() if monitor.plant_hangs(1))
    assert 0.1 * looks == pytest.approx(PLANT_BUSY_S, abs=0.35)


def test_a_starting_plant_and_a_saving_one_have_more_time():
    watchdog = PlantWatchdog(0.0)
    for now in range(301):
        assert not watchdog.is_hung(0.1 * now, 1, {1: IDLE})
    assert watchdog.is_hung(30.2, 1, {1: IDLE})
    watchdog.feed(31.0)
    assert not watchdog.is_hung(31.2, 1, {1: IDLE})
    watchdog.feed(31.9, has_ended=True)
    watchdog.feed(32.0)  # a clock message that was on its way
    for now in range(320, 620):
        assert not watchdog.is_hung(0.1 * now, 1, {1: IDLE})
    assert watchdog.is_hung(62.2, 1, {1: IDLE})


@pytest.mark.parametrize('is_spinning', [False, True])
def test_a_plant_that_gets_processor_time_but_stays_silent_hangs_soon(is_spinning):
    watchdog = PlantWatchdog(0.0)
    watchdog.feed(10.0)
    ends = []
    for look in range(100, 170):
        cpu_s = 0.1 * look if is_spinning else 1.0
        if watchdog.is_hung(0.1 * look, 1, {1: {1: ThreadTime(cpu_s, 0.0, is_spinning)}}):
            ends.append(0.1 * look)
    assert 12.25 < ends[0] < 12.45


def test_a_plant_starved_of_processor_time_does_not_hang():
    watchdog = PlantWatchdog(0.0)
    watchdog.feed(0.0)
    for look in range(2000):
        now = 0.1 * look
        assert not watchdog.is_hung(
            now,
            1,
            {1: {1: ThreadTime(0.02 * now, 0.98 * now, is_runnable=True)}},
        )
        if look == 1000:
            watchdog.feed(now)


@pytest.fixture
def beat(monitor, monkeypatch):
    monkeypatch.setenv(HEARTBEAT_FD_ENV, str(monitor.pipe.theirs))
    return HeartbeatSender().send


def test_the_newest_heartbeat_counts(monitor, beat):
    monitor.poll()
    assert monitor.now_ns == 0
    for now_ns in (0, 7_000_000_000, 8_000_000_000):
        beat(Heartbeat(now_ns, has_ended=False))
    monitor.poll()
    assert monitor.now_ns == 8_000_000_000


def test_a_command_that_does_not_read_holds_no_plant(monitor, beat):
    for now_ns in range(20_000):
        beat(Heartbeat(now_ns, has_ended=False))
    monitor.poll()
    assert monitor.now_ns > 0


def test_a_plant_outlives_the_pipe_and_needs_none(monkeypatch):
    with PlantMonitor() as monitor:
        theirs = os.dup(monitor.pipe.theirs)
    monkeypatch.setenv(HEARTBEAT_FD_ENV, str(theirs))
    HeartbeatSender().send(Heartbeat(1, has_ended=False))
    os.close(theirs)
    monkeypatch.delenv(HEARTBEAT_FD_ENV)
    HeartbeatSender().send(Heartbeat(1, has_ended=False))


@pytest.mark.parametrize(
    ('has_ended', 'patience_s'), [(False, PLANT_SILENCE_S), (True, PLANT_BUSY_S)]
)
def test_a_heartbeat_is_a_sign_of_life_and_the_last_one_gives_the_plant_time_to_save(
    monitor, beat, monkeypatch, has_ended, patience_s
):
    now_s = time.monotonic()
    monkeypatch.setattr(separate_processes, 'time', SimpleNamespace(monotonic=lambda: now_s))
    monkeypatch.setattr(
        separate_processes, 'threads_by_process', lambda pids: dict.fromkeys(pids, IDLE)
    )
    beat(Heartbeat(1, has_ended))
    monitor.poll()
    begun_s = now_s
    while not monitor.plant_hangs(1):
        now_s += 0.1
    assert now_s - begun_s == pytest.approx(patience_s, abs=0.15)
