"""Observation of a running graph."""

import os
import signal
import subprocess
import time
from itertools import count
from types import SimpleNamespace

import pytest
from graph import wait_for

from ballbot_ros.nodes.heartbeat import HEARTBEAT_FD_ENV, Heartbeat, HeartbeatSender
from ballbot_ros.nodes.processes import is_waiting
from ballbot_ros.run import plant_monitor
from ballbot_ros.run.plant_monitor import (
    PLANT_BUSY_S,
    PLANT_SILENCE_S,
    PLANT_WAIT_S,
    PlantMonitor,
    PlantWatchdog,
)
from ballbot_ros.simulation.silence_timer import ThreadTime


@pytest.fixture
def monitor():
    with PlantMonitor() as monitor:
        yield monitor


@pytest.fixture
def short_patience(monkeypatch):
    monkeypatch.setattr(plant_monitor, 'PLANT_BUSY_S', 0.2)


IDLE = {1: ThreadTime(cpu_s=1.0, queued_s=0.0, is_runnable=False)}


@pytest.mark.parametrize(('is_stopped', 'patience_s'), [(True, 0.2), (False, PLANT_WAIT_S)])
def test_a_plant_that_never_reports_hangs(
    short_patience, monitor, monkeypatch, is_stopped, patience_s
):
    times_s = count(time.monotonic(), 0.1)
    monkeypatch.setattr(plant_monitor, 'time', SimpleNamespace(monotonic=lambda: next(times_s)))
    # Replace the plant's processor time, which would not match the simulated clock.
    monkeypatch.setattr(plant_monitor, 'threads_by_process', lambda pids: dict.fromkeys(pids, IDLE))
    with subprocess.Popen(['sleep', '60']) as plant:
        wait_for(lambda: is_waiting(plant.pid), what='its sleep')
        if is_stopped:
            plant.send_signal(signal.SIGSTOP)
            wait_for(lambda: not is_waiting(plant.pid), what='its stop')
        looks = next(look for look in count() if monitor.plant_hangs(plant.pid))
        plant.kill()
    assert 0.1 * looks == pytest.approx(patience_s, abs=0.35)


def test_a_starting_plant_and_a_saving_one_have_more_time():
    watchdog = PlantWatchdog(0.0)
    for now in range(301):
        assert not watchdog.is_hung(0.1 * now, 1, {1: IDLE}, is_waiting=False)
    assert watchdog.is_hung(30.2, 1, {1: IDLE}, is_waiting=False)
    watchdog.feed(31.0)
    assert not watchdog.is_hung(31.2, 1, {1: IDLE}, is_waiting=False)
    watchdog.feed(31.9, has_ended=True)
    watchdog.feed(32.0)  # a clock message that was on its way
    for now in range(320, 620):
        assert not watchdog.is_hung(0.1 * now, 1, {1: IDLE}, is_waiting=False)
    assert watchdog.is_hung(62.2, 1, {1: IDLE}, is_waiting=False)


def test_a_plant_does_not_hang_that_waits_while_another_process_gets_no_processor():
    starved = {1: ThreadTime(cpu_s=1.0, queued_s=0.0, is_runnable=True)}
    watchdog = PlantWatchdog(0.0)
    watchdog.feed(0.0)
    for now in range(1, 600):
        assert not watchdog.is_hung(0.1 * now, 1, {1: IDLE, 2: starved}, is_waiting=True)
    looks = (watchdog.is_hung(0.1 * now, 1, {1: IDLE}, is_waiting=True) for now in range(600, 700))
    assert any(looks)


@pytest.mark.parametrize(
    ('is_spinning', 'is_waiting', 'ends_s'),
    [(False, False, 12.25), (True, False, 12.25), (False, True, 15.95)],
    ids=['stopped', 'computes without an end', 'waits, perhaps for a killed process'],
)
def test_a_plant_that_gets_processor_time_but_stays_silent_hangs_soon(
    is_spinning, is_waiting, ends_s
):
    watchdog = PlantWatchdog(0.0)
    watchdog.feed(10.0)
    ends = [
        0.1 * look
        for look in range(100, 170)
        if watchdog.is_hung(
            0.1 * look,
            1,
            {1: {1: ThreadTime(0.1 * look if is_spinning else 1.0, 0.0, is_spinning)}},
            is_waiting=is_waiting,
        )
    ]
    assert ends_s < ends[0] < ends_s + 0.2


def test_a_plant_that_waits_repeatedly_has_more_time():
    watchdog = PlantWatchdog(0.0)
    watchdog.feed(10.0)
    waits = {look: look % 10 != 0 for look in range(200, 400)}
    ends = [
        0.05 * look
        for look in waits
        if watchdog.is_hung(0.05 * look, 1, {1: IDLE}, is_waiting=waits[look])
    ]
    assert 15.95 < ends[0] < 16.15


def test_a_plant_starved_of_processor_time_does_not_hang():
    watchdog = PlantWatchdog(0.0)
    watchdog.feed(0.0)
    for look in range(2000):
        now = 0.1 * look
        assert not watchdog.is_hung(
            now,
            1,
            {1: {1: ThreadTime(0.02 * now, 0.98 * now, is_runnable=True)}},
            is_waiting=False,
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
    monkeypatch.setattr(plant_monitor, 'time', SimpleNamespace(monotonic=lambda: now_s))
    monkeypatch.setattr(plant_monitor, 'threads_by_process', lambda pids: dict.fromkeys(pids, IDLE))
    monkeypatch.setattr(plant_monitor, 'is_waiting', lambda process: False)
    beat(Heartbeat(1, has_ended))
    monitor.poll()
    begun_s = now_s
    while not monitor.plant_hangs(1):
        now_s += 0.1
    assert now_s - begun_s == pytest.approx(patience_s, abs=0.15)
