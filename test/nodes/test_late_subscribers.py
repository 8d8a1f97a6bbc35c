"""A late subscriber gets exactly the newest message of a state; the recorder gets all of them."""

import contextlib
import os
import signal

import pytest

pytest.importorskip('rclpy')

from graph import NODES, await_recording
from ros_client import Client
from std_srvs.srv import Trigger

from ballbot_ros.nodes.endpoints import TopicPublisher, reliable_qos
from ballbot_ros.recording.messages.conversions import encode_clock, encode_wall_hit
from ballbot_ros.recording.messages.topics import (
    CLOCK,
    HISTORY,
    LCD,
    MAP,
    OPERATING_STATE,
    PLANT_IMU,
    RUN,
    WALL_HIT,
)
from ballbot_ros.recording.reader import RecordingReader

pytestmark = pytest.mark.graph

DRIVERS = [name for name in NODES if name not in ('plant_sim', 'recorder')]


@pytest.fixture
def make_client(domain):
    with contextlib.ExitStack() as stack:
        yield lambda: stack.enter_context(contextlib.closing(Client(domain)))


@pytest.fixture
def client(make_client):
    client = make_client()
    client.watch(PLANT_IMU)
    client.watch(OPERATING_STATE)
    return client


def test_a_run_without_a_map_does_not_get_that_of_an_earlier_run(start_node, client, make_client):
    for name in DRIVERS:
        start_node(name, **({'map': 'corridor'} if name == 'sonar_driver' else {}))
    start_node('plant_sim', map='corridor', real_time_factor=0)
    client.watch(MAP)
    client.spin_until(lambda: {MAP.name, PLANT_IMU.name} <= client.newest.keys())
    for node in ('plant_sim', 'sonar_driver'):
        assert client.set_value(node, 'map', '').successful
    reset_at = client.now_ns()
    client.call(Trigger, 'plant_sim/reset', Trigger.Request())
    client.spin_until(lambda: client.now_ns() > reset_at + 1_000_000_000)
    late = make_client()
    for topic in (RUN, MAP, PLANT_IMU):
        late.watch(topic)
    late.spin_until(lambda: {RUN.name, PLANT_IMU.name} <= late.newest.keys())
    late.spin_for(1.0)
    assert late.newest[RUN.name].frame_id.startswith('2 ')
    assert MAP.name not in late.newest


def test_changes_while_the_recorder_is_stopped_are_recorded(start_node, client, tmp_path):
    path = tmp_path / 'changes.mcap'
    recorder = start_node('recorder', output=path)
    clock, hit = TopicPublisher(client.node, CLOCK), TopicPublisher(client.node, WALL_HIT)
    lcd = client.node.create_publisher(
        LCD.message_class, LCD.name, reliable_qos(HISTORY, latched=False)
    )
    watched = (CLOCK.name, WALL_HIT.name, WALL_HIT.history.name, LCD.name)
    client.spin_until(lambda: all(client.node.count_subscribers(name) for name in watched))

    def is_recorded():
        clock.publish(encode_clock(1_000_000_000))
        return client.node.count_publishers('/diagnostics') and path.exists()

    client.spin_until(is_recorded)
    os.kill(recorder.process.pid, signal.SIGSTOP)
    for number in range(10):
        hit.publish(encode_wall_hit(wall_hit=number % 2 == 0))
        lcd.publish(LCD.message_class(data=f'page {number}'))
    os.kill(recorder.process.pid, signal.SIGCONT)
    await_recording(path, f'/{LCD.name}', 10)
    assert recorder.interrupt() == 0
    with RecordingReader(path) as recording:
        hits = [message.data for _, _, message in recording.messages(['/wall_hit'])]
        pages = [message.data for _, _, message in recording.messages(['/lcd'])]
        assert not [name for name in recording.topics() if '_history' in name]
    assert hits == [True, False] * 5
    # The pages are complete, too, although a foreign node sent them, which has no history.
    assert pages == [f'page {number}' for number in range(10)]
