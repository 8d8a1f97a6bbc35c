"""Observation of a running graph."""

import os

import pytest

from ballbot_ros.lockstep.liveness import ThreadTime
from ballbot_ros.nodes.processes import HEARTBEAT_FD_ENV, Heartbeat, HeartbeatSender
from ballbot_ros.run import separate_processes
from ballbot_ros.run.separate_processes import PLANT_BUSY_S, PLANT_SILENCE_S, PlantMonitor

IDLE = {1: ThreadTime(cpu_s=1.0, queued_s=0.0, is_runnable=False)}


class System:
    """The clock, and the processor time of the plant's threads."""

    def __init__(self):
        self.now_s, self.threads = 0.0, IDLE

    def monotonic(self):
        return self.now_s


@pytest.fixture
def system(monkeypatch):
    system = System()
    monkeypatch.setattr(separate_processes, 'time', system)
    monkeypatch.setattr(
        separate_processes, 'threads_by_process', lambda pids: dict.fromkeys(pids, system.threads)
    )
    return system


@pytest.fixture
def monitor(system):
    with PlantMonitor() as monitor:
        yield monitor


@pytest.fixture
def hangs_after(system, monitor):
    """Watch a silent plant; return after which time it hangs."""

    def watch():
        begun_s = system.now_s
        while not monitor.plant_hangs(1):
            system.now_s += 0.1
        return system.now_s - begun_s

    return watch


def test_a_starting_plant_and_a_saving_one_have_more_time(monitor, beat, hangs_after):
    assert hangs_after() == pytest.approx(PLANT_BUSY_S, abs=0.15)
    for has_ended, patience_s in (False, PLANT_SILENCE_S), (True, PLANT_BUSY_S):
        beat(Heartbeat(1, has_ended))
        monitor.poll()
        assert hangs_after() == pytest.approx(patience_s, abs=0.15), has_ended


@pytest.mark.parametrize('is_spinning', [False, True])
def test_a_plant_that_gets_processor_time_but_stays_silent_hangs_soon(
    system, monitor, beat, is_spinning
):
    system.now_s = 10.0
    beat(Heartbeat(1, has_ended=False))
    monitor.poll()
    ends = []
    for look in range(100, 170):
        system.now_s = 0.1 * look
        cpu_s = system.now_s if is_spinning else 1.0
        system.threads = {1: ThreadTime(cpu_s, 0.0, is_spinning)}
        if monitor.plant_hangs(1):
            ends.append(system.now_s)
    assert 12.25 < ends[0] < 12.45


def test_a_plant_starved_of_processor_time_does_not_hang(system, monitor, beat):
    for look in range(2000):
        now_s = system.now_s = 0.1 * look
        system.threads = {1: ThreadTime(0.02 * now_s, 0.98 * now_s, is_runnable=True)}
        if look in (0, 1000):
            beat(Heartbeat(1, has_ended=False))
            monitor.poll()
        assert not monitor.plant_hangs(1)


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
