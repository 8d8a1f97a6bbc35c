"""Duties and file of a run: complete, readable by everyone, the same with and without the graph."""

import contextlib

import pytest
from graph import Run, free_domain, record
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from ballbot_ros.engine.golden import duty_sha256
from ballbot_ros.engine.scenario.reader import load_scenario
from ballbot_ros.parameters.timing import TICK_NS
from ballbot_ros.recording.messages.topics import TOPICS
from ballbot_ros.recording.reader import RecordingReader

pytestmark = pytest.mark.graph

TICKS = 400
# A kernel, a link, dead times of everything, noise, a battery that drains and a map: what could be
# lost on the way.
SETTINGS = [
    ('plant_sim', 'kernel', True),
    ('plant_sim', 'link', True),
    ('controller', 'time_variation', 0.4),
    ('controller', 'kernel_defect', True),
    ('plant_sim', 'duration', 1.6),
    ('plant_sim', 'battery_model', 'draining'),
    ('plant_sim', 'actuator_delay', 1),
    ('plant_sim', 'actuator_delay_jitter', 3),
    ('plant_sim', 'map', 'track'),
    ('plant_sim', 'on_wall_hit', 'report'),
    ('gyro_driver', 'noise', 0.7),
    ('gyro_driver', 'delay', 2),
    ('gyro_driver', 'delay_jitter', 4),
    ('encoder_driver', 'delay', 3),
    ('sonar_driver', 'delay', 20),
    ('sonar_driver', 'delay_jitter', 90),
]
COUNTS = {
    4: TICKS,
    20: TICKS // 5,
    100: TICKS // 25,
}
UNSTAMPED = {'/operating_state', '/bluetooth/tx', '/lcd', '/wall_hit', '/brick/tasks'}
ONLY_IN_THE_GRAPH = {
    '/diagnostics', '/recorder/ack', '/participants', '/plant/roll_call', '/plant/run_status',
    '/rosout', '/parameter_events',
}  # fmt: skip


@pytest.fixture(scope='module')
def expected_sha256():
    scenario = load_scenario('stationary')
    for setting in SETTINGS:
        scenario.parameters.set(*setting)
    return duty_sha256(scenario)


@pytest.fixture
def recordings(tmp_path, expected_sha256):
    """The recordings of the same run in all arrangements of processes, made at the same time."""
    words = ['stationary', *(f'--set={node}.{name}={value}' for node, name, value in SETTINGS)]
    with contextlib.ExitStack() as stack:
        runs = {}
        for processes in ('separate', 'one'):
            run = Run(stack.enter_context(free_domain()), *words, '--processes', processes,
                      '--json', '--output', tmp_path / processes)  # fmt: skip
            stack.callback(run.kill)
            runs[processes] = run
        _, result = record(tmp_path / 'none', *words)
        results = {'none': result}
        for processes, run in runs.items():
            # Such a short run may miss the expectations.
            assert run.finish() in (0, 1), (processes, run.stderr)
            results[processes] = run.result
    for processes, result in results.items():
        assert result['duty_sha256'] == expected_sha256, processes
    return {processes: tmp_path / processes / 'stationary.mcap' for processes in results}


def test_all_ways_of_running_give_the_same_duties_and_the_same_readable_recording(
    recordings, command
):
    for processes, recording in recordings.items():
        nothing_is_missing(recording, processes)
        mcap_reads_it_and_its_checksums_hold(recording, processes)
        rosbags_decodes_every_message(recording, processes)
        the_file_alone_is_enough_for_a_replay(recording, processes)
        status, output, errors = command('replay', recording)
        assert (status, errors) == (0, ''), processes
        assert f'robot: identical, {TICKS} ticks' in output, processes
    the_graph_records_what_the_loop_without_ros_records(recordings)


def nothing_is_missing(recording, processes):
    with RecordingReader(recording) as reader:
        assert reader.complete, processes
        found = reader.topics()
        assert '/plant/steps' not in found, processes
        for topic in TOPICS:
            if topic.period_ns:
                name = '/' + topic.name.lstrip('/')
                count = COUNTS[topic.period_ns // 1_000_000]
                assert found[name].message_count == count, (processes, name)
        for name in ('/plant/run', '/operating_state', '/lcd', '/sound', '/bluetooth/tx'):
            assert found[name].message_count > 0, (processes, name)
        assert found['/brick/tasks'].message_count == TICKS // 25, processes


def mcap_reads_it_and_its_checksums_hold(recording, processes):
    with recording.open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == 'ros2', processes
        summary = reader.get_summary()
        count = 0
        for schema, channel, message in reader.iter_messages():
            assert schema.encoding == 'ros2msg', processes
            assert channel.message_encoding == 'cdr', processes
            assert channel.metadata['offered_qos_profiles'], processes
            assert message.log_time >= 1_000_000_000, processes
            count += 1
        assert summary.statistics.message_count == count > TICKS, processes


def rosbags_decodes_every_message(recording, processes):
    with AnyReader([recording]) as reader:
        count = 0
        for connection, _, data in reader.messages():
            assert reader.deserialize(data, connection.msgtype) is not None, processes
            count += 1
        assert count == reader.message_count, processes


def the_file_alone_is_enough_for_a_replay(recording, processes):
    with RecordingReader(recording) as reader:
        attached = reader.attachments()
    assert b'pitch_x_deg: 4.0' in attached['scenario.yaml'].data, processes
    assert b'start_pitch_x: 0.0698' in attached['parameters.yaml'].data, processes
    assert b'ballbot_ros' in attached['versions.yaml'].data, processes


def the_graph_records_what_the_loop_without_ros_records(recordings):
    def content(path):
        with RecordingReader(path) as reader:
            return set(reader.topics()) - ONLY_IN_THE_GRAPH - {'/plant/run'}

    def decoded(path):
        found = {}
        with RecordingReader(path) as reader:
            for topic, stamp, message in reader.messages(topics):
                found.setdefault(topic, []).append((stamp, repr(message)))
        return {topic: sorted(messages) for topic, messages in found.items()}

    topics = content(recordings['none'])
    expected = decoded(recordings['none'])
    for processes in ('separate', 'one'):
        assert content(recordings[processes]) == topics, processes
        found = decoded(recordings[processes])
        assert found.keys() == expected.keys(), processes
        for topic, ours in found.items():
            theirs = expected[topic]
            assert [text for _, text in ours] == [text for _, text in theirs], (processes, topic)
            apart = [abs(a - b) for (a, _), (b, _) in zip(ours, theirs, strict=True)]
            allowed = TICK_NS if topic in UNSTAMPED else 0
            assert max(apart) <= allowed, (processes, topic)
