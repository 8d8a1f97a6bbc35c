"""Who comes late gets exactly the newest of a state and nothing old; the recorder gets it all."""

import contextlib
import os
import signal

import numpy as np
import pytest

pytest.importorskip('rclpy')

from graph import NODES, wait_for
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from ros_client import Client
from std_srvs.srv import SetBool, Trigger

from ballbot_ros.messages.conversions import fill_clock, stamp_ns
from ballbot_ros.messages.topics import (
    BATTERY_STATE,
    CLOCK,
    GYRO_IMU,
    HISTORY,
    JOINT_STATES,
    LCD,
    MAP,
    MOTOR_DUTY,
    OPERATING_STATE,
    PARTICIPANTS,
    PLANT_IMU,
    RUN,
    SOUND,
    TOPICS,
    WALL_HIT,
)
from ballbot_ros.nodes.base import Output, reliable_qos
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.simulation.timing import SLOW_NS, TICK_NS

pytestmark = pytest.mark.graph

DRIVERS = [name for name in NODES if name not in ('plant_sim', 'recorder')]
STATES = (OPERATING_STATE, BATTERY_STATE, WALL_HIT, LCD, RUN)
STREAMS = (PLANT_IMU, GYRO_IMU, JOINT_STATES, MOTOR_DUTY, SOUND)
REPEATED_S = 2.5


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


def test_a_late_subscriber_gets_the_newest_of_a_state_and_nothing_old(
    start_node, client, make_client
):
    for name in DRIVERS:
        start_node(name)
    start_node('plant_sim', real_time_factor=0)
    client.spin_until(lambda: PLANT_IMU.name in client.newest and client.now_ns() > 4_000_000_000)
    assert client.call(SetBool, 'plant_sim/pause', SetBool.Request(data=True)).success
    late = make_client()
    for topic in STATES:
        late.watch(topic, HISTORY)
    for topic in STREAMS:
        late.node.create_subscription(
            topic.message_class,
            topic.name,
            lambda message, name=topic.name: late.seen.setdefault(name, []).append(message),
            reliable_qos(HISTORY, latched=False),
        )
    named = {topic.name for topic in (*STATES, *STREAMS) if topic is not SOUND}
    late.spin_until(lambda: named <= set(late.seen), what=f'{named}')
    for topic in (*STATES, *STREAMS):
        (offer,) = late.node.get_publishers_info_by_topic(topic.name)
        assert offer.qos_profile.reliability == ReliabilityPolicy.RELIABLE
        keeps = DurabilityPolicy.TRANSIENT_LOCAL if topic in STATES else DurabilityPolicy.VOLATILE
        assert offer.qos_profile.durability == keeps, topic.name
    # What stands still is told again, and only that.
    late.spin_for(REPEATED_S)
    now = stamp_ns(late.seen[PLANT_IMU.name][-1])
    for topic in (OPERATING_STATE, WALL_HIT, LCD, RUN):
        assert len(late.seen[topic.name]) == 1, topic.name
    assert late.seen[OPERATING_STATE.name][0].data == client.newest[OPERATING_STATE.name].data
    assert late.seen[WALL_HIT.name][0].data is False
    assert {stamp_ns(each) for each in late.seen[BATTERY_STATE.name]} == {
        now - now % BATTERY_STATE.period_ns
    }
    for topic in STREAMS[:-1]:
        assert {stamp_ns(each) for each in late.seen[topic.name]} == {now}
    assert SOUND.name not in late.seen


def test_a_map_of_an_earlier_run_is_not_that_of_one_without(start_node, client, make_client):
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


@pytest.mark.parametrize('meanwhile', ['waits for a duty', 'is paused'])
def test_a_recorder_may_come_while_the_plant(start_node, client, tmp_path, meanwhile):
    path = tmp_path / 'run.mcap'
    drivers = {name: start_node(name) for name in DRIVERS}
    plant = start_node('plant_sim', real_time_factor=0, timeout=60, duration=20)
    client.watch(PARTICIPANTS, HISTORY)
    client.spin_until(lambda: PLANT_IMU.name in client.newest and client.now_ns() > 1_100_000_000)

    def set_pause(*, pause):
        assert client.call(SetBool, 'plant_sim/pause', SetBool.Request(data=pause)).success

    set_pause(pause=True)
    client.spin_for(0.3)
    # At a tick at which the slow drivers send nothing.
    while client.now_ns() % SLOW_NS != 2 * TICK_NS:
        before = client.now_ns()
        client.call(Trigger, 'plant_sim/step', Trigger.Request())
        client.spin_until(lambda: client.now_ns() > before)  # noqa: B023
    gyro = drivers['gyro_driver'].process.pid
    if meanwhile == 'waits for a duty':
        os.kill(gyro, signal.SIGSTOP)
        set_pause(pause=False)
    recorder = start_node('recorder', output=path)

    def has_come():
        return 'recorder' in {message.name[1:] for message in client.seen[PARTICIPANTS.name]}

    client.spin_until(has_come)
    client.spin_for(1.0)
    if meanwhile == 'waits for a duty':
        os.kill(gyro, signal.SIGCONT)
    else:
        set_pause(pause=False)
    assert plant.finish() == 0, plant.output
    assert recorder.interrupt() == 0
    with RecordingReader(path) as recording:
        assert recording.complete
        assert recording.topics()['/motor_duty'].message_count > 4000


def test_every_change_is_recorded_that_comes_while_the_recorder_is_stopped(
    start_node, client, tmp_path
):
    path = tmp_path / 'changes.mcap'
    recorder = start_node('recorder', output=path)
    clock, hit = Output(client.node, CLOCK), Output(client.node, WALL_HIT)
    lcd = client.node.create_publisher(
        LCD.message_class, LCD.name, reliable_qos(HISTORY, latched=False)
    )
    watched = (CLOCK.name, WALL_HIT.name, WALL_HIT.history.name, LCD.name)
    client.spin_until(lambda: all(client.node.count_subscribers(name) for name in watched))
    fill_clock(clock.message, 1_000_000_000)

    def is_recorded():
        clock.send(0)
        return client.node.count_publishers('/diagnostics') and path.exists()

    client.spin_until(is_recorded)
    os.kill(recorder.process.pid, signal.SIGSTOP)
    for number in range(10):
        hit.message.data = number % 2 == 0
        hit.send(0)
        lcd.publish(LCD.message_class(data=f'page {number}'))
    os.kill(recorder.process.pid, signal.SIGCONT)
    client.spin_for(1.0)
    assert recorder.interrupt() == 0
    with RecordingReader(path) as recording:
        hits = [message.data for _, _, message in recording.messages(['/wall_hit'])]
        pages = [message.data for _, _, message in recording.messages(['/lcd'])]
        assert not [name for name in recording.topics() if '_history' in name]
    assert hits == [True, False] * 5
    # Of a node of somebody's own, which has no history, too.
    assert pages == [f'page {number}' for number in range(10)]


def test_a_recorder_that_comes_in_mid_run_has_everything_from_then_on(start_node, client, tmp_path):
    path = tmp_path / 'late.mcap'
    for name in DRIVERS:
        start_node(name)
    plant = start_node('plant_sim', real_time_factor=1)
    client.spin_until(lambda: PLANT_IMU.name in client.newest and client.now_ns() > 2_000_000_000)
    recorder = start_node('recorder', output=path)
    wait_for(lambda: path.exists() and path.stat().st_size > 20_000)
    assert plant.interrupt() == 0
    assert recorder.interrupt() == 0
    with RecordingReader(path) as recording:
        assert recording.complete
        for topic in TOPICS:
            if not topic.period_ns or topic in (CLOCK, BATTERY_STATE):
                continue
            stamps = [stamp_ns(m) for _, _, m in recording.messages([topic.resolved()])]
            assert set(np.diff(stamps)) == {topic.period_ns}, topic.name
