"""Observation of a running graph."""

import contextlib
import signal
import subprocess
import time
from itertools import count, repeat
from types import SimpleNamespace

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from graph import wait_for
from rclpy.serialization import serialize_message

from ballbot_ros.messages.topics import CLOCK, DIAGNOSTICS
from ballbot_ros.nodes import plant_reports
from ballbot_ros.nodes.processes import is_waiting
from ballbot_ros.parameters import PLANT, RECORDER
from ballbot_ros.run import plant_monitor
from ballbot_ros.run.graph import ros
from ballbot_ros.run.plant_monitor import (
    PLANT_BUSY_S,
    PLANT_SILENCE_S,
    PLANT_WAIT_S,
    PlantMonitor,
    PlantWatchdog,
)
from ballbot_ros.simulation.silence_timer import ThreadTime

pytestmark = pytest.mark.graph


@pytest.fixture
def monitor(domain, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    with ros(), PlantMonitor() as monitor:
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


@pytest.mark.parametrize('how', ['stopped', 'spinning'])
def test_a_plant_that_falls_silent_hangs(monitor, start_node, how):
    # Start a free-running plant, which waits for no other process.
    plant = start_node('plant_sim', lockstep='false')
    wait_for(lambda: monitor.poll() or monitor.now_ns, what='the first tick')
    assert not monitor.plant_hangs(plant.process.pid)
    plant.process.send_signal(signal.SIGSTOP)
    with contextlib.ExitStack() as stack:
        pid = plant.process.pid
        if how == 'spinning':
            spinner = stack.enter_context(subprocess.Popen(['sh', '-c', 'while :; do :; done']))
            stack.callback(spinner.kill)
            pid = spinner.pid
        wait_for(lambda: monitor.poll() or monitor.plant_hangs(pid), what='its end')


def test_a_poll_ends_even_under_a_flood_of_messages(monitor, monkeypatch):
    flood = {
        CLOCK.name: CLOCK.message_class(),
        DIAGNOSTICS.name: b'bytes that are no report of plant_sim',
    }
    monkeypatch.setattr(
        plant_monitor, 'drain', lambda subscription: repeat((flood[subscription.topic_name], {}))
    )
    monitor.poll()


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


def deliver(monkeypatch, come):
    """Let messages arrive, by topic."""
    for module in (plant_monitor, plant_reports):
        monkeypatch.setattr(module, 'drain', lambda topic: come[topic.topic_name])


def test_a_clock_message_is_a_sign_of_life(monitor, monkeypatch):
    now_s = time.monotonic()
    monkeypatch.setattr(plant_monitor, 'time', SimpleNamespace(monotonic=lambda: now_s))
    monkeypatch.setattr(plant_monitor, 'threads_by_process', lambda pids: dict.fromkeys(pids, IDLE))
    monkeypatch.setattr(plant_monitor, 'is_waiting', lambda process: False)
    clock = CLOCK.message_class(clock=Time(sec=7))
    come = {CLOCK.name: [(clock, {})], DIAGNOSTICS.name: []}
    deliver(monkeypatch, come)
    monitor.poll()
    assert monitor.now_ns == 7_000_000_000
    begun_s = now_s
    while not monitor.plant_hangs(1):
        now_s += 0.1
    assert now_s - begun_s == pytest.approx(PLANT_SILENCE_S, abs=0.15)


@pytest.mark.parametrize(
    ('values', 'patience_s'),
    [
        ({'role': PLANT}, PLANT_SILENCE_S),
        ({'role': PLANT, 'outcome': 'completed'}, PLANT_BUSY_S),
        ({'role': RECORDER, 'file': f'{PLANT}.mcap', 'outcome': 'completed'}, PLANT_SILENCE_S),
    ],
)
def test_a_report_of_the_outcome_gives_the_plant_time_to_save(
    monitor, monkeypatch, values, patience_s
):
    now_s = time.monotonic()
    monkeypatch.setattr(plant_monitor, 'time', SimpleNamespace(monotonic=lambda: now_s))
    monkeypatch.setattr(plant_monitor, 'threads_by_process', lambda pids: dict.fromkeys(pids, IDLE))
    monkeypatch.setattr(plant_monitor, 'is_waiting', lambda process: False)
    for reported in ({'role': PLANT}, values):
        status = DiagnosticStatus(values=[KeyValue(key=k, value=v) for k, v in reported.items()])
        data = serialize_message(DIAGNOSTICS.message_class(status=[status]))
        come = {CLOCK.name: [], DIAGNOSTICS.name: [(data, {})]}
        deliver(monkeypatch, come)
        monitor.poll()
    begun_s = now_s
    while not monitor.plant_hangs(1):
        now_s += 0.1
    assert now_s - begun_s == pytest.approx(patience_s, abs=0.15)
