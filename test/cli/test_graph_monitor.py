"""The look into a running graph."""

import signal

import pytest
from graph import bound_s, wait_for

from ballbot_ros.cli import graph_monitor
from ballbot_ros.cli.graph import ros
from ballbot_ros.cli.graph_monitor import GraphMonitor, Liveness

pytestmark = pytest.mark.graph


@pytest.fixture
def monitor(domain, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    with ros(), GraphMonitor() as monitor:
        yield monitor


@pytest.fixture
def short_patience(monkeypatch):
    monkeypatch.setattr(graph_monitor, 'PLANT_STARTUP_S', 0.2)


def test_a_plant_that_is_never_heard_hangs(short_patience, monitor):
    monitor.poll()
    wait_for(lambda: monitor.plant_hangs(0.0), timeout=2.0, what='the end of the patience')


def test_a_plant_that_falls_silent_hangs(monitor, start_node):
    # It waits for nobody.
    plant = start_node('plant_sim', lockstep='false')
    wait_for(lambda: monitor.poll() or monitor.now_ns, what='the first tick')
    assert not monitor.plant_hangs(0.0)
    plant.process.send_signal(signal.SIGSTOP)
    wait_for(
        lambda: monitor.poll() or monitor.plant_hangs(0.0), timeout=bound_s(3.0), what='its end'
    )


def test_a_plant_that_works_in_silence_hangs_only_after_long():
    liveness = Liveness(0.0)
    assert not liveness.hangs(29.0)
    assert liveness.hangs(31.0)
    liveness.hear(31.0)
    for now in range(31, 61):
        liveness.see(cpu_s=0.01 * now, now_s=now)
        assert not liveness.hangs(now)
    assert liveness.hangs(62.0)


def test_a_plant_that_stops_working_hangs_at_once():
    liveness = Liveness(0.0)
    liveness.hear(10.0)
    liveness.see(cpu_s=1.0, now_s=12.0)
    liveness.see(cpu_s=1.0, now_s=14.0)
    assert not liveness.hangs(14.0)
    assert liveness.hangs(14.4)
