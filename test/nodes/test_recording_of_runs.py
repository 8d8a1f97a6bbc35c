"""The file of a run: complete, readable by everyone, and the same with and without the graph."""

import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from ballbot_ros.messages.topics import TOPICS
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.simulation.timing import TICK_NS

pytestmark = pytest.mark.graph

DURATION_S = 3.0
TICKS = 750
COUNTS = {
    4: TICKS,
    20: TICKS // 5,
    100: TICKS // 25,
}
UNSTAMPED = {'/operating_state', '/bluetooth/tx', '/lcd', '/wall_hit'}
ONLY_IN_THE_GRAPH = {'/diagnostics', '/recorder/ack', '/rosout', '/parameter_events'}


@pytest.fixture(scope='module')
def recordings(tmp_path_factory):
    from graph import Run, free_domain

    paths = {}
    for processes in ('separate', 'one', 'none'):
        folder = tmp_path_factory.mktemp(processes)
        with free_domain() as domain:
            run = Run(domain, 'stationary', '--processes', processes, '--output', folder,
                      f'--set=plant_sim.duration={DURATION_S}')  # fmt: skip
            assert run.finish() in (0, 1), run.stderr
        paths[processes] = folder / 'stationary.mcap'
    return paths


@pytest.fixture(params=['separate', 'one', 'none'])
def recording(request, recordings):
    return recordings[request.param]


def test_nothing_is_missing(recording):
    with RecordingReader(recording) as reader:
        assert reader.complete
        found = reader.topics()
        for topic in TOPICS:
            if topic.period_ns:
                name = '/' + topic.name.lstrip('/')
                assert found[name].message_count == COUNTS[topic.period_ns // 1_000_000], name
        for name in ('/plant/run', '/operating_state', '/lcd', '/sound', '/bluetooth/tx'):
            assert found[name].message_count > 0, name


def test_mcap_reads_it_and_its_checksums_hold(recording):
    with recording.open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == 'ros2'
        summary = reader.get_summary()
        count = 0
        for schema, channel, message in reader.iter_messages():
            assert schema.encoding == 'ros2msg'
            assert channel.message_encoding == 'cdr'
            assert channel.metadata['offered_qos_profiles']
            assert message.log_time >= 1_000_000_000
            count += 1
        assert summary.statistics.message_count == count > TICKS


def test_rosbags_decodes_every_message(recording):
    with AnyReader([recording]) as reader:
        count = 0
        for connection, _, data in reader.messages():
            assert reader.deserialize(data, connection.msgtype) is not None
            count += 1
        assert count == reader.message_count


def test_the_file_alone_is_enough_to_run_it_again(recording):
    with RecordingReader(recording) as reader:
        attached = reader.attachments()
    assert b'pitch_x_deg: 4.0' in attached['scenario.yaml'].data
    assert b'start_pitch_x: 0.0698' in attached['parameters.yaml'].data
    assert b'ballbot_ros' in attached['versions.yaml'].data


def test_the_graph_records_what_the_loop_without_ros_records(recordings):
    def content(path):
        with RecordingReader(path) as reader:
            return set(reader.topics()) - ONLY_IN_THE_GRAPH - {'/plant/run'}

    def decoded(path, topic):
        with RecordingReader(path) as reader:
            return sorted((stamp, repr(m)) for _, stamp, m in reader.messages([topic]))

    topics = content(recordings['none'])
    for processes in ('separate', 'one'):
        assert content(recordings[processes]) == topics
        for topic in topics:
            ours, theirs = (decoded(recordings[p], topic) for p in (processes, 'none'))
            assert [text for _, text in ours] == [text for _, text in theirs], topic
            apart = [abs(a - b) for (a, _), (b, _) in zip(ours, theirs, strict=True)]
            assert max(apart) <= (TICK_NS if topic in UNSTAMPED else 0), topic
