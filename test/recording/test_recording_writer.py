"""Recordings as other readers see them, and the remains of a failed write."""

import contextlib
import os
import random
import resource
import shutil
from dataclasses import asdict, replace

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from laws import given
from mcap.reader import make_reader
from mcap.records import Attachment
from recorded_bytes import write_foreign
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from ruamel.yaml import YAML
from text_messages import STRING, string

from ballbot_ros.errors import RecordingError
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.rosbag2 import RELIABLE_LATCHED, QosProfile, parse_offered_qos
from ballbot_ros.recording.schemas import schema
from ballbot_ros.recording.writer import RecordingWriter

MAGIC_SIZE = 8


def write_strings(path, numbers):
    with RecordingWriter(path) as writer:
        topic = writer.add_topic('/lcd', STRING)
        for number in numbers:
            writer.write(topic, number, string(f'line {number}'), number)


def lines(path):
    with RecordingReader(path) as reader:
        return [message.data for _, _, message in reader.messages()], reader.damage


def rosbag2_metadata(path):
    with path.open('rb') as stream:
        record = next(r for r in make_reader(stream).iter_metadata() if r.name == 'rosbag2')
    return record.metadata['serialized_metadata']


def test_mcap_reads_it(recording, sample):
    with recording.open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == 'ros2'
        read = list(reader.iter_messages(log_time_order=False))
        summary = reader.get_summary()
        (attachment,) = reader.iter_attachments()
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    assert attachment == Attachment(
        create_time=0, log_time=0, name='scenario.yaml', media_type='application/yaml',
        data=b'name: stationary\n',
    )  # fmt: skip
    assert metadata.keys() == {'run', 'rosbag2'}
    assert metadata['run'] == {'seed': '1'}
    assert len(read) == len(sample)
    for number, ((topic, type_name, stamp_ns, _, data), row) in enumerate(
        zip(sample, read, strict=True)
    ):
        definition, channel, message = row
        assert (channel.topic, channel.message_encoding) == (topic, 'cdr')
        assert (definition.name, definition.encoding) == (type_name, 'ros2msg')
        assert definition.data.decode() == schema(type_name).text
        assert channel.metadata['topic_type_hash'] == schema(type_name).type_hash
        assert message.sequence == number
        assert (message.log_time, message.publish_time) == (stamp_ns, stamp_ns)
        assert message.data == data
    statistics = summary.statistics
    assert statistics.message_count == len(sample)
    assert statistics.message_start_time == sample[0][2]
    assert statistics.message_end_time == sample[-1][2]
    assert statistics.chunk_count == len(summary.chunk_indexes) == 3
    assert statistics.channel_count == len(summary.channels) == 14
    assert statistics.schema_count == len(summary.schemas) == 14
    assert statistics.attachment_count == len(summary.attachment_indexes) == 1
    assert statistics.metadata_count == len(summary.metadata_indexes) == 2
    assert {
        summary.channels[number].topic: count
        for number, count in (statistics.channel_message_counts.items())
    } == {topic: 20 for topic, *_ in sample}
    assert {index.compression for index in summary.chunk_indexes} == {'zstd'}


def test_rosbags_reads_the_file(recording, sample, plain):
    with AnyReader([recording]) as reader:
        read = [
            (
                connection.topic,
                connection.msgtype,
                stamp,
                reader.deserialize(data, connection.msgtype),
            )
            for connection, stamp, data in reader.messages()
        ]
    assert len(read) == len(sample)
    for (topic, type_name, stamp_ns, message, _), found in zip(sample, read, strict=True):
        assert found[:3] == (topic, type_name, stamp_ns)
        assert plain(found[3], type_name) == plain(message, type_name)


def test_rosbags_reads_a_bag_directory_made_of_it(recording, sample, tmp_path):
    shutil.copy(recording, tmp_path)
    text = rosbag2_metadata(recording).replace('\n', '\n  ')
    (tmp_path / 'metadata.yaml').write_text(f'rosbag2_bagfile_information:\n  {text}\n')
    with Reader(tmp_path) as reader:
        assert reader.message_count == len(sample)
        assert reader.ros_distro == 'jazzy'
        assert reader.start_time == sample[0][2]
        assert len(list(reader.messages())) == len(sample)
        assert all(connection.ext.offered_qos_profiles for connection in reader.connections)


def test_mcap_ros2_support_decodes_it(recording, sample, plain):
    decoder = pytest.importorskip('mcap_ros2.decoder')
    with recording.open('rb') as stream:
        reader = make_reader(stream, decoder_factories=[decoder.DecoderFactory()])
        read = list(reader.iter_decoded_messages(log_time_order=False))
    assert len(read) == len(sample)
    for (_, type_name, _, message, _), found in zip(sample, read, strict=True):
        assert plain(found.decoded_message, type_name) == plain(message, type_name)


def test_rosbag2_metadata_is_as_rosbag2_writes_it(tmp_path):
    path = tmp_path / 'two wörds.mcap'
    with RecordingWriter(path) as writer:
        writer.add_topic('/clock', 'rosgraph_msgs/msg/Clock', qos=[])
        topic = writer.add_topic('/lcd', STRING)
        writer.write(topic, 5, string('a'), 0)
        writer.write(topic, 2, string('b'), 1)
    text = rosbag2_metadata(path)
    assert '&' not in text, 'an anchor'
    assert 'wörds' in text
    endless = {'sec': 9223372036, 'nsec': 854775807}
    extent = {
        'starting_time': {'nanoseconds_since_epoch': 2},
        'duration': {'nanoseconds': 3},
        'message_count': 2,
    }
    assert YAML(typ='safe').load(text) == {
        'version': 9,
        'storage_identifier': 'mcap',
        **extent,
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': '/clock',
                    'type': 'rosgraph_msgs/msg/Clock',
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': [],
                    'type_description_hash': schema('rosgraph_msgs/msg/Clock').type_hash,
                },
                'message_count': 0,
            },
            {
                'topic_metadata': {
                    'name': '/lcd',
                    'type': STRING,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': [
                        {
                            'history': 'keep_last',
                            'depth': 128,
                            'reliability': 'reliable',
                            'durability': 'transient_local',
                            'deadline': endless,
                            'lifespan': endless,
                            'liveliness': 'automatic',
                            'liveliness_lease_duration': endless,
                            'avoid_ros_namespace_conventions': False,
                        }
                    ],
                    'type_description_hash': schema(STRING).type_hash,
                },
                'message_count': 2,
            },
        ],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': ['two wörds.mcap'],
        'files': [{'path': 'two wörds.mcap', **extent}],
        'custom_data': None,
        'ros_distro': 'jazzy',
    }


def test_offered_qos_of_every_publisher_is_kept(tmp_path):
    path = tmp_path / 'qos.mcap'
    best_effort = QosProfile('unknown', 0, 'best_effort', 'volatile', lifespan=10 * 10**9)
    with RecordingWriter(path) as writer:
        writer.add_topic('/lcd', STRING, qos=[RELIABLE_LATCHED, best_effort])
    with path.open('rb') as stream:
        (channel,) = make_reader(stream).get_summary().channels.values()
    assert channel.metadata['offered_qos_profiles'].startswith(
        '- history: keep_last\n  depth: 128\n  reliability: reliable\n'
        '  durability: transient_local\n  deadline:\n    sec: 9223372036\n    nsec: 854775807\n'
    )
    second = YAML(typ='safe').load(channel.metadata['offered_qos_profiles'])[1]
    assert second['history'] == 'unknown'
    assert second['reliability'] == 'best_effort'
    assert second['lifespan'] == {'sec': 10, 'nsec': 0}
    assert second['avoid_ros_namespace_conventions'] is False


def test_the_qos_of_any_release_is_read(tmp_path):
    path = tmp_path / 'qos.mcap'
    text = (
        '- {history: %s, depth: 7, reliability: %s, durability: %s, deadline: {sec: 1, nsec: 5}, '
        'lifespan: {sec: 2, nsec: 6}, liveliness: %s, '
        'liveliness_lease_duration: {sec: 3, nsec: 7}, avoid_ros_namespace_conventions: true}'
    )
    profile = QosProfile(
        'keep_all', 7, 'best_effort', 'transient_local',
        1_000_000_005, 2_000_000_006, 'manual_by_topic', 3_000_000_007, True,
    )  # fmt: skip
    for written, expected in (
        (text % ('keep_all', 'best_effort', 'transient_local', 'manual_by_topic'), [profile]),
        (text % (2, 2, 1, 3), [profile]),  # Humble
        ('- history: 1', []),
        ('[', []),
    ):
        write_foreign(path, ['a'], metadata={'offered_qos_profiles': written})
        with RecordingReader(path) as reader:
            assert reader.offered_qos() == {'/lcd': expected}, written


def test_the_numbers_of_qos_policies_are_those_of_the_middleware():
    qos = pytest.importorskip('rclpy.qos')
    endless = {'sec': 9223372036, 'nsec': 854775807}
    for key, policies in (
        ('history', qos.HistoryPolicy),
        ('reliability', qos.ReliabilityPolicy),
        ('durability', qos.DurabilityPolicy),
        ('liveliness', qos.LivelinessPolicy),
    ):
        for policy in policies:
            if policy.name != 'BEST_AVAILABLE':  # of subscriptions, never offered
                offer = asdict(RELIABLE_LATCHED) | {key: int(policy)}
                offer |= dict.fromkeys(('deadline', 'lifespan'), endless)
                offer['liveliness_lease_duration'] = endless
                expected = replace(RELIABLE_LATCHED, **{key: policy.name.lower()})
                assert parse_offered_qos(str([offer])) == [expected], policy


def test_qos_is_converted_from_rclpy():
    qos = pytest.importorskip('rclpy.qos')
    duration = pytest.importorskip('rclpy.duration')
    profile = qos.QoSProfile(
        depth=128,
        reliability=qos.ReliabilityPolicy.RELIABLE,
        durability=qos.DurabilityPolicy.TRANSIENT_LOCAL,
        liveliness=qos.LivelinessPolicy.MANUAL_BY_TOPIC,
        deadline=duration.Duration(nanoseconds=1),
        lifespan=duration.Duration(nanoseconds=2),
        liveliness_lease_duration=duration.Duration(nanoseconds=3),
        avoid_ros_namespace_conventions=True,
    )
    assert QosProfile.from_rclpy(profile) == QosProfile(
        'keep_last', 128, 'reliable', 'transient_local', 1, 2, 'manual_by_topic', 3, True
    )


def test_the_same_messages_make_the_same_file(recording, record, sample, tmp_path):
    again = record(tmp_path / 'sample.mcap', sample)
    assert again.read_bytes() == recording.read_bytes()


@pytest.mark.parametrize('topics', [0, 1])
def test_a_recording_without_messages_is_complete(tmp_path, topics):
    path = tmp_path / 'empty.mcap'
    with RecordingWriter(path) as writer:
        for number in range(topics):
            writer.add_topic(f'/lcd_{number}', STRING)
    with path.open('rb') as stream:
        summary = make_reader(stream, validate_crcs=True).get_summary()
    assert summary.statistics.message_count == 0
    assert len(summary.channels) == topics
    with Reader(path) as reader:
        assert reader.message_count == 0
    with RecordingReader(path) as reader:
        assert reader.complete
        assert len(reader.topics()) == topics
    metadata = YAML(typ='safe').load(rosbag2_metadata(path))
    assert metadata['starting_time'] == {'nanoseconds_since_epoch': 2**63 - 1}


def test_sim_time_may_begin_at_zero(tmp_path):
    path = tmp_path / 'zero.mcap'
    write_strings(path, [0])
    metadata = YAML(typ='safe').load(rosbag2_metadata(path))
    assert metadata['starting_time'] == {'nanoseconds_since_epoch': 0}


def test_topics_of_a_type_share_its_definition(tmp_path):
    path = tmp_path / 'shared.mcap'
    with RecordingWriter(path) as writer:
        writer.add_topic('/lcd', STRING)
        writer.add_topic('/operating_state', STRING)
    with path.open('rb') as stream:
        assert len(make_reader(stream).get_summary().schemas) == 1


def test_a_file_name_that_is_not_unicode_is_described(tmp_path):
    path = tmp_path / os.fsdecode(b'\xff.mcap')
    write_strings(path, [1])
    metadata = YAML(typ='safe').load(rosbag2_metadata(path))
    assert metadata['relative_file_paths'] == ['\ufffd.mcap']


def test_flushed_messages_can_be_read_from_a_copy(tmp_path):
    path, copy = tmp_path / 'live.mcap', tmp_path / 'copy.mcap'
    with RecordingWriter(path) as writer:
        topic = writer.add_topic('/lcd', STRING)
        writer.add_attachment('scenario.yaml', 'application/yaml', b'name: stationary')
        writer.flush()
        shutil.copy(path, copy)
        with RecordingReader(copy) as reader:
            assert reader.count == 0
            assert reader.attachments().keys() == {'scenario.yaml'}
        for number in range(50):
            writer.write(topic, number, string(f'line {number}'), number)
        writer.flush()
        writer.write(topic, 50, string('later'), 50)
        shutil.copy(path, copy)
        assert lines(copy)[0] == [f'line {number}' for number in range(50)]
        assert lines(copy)[1] == f'cut off at byte {copy.stat().st_size}'
    assert lines(path)[1] is None


def test_an_existing_file_is_not_touched(tmp_path):
    path = tmp_path / 'old.mcap'
    path.write_bytes(b'old')
    with pytest.raises(RecordingError) as error:
        RecordingWriter(path)
    assert str(error.value) == f'{path}: already exists; choose another file'
    assert path.read_bytes() == b'old'


@pytest.mark.parametrize(
    ('place', 'reason'), [('missing', 'No such file or directory'), ('file', 'Not a directory')]
)
def test_a_file_that_cannot_be_created_is_an_error(tmp_path, place, reason):
    (tmp_path / 'file').touch()
    path = tmp_path / place / 'new.mcap'
    with pytest.raises(RecordingError) as error:
        RecordingWriter(path)
    assert str(error.value) == f'{path}: {reason}'


def test_topics_that_cannot_be_recorded_are_errors(tmp_path):
    path = tmp_path / 'topics.mcap'
    with RecordingWriter(path) as writer:
        writer.add_topic('/lcd', STRING, type_hash=schema(STRING).type_hash)
        with pytest.raises(RecordingError, match=r'topics\.mcap: topic /lcd was already added$'):
            writer.add_topic('/lcd', STRING)
        with pytest.raises(RecordingError, match=r"topics\.mcap: topic /a: 'a/msg/B' is not a mes"):
            writer.add_topic('/a', 'a/msg/B')
        with pytest.raises(RecordingError, match=r'/b: std_msgs/msg/String has the hash RIHS01_0'):
            writer.add_topic('/b', STRING, type_hash='RIHS01_0')
        # The hash of a type with a char is only known in the graph.
        writer.add_topic('/c', 'std_msgs/msg/Char', type_hash='RIHS01_0')
    assert lines(path) == ([], None)


def test_derived_and_published_messages_of_a_topic_have_different_channels(tmp_path):
    path = tmp_path / 'both.mcap'
    with RecordingWriter(path) as writer:
        for number, derived in enumerate((True, False, False)):
            if number < 2:
                topic = writer.add_topic('/lcd', STRING, derived=derived)
            writer.write(topic, number, string('a'), 1)
        writer.add_topic('/markers', STRING, derived=True)
    with RecordingReader(path) as reader:
        assert reader.topics()['/lcd'].message_count == 3
        assert reader.derived() == {'/markers'}
        assert len(list(reader.raw_messages(['/lcd']))) == 3
        bag = YAML(typ='safe').load(reader.metadata()['rosbag2']['serialized_metadata'])
    counts = {
        each['topic_metadata']['name']: each['message_count']
        for each in bag['topics_with_message_count']
    }
    assert counts == {'/lcd': 3, '/markers': 0}
    with path.open('rb') as stream:
        channels = make_reader(stream).get_summary().channels.values()
    assert [channel.metadata.get('ballbot_ros/derived') for channel in channels] == [
        'true', None, 'true',
    ]  # fmt: skip


@pytest.mark.parametrize(('stamp', 'sequence'), [(-1, 0), (2**63, 0), (0, -1), (0, 2**32)])
def test_a_message_that_does_not_fit_is_omitted_completely(tmp_path, stamp, sequence):
    path = tmp_path / 'fit.mcap'
    with RecordingWriter(path) as writer:
        topic = writer.add_topic('/lcd', STRING)
        with pytest.raises(RecordingError, match=r'fit\.mcap: /lcd: the stamp -?\d+ ns or '):
            writer.write(topic, stamp, string('b'), sequence)
        writer.write(topic, 0, string('a'), 0)
    assert lines(path) == (['a'], None)


def test_a_closed_recording_refuses_messages(tmp_path):
    writer = RecordingWriter(tmp_path / 'closed.mcap')
    topic = writer.add_topic('/lcd', STRING)
    writer.close()
    writer.close()
    for action in (
        lambda: writer.write(topic, 0, b'', 0),
        lambda: writer.add_topic('/a', STRING),
        lambda: writer.add_attachment('a', 'text/plain', b''),
        lambda: writer.add_metadata('a', {}),
        writer.flush,
    ):
        with pytest.raises(RecordingError, match=r'closed\.mcap: the recording is closed$'):
            action()


def test_an_incomplete_recording_states_the_reason(tmp_path):
    path = tmp_path / 'gap.mcap'
    with RecordingWriter(path) as writer:
        writer.mark_incomplete('/gyro: 3 messages lost at 1.2 s')
        writer.mark_incomplete('/sonar: 1 message lost at 4.0 s')
    assert lines(path)[1] == '/gyro: 3 messages lost at 1.2 s; /sonar: 1 message lost at 4.0 s'


@contextlib.contextmanager
def room_for(size):
    """Limit the size of this process's files, as if the disk were full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@settings(
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(room=st.integers(0, 20_000))
def test_a_full_disk_leaves_a_readable_prefix(tmp_path_factory, room):
    path = tmp_path_factory.mktemp('full') / 'full.mcap'
    chance = random.Random(3)
    texts = [f'{number} {chance.random()}' for number in range(400)]
    writer, failures = None, []
    with room_for(room):
        try:
            with RecordingWriter(path, chunk_size=2000) as writer:
                topic = writer.add_topic('/lcd', STRING)
                for number, text in enumerate(texts):
                    writer.write(topic, number, string(text), number)
                writer.add_attachment('scenario', 'text/plain', b'x' * 1000)
        except RecordingError as error:
            failures.append(str(error))
    if not failures:
        assert lines(path) == (texts, None)
        return
    assert failures == [f'{path}: File too large']
    size = path.stat().st_size
    assert size == room
    if writer:
        with pytest.raises(RecordingError, match=r'full\.mcap: the recording is closed$'):
            writer.flush()
    if size >= MAGIC_SIZE:
        read, damage = lines(path)
        assert read == texts[: len(read)]
        assert damage == f'cut off at byte {size}'
        with RecordingReader(path) as reader:
            assert not reader.being_written


@pytest.mark.parametrize('action', ['flush', 'add_attachment', 'add_metadata', 'close'])
def test_a_disk_that_fills_up_is_reported_once(tmp_path, action):
    path = tmp_path / 'full.mcap'
    data = random.Random(1).randbytes(20_000)
    writer = RecordingWriter(path)
    topic = writer.add_topic('/bluetooth/tx', 'std_msgs/msg/UInt8MultiArray')
    writer.write(topic, 0, data, 0)
    arguments = {
        'add_attachment': ('map', 'image/png', data),
        'add_metadata': ('run', {'note': data.hex()}),
    }
    with room_for(5000):
        with pytest.raises(RecordingError) as error:
            getattr(writer, action)(*arguments.get(action, ()))
        writer.close()
    assert str(error.value) == f'{path}: File too large'


@pytest.mark.parametrize(
    'happens', ['moved', 'removed', 'replaced', 'folder removed', 'folder replaced']
)
def test_a_removed_file_is_reported_at_the_end(tmp_path, happens):
    path = tmp_path / 'folder' / 'run.mcap'
    path.parent.mkdir()
    writer = RecordingWriter(path)
    elsewhere = tmp_path / 'elsewhere.mcap'
    path.rename(elsewhere)
    if happens == 'replaced':
        path.touch()
    if happens.startswith('folder'):
        path.parent.rmdir()
    if happens == 'folder replaced':
        path.parent.touch()
    if happens == 'removed':
        elsewhere.unlink()
    with pytest.raises(RecordingError, match=f'^{path}: moved or removed while being written$'):
        writer.close()
    if happens == 'moved':
        with RecordingReader(elsewhere) as reader:
            assert reader.complete
    writer.close()
