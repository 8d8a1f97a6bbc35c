"""Lasting nodes: plants, recorders, subscribers and strangers join them and leave."""

import signal
import time

import numpy as np
import pytest
from graph import NODES, Node, await_recording, call, free_domain

pytest.importorskip('rclpy')

from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from ros_client import Client
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from std_srvs.srv import SetBool, Trigger

from ballbot_ros.nodes.endpoints import reliable_qos
from ballbot_ros.parameters import GYRO, PLANT, RECORDER, SONAR
from ballbot_ros.parameters.timing import SECOND_NS, SLOW_PERIOD_NS, TICK_NS
from ballbot_ros.recording.messages.conversions import fill_time, stamp_ns
from ballbot_ros.recording.messages.topics import (
    BATTERY_STATE,
    CLOCK,
    GYRO_IMU,
    HISTORY,
    JOINT_STATES,
    LCD,
    MOTOR_DUTY,
    OPERATING_STATE,
    PARTICIPANTS,
    PLANT_IMU,
    RUN,
    SOUND,
    TOPICS,
    WALL_HIT,
)
from ballbot_ros.recording.reader import RecordingReader

pytestmark = pytest.mark.graph

LASTING = [name for name in NODES if name not in (PLANT, RECORDER)]
STATES = (OPERATING_STATE, BATTERY_STATE, WALL_HIT, LCD, RUN)
STREAMS = (PLANT_IMU, GYRO_IMU, JOINT_STATES, MOTOR_DUTY, SOUND)


@pytest.fixture(scope='module')
def domain():
    with free_domain() as number:
        yield number


@pytest.fixture(scope='module', autouse=True)
def lasting(domain, fork_client):
    """The nodes shared by all tests of this module."""
    nodes = {name: Node.fork(fork_client, domain, name) for name in LASTING}
    yield nodes
    for node in nodes.values():
        node.kill()


@pytest.fixture
def start(lasting, start_node):
    """Start a node next to the lasting ones; it leaves after the test.

    A killed node would stay in the graph for a while, and the next run would wait for it.
    """
    guests = []

    def start(name, **parameters):
        guests.append(start_node(name, **parameters))
        return guests[-1]

    yield start
    for node in lasting.values():
        node.process.send_signal(signal.SIGCONT)
    for guest in guests:
        if guest.process.poll() is None:
            guest.interrupt()


@pytest.fixture
def watch_run(client, start):
    """Start a plant, and wait until its run has reached a time [s]."""

    def watch(until_s, **parameters):
        plant = start(PLANT, **{'real_time_factor': 0, 'timeout': 60, **parameters})
        client.spin_until(
            lambda: PLANT_IMU.name in client.newest and client.now_ns() > until_s * 1e9,
            what='the run',
        )
        return plant

    return watch


def test_a_late_subscriber_gets_only_the_newest_message_of_a_state(domain, client, watch_run):
    client.watch(OPERATING_STATE)
    watch_run(4.0)
    assert client.call(SetBool, 'plant_sim/pause', SetBool.Request(data=True)).success
    late = Client(domain)
    try:
        for topic in STATES:
            late.watch(topic, HISTORY)
        for topic in STREAMS:
            late.node.create_subscription(
                topic.message_class,
                topic.name,
                lambda message, name=topic.name: late.seen.setdefault(name, []).append(message),
                reliable_qos(HISTORY, latched=False),
            )
        # Do not wait for sounds, which are not repeated.
        named = {topic.name for topic in (*STATES, *STREAMS) if topic is not SOUND}
        late.spin_until(lambda: named <= set(late.seen), what=f'{named}')
        late.spin_until(lambda: len(late.seen[PLANT_IMU.name]) > 3, what='the tick again')
        for topic in (*STATES, *STREAMS):
            offers = late.node.get_publishers_info_by_topic(topic.name)
            # motor_duty has two publishers: the plant may switch off the motors, too.
            assert len(offers) == 1 + (topic is MOTOR_DUTY), topic.name
            assert {offer.qos_profile.reliability for offer in offers} == {
                ReliabilityPolicy.RELIABLE
            }
            keeps = (
                DurabilityPolicy.TRANSIENT_LOCAL if topic in STATES else DurabilityPolicy.VOLATILE
            )
            assert {offer.qos_profile.durability for offer in offers} == {keeps}, topic.name
    finally:
        late.close()
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


def test_a_recorder_may_join_while_the_plant_waits_for_a_duty(
    lasting, start, client, watch_run, tmp_path
):
    path = tmp_path / 'run.mcap'
    client.watch(PARTICIPANTS, HISTORY, kept=True)
    plant = watch_run(1.1)

    def set_pause(*, pause):
        assert client.call(SetBool, 'plant_sim/pause', SetBool.Request(data=pause)).success

    set_pause(pause=True)
    client.await_standstill()
    # Step to a tick at which the slow drivers send nothing.
    while client.now_ns() % SLOW_PERIOD_NS != 2 * TICK_NS:
        before = client.now_ns()
        client.call(Trigger, 'plant_sim/step', Trigger.Request())
        client.spin_until(lambda: client.now_ns() > before)  # noqa: B023
    gyro = lasting[GYRO].process
    gyro.send_signal(signal.SIGSTOP)
    set_pause(pause=False)
    recorder = start(RECORDER, output=path)

    def has_come():
        return RECORDER in {message.name[1:] for message in client.seen[PARTICIPANTS.name]}

    client.spin_until(has_come)
    client.await_standstill()
    end_ns = client.now_ns() + 3 * SECOND_NS
    gyro.send_signal(signal.SIGCONT)
    client.spin_until(lambda: client.now_ns() > end_ns, what='the rest of the run')
    assert plant.interrupt() == 0, plant.output
    assert recorder.interrupt() == 0
    with RecordingReader(path) as recording:
        assert 's on: recorded from mid-run' in recording.damage
        assert recording.topics()['/motor_duty'].message_count > 600


def test_a_recorder_that_joins_in_mid_run_has_everything_from_then_on(start, watch_run, tmp_path):
    path = tmp_path / 'late.mcap'
    plant = watch_run(2.0, real_time_factor=1)
    recorder = start(RECORDER, output=path)
    periodic = [each for each in TOPICS if each.period_ns and each not in (CLOCK, BATTERY_STATE)]
    for topic in periodic:
        await_recording(path, topic.resolved(), 4)
    assert plant.interrupt() == 0
    assert recorder.interrupt() == 0
    with RecordingReader(path) as recording:
        assert 's on: recorded from mid-run' in recording.damage
        for topic in periodic:
            # The stop of the motors comes after the last tick, which may lack its duty.
            messages = (m for _, _, m in recording.messages([topic.resolved()]))
            stamps = [stamp_ns(m) for m in messages if m.header.frame_id != 'stop']
            assert set(np.diff(stamps)) == {topic.period_ns}, topic.name


def test_a_run_whose_recorder_started_last_can_be_replayed(start, client, tmp_path):
    path = tmp_path / 'run.mcap'
    plant = start(
        PLANT, real_time_factor=0, duration=2, start_pitch_x=0.02, require_recorder='true'
    )
    # Wait for the run's announcement: by then the plant is known to all nodes present.
    client.spin_until(lambda: RUN.name in client.newest)
    recorder = start(RECORDER, output=path)
    assert plant.finish() == 0
    assert recorder.interrupt() == 0
    assert call('replay', path, '--controller=python').returncode == 0


def test_shared_parameters_must_be_equal(start, client):
    assert client.set_value(SONAR, 'map', 'track').successful
    plant = start(PLANT, duration=1)
    assert plant.finish() == 1
    assert client.set_value(SONAR, 'map', '').successful
    assert "map is '' in /plant_sim, but 'track' in /sonar_driver" in plant.output
    assert 'before its first tick' in plant.output


def of_another_clock():
    message = JointState(name=['shoulder', 'elbow'], position=[1.0, 2.0])
    fill_time(message.header.stamp, time.time_ns())
    return message


@pytest.mark.parametrize(
    ('topic', 'make'),
    [(JOINT_STATES, of_another_clock), (RUN, lambda: Header(frame_id='7 cafe'))],
    ids=['a sample', 'a run'],
)
def test_a_stranger_fails_the_run_by_name_and_costs_the_recording_nothing(
    start, client, tmp_path, topic, make
):
    path = tmp_path / 'run.mcap'
    recorder = start(RECORDER, output=path)
    plant = start(PLANT, real_time_factor=0, require_recorder='true')
    await_recording(path)
    client.publish(topic, make)
    client.spin_until(lambda: plant.process.poll() is not None)
    assert plant.finish() == 1
    told = f'/test_client publishes on {topic.name!r}, but takes no part in the run'
    assert told in plant.output
    assert recorder.interrupt() == 0
    with RecordingReader(path) as reader:
        assert reader.damage is None
        found = {name: topic.message_count for name, topic in reader.topics().items()}
    assert found['/joint_states'] == found['/gyro'] > 10
