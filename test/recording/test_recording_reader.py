"""Reading complete files, files of a killed recorder, and files of other writers."""

import fcntl
import re
import struct

import pytest
from hypothesis import example, settings
from hypothesis import strategies as st
from laws import given
from mcap.opcode import Opcode
from recorded_bytes import FOREIGN, UNCHUNKED, UNCOMPRESSED, flip, write_foreign
from text_messages import STRING, string

from ballbot_ros.errors import RecordingError
from ballbot_ros.recording import reader as reading
from ballbot_ros.recording.mcap_records import LimitedReader
from ballbot_ros.recording.reader import RecordingReader, is_finished
from ballbot_ros.recording.schemas import encoder, new_message
from ballbot_ros.recording.writer import RecordingWriter

MAGIC_SIZE = 8


@pytest.fixture(scope='module')
def damaged(recording, tmp_path_factory):
    """Return a function that changes a copy of the recording's bytes and reads it."""
    path = tmp_path_factory.mktemp('damaged') / 'damaged.mcap'
    content = recording.read_bytes()

    def read(change):
        path.write_bytes(change(content))
        with RecordingReader(path) as reader:
            raw = list(reader.raw_messages())
            return raw, list(reader.messages()), reader.count, reader.damage

    return read


NUMBERS = [str(number) for number in range(10)]


def test_every_message_comes_back(recording, sample, plain):
    with RecordingReader(recording) as reader:
        assert reader.complete
        assert reader.damage is None
        assert reader.count == len(sample)
        assert reader.topics() == {topic: (type_name, 20) for topic, type_name, *_ in sample}
        read = list(reader.messages())
    assert len(read) == len(sample)
    for (topic, type_name, stamp_ns, message, _), found in zip(sample, read, strict=True):
        assert found[:2] == (topic, stamp_ns)
        assert plain(found[2], type_name) == plain(message, type_name)


def test_only_a_file_with_its_end_is_finished(recording, tmp_path):
    assert is_finished(recording)
    content, path = recording.read_bytes(), tmp_path / 'part.mcap'
    assert not is_finished(path)
    for size in (0, 3, MAGIC_SIZE, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:size])
        assert not is_finished(path), size


def test_topics_can_be_selected_and_read_in_parallel(recording, sample):
    with RecordingReader(recording) as reader:
        both = {'/imu', '/clock'}
        assert [(topic, stamp) for topic, stamp, _ in reader.messages(both)] == [
            (topic, stamp) for topic, _, stamp, *_ in sample if topic in both
        ]
        assert list(reader.messages([])) == []
        assert all(len(batch) for batch in reader.batches(['/imu'], sample[-5][2]))
        pairs = list(zip(reader.messages(['/imu']), reader.raw_messages(['/clock']), strict=True))
        assert len(pairs) == 20


def test_attachments_and_metadata_come_back(recording):
    with RecordingReader(recording) as reader:
        assert reader.attachments() == {
            'scenario.yaml': ('application/yaml', b'name: stationary\n')
        }
        assert reader.metadata()['run'] == {'seed': '1'}


@settings(max_examples=100)
@given(place=st.floats(0, 1, exclude_max=True))
def test_a_file_cut_off_anywhere_yields_a_prefix(place, recording, sample, damaged):
    length = recording.stat().st_size
    size = MAGIC_SIZE + int(place * (length - MAGIC_SIZE))
    raw, messages, count, damage = damaged(lambda content: content[:size])
    assert [message.data for message in raw] == [row[4] for row in sample[: len(raw)]]
    assert [row[:2] for row in messages] == [(row[0], row[2]) for row in sample[: len(raw)]]
    assert count == len(raw) == len(messages)
    assert damage == f'cut off at byte {size}'


def test_complete_chunks_before_a_cut_are_read(tmp_path):
    path = tmp_path / 'long.mcap'
    with RecordingWriter(path, chunk_size=10_000) as writer:
        topic = writer.add_topic('/lcd', STRING)
        for number in range(2000):
            writer.write(topic, number, string(f'{number**3}'), number)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with RecordingReader(path) as reader:
        assert reader.count > 500
        assert [message.data for _, _, message in reader.messages()] == [
            str(number**3) for number in range(reader.count)
        ]


def test_the_times_of_a_cut_file_are_those_of_its_messages(tmp_path):
    path = tmp_path / 'cut.mcap'
    with RecordingWriter(path) as writer:
        topic = writer.add_topic('/lcd', STRING)
        for stamp_ns in (5, 2, 9, 7):
            writer.write(topic, stamp_ns, string('a'), 0)
    path.write_bytes(path.read_bytes()[:-1])
    with RecordingReader(path) as reader:
        assert reader.times == (2, 9)


@settings(max_examples=100)
@given(place=st.floats(0, 1, exclude_max=True), value=st.integers(1, 255))
def test_a_corrupt_byte_is_no_traceback(place, value, damaged):
    def change(content):
        return flip(content, int(place * len(content)), value)

    try:
        raw, _, _, damage = damaged(change)
    except RecordingError as error:
        raw, damage = [], str(error)
    assert len(raw) == 280 or damage
    assert '\n' not in (damage or '')


@settings(max_examples=30)
@given(tail=st.binary(max_size=200))
@example(tail=bytes(100))
def test_garbage_after_a_cut_is_no_traceback(tail, sample, damaged):
    raw, _, _, damage = damaged(
        lambda content: content[: content.rindex(b'zstd', 0, 25_000)] + tail
    )
    assert damage
    assert [message.data for message in raw][:100] == [row[4] for row in sample[:100]]


def second_chunk(content):
    """Return the position of the name of its compression."""
    return content.index(b'zstd', content.index(b'zstd') + 4)


DAMAGE = {
    'a chunk': (lambda content: flip(content, second_chunk(content) + 100), 100),
    'the kind of a chunk': (
        lambda content: flip(content, second_chunk(content) - 41, 0xFF ^ Opcode.CHUNK),
        180,
    ),
    'an attachment': (
        lambda content: content.replace(b'name: stationary', b'name: stationarz'),
        280,
    ),
    'the summary': (lambda content: flip(content, len(content) - 20), 280),
    'a count of the summary': (
        lambda content: content.replace(struct.pack('<HQ', 1, 20), struct.pack('<HQ', 1, 21)),
        280,
    ),
}
"""A change of the file, and the number of messages that are still read."""


@pytest.mark.parametrize('part', DAMAGE)
def test_damage_is_noticed_and_nothing_else_is_lost(part, damaged, sample):
    change, count_left = DAMAGE[part]
    raw, _, count, damage = damaged(change)
    assert len(raw) == count == count_left
    assert all(message.data == sample[message.sequence][4] for message in raw)
    assert re.fullmatch(r'corrupt before byte \d+', damage)


@pytest.mark.parametrize(
    ('data', 'reason'),
    [
        (b'', 'empty file'),
        (b'\x89MCAP', 'not an MCAP file'),
        (b'SQLite format 3\0', 'not an MCAP file'),
    ],
)
def test_a_file_that_is_not_a_recording_is_an_error(tmp_path, data, reason):
    path = tmp_path / 'other.mcap'
    path.write_bytes(data)
    with pytest.raises(RecordingError) as error:
        RecordingReader(path)
    assert str(error.value) == f'{path}: {reason}'


def test_files_that_cannot_be_opened_are_errors(tmp_path):
    with pytest.raises(RecordingError, match=r'missing\.mcap: No such file or directory$'):
        RecordingReader(tmp_path / 'missing.mcap')
    with pytest.raises(RecordingError, match=r': Is a directory$'):
        RecordingReader(tmp_path)


def test_another_profile_is_an_error(tmp_path):
    path = tmp_path / 'ros1.mcap'
    write_foreign(path, NUMBERS, profile='ros1')
    with pytest.raises(RecordingError, match=r"ros1\.mcap: profile 'ros1' is not 'ros2'$"):
        RecordingReader(path)


def test_an_unknown_topic_is_an_error(recording):
    with RecordingReader(recording) as reader:
        for read in (reader.messages, reader.raw_messages):
            with pytest.raises(
                RecordingError, match=r"topic '/gyro' not found, only /battery.*, /wrench"
            ):
                next(read(['/gyro']))


def test_messages_that_cannot_be_decoded_can_be_read_raw(tmp_path):
    path = tmp_path / 'foreign.mcap'
    for contents, options, reason in (
        (
            NUMBERS,
            {'type_name': 'a/msg/B', 'definition': b''},
            "a/msg/B: 'a/msg/B' is not a message type of ROS 2 Jazzy",
        ),
        (
            NUMBERS,
            {'type_name': 'a/msg/B', 'definition': b'a/Unknown data'},
            'a/msg/B: its definition is invalid: ',
        ),
        ([b'{}'] * 10, {'encoding': 'json'}, 'std_msgs/msg/String: '),
    ):
        write_foreign(path, contents, **options)
        with RecordingReader(path) as reader:
            assert len(list(reader.raw_messages())) == 10, reason
            with pytest.raises(RecordingError) as error:
                next(reader.messages())
        assert str(error.value).startswith(f'{path}: /lcd at 0 ns is not a valid {reason}')


@pytest.mark.parametrize('data', [b'', b'\0', string('abc')[:-2], b'\0\1\0\0\1\0\0\0\xff\0'])
def test_a_message_of_another_form_is_an_error(tmp_path, data):
    path = tmp_path / 'form.mcap'
    with RecordingWriter(path) as writer:
        writer.write(writer.add_topic('/lcd', STRING), 7, data, 0)
    with (
        RecordingReader(path) as reader,
        pytest.raises(
            RecordingError, match=r'form\.mcap: /lcd at 7 ns is not a valid std_msgs/msg/String:'
        ),
    ):
        list(reader.messages())


def test_big_endian_and_padded_messages_are_read(tmp_path):
    path = tmp_path / 'endian.mcap'
    with RecordingWriter(path) as writer:
        topic = writer.add_topic('/header', 'std_msgs/msg/Header')
        big = b'\0\0\0\0' + struct.pack('>iII4s', 1, 2, 4, b'map\0')
        writer.write(topic, 0, big, 0)
        writer.write(
            topic,
            1,
            encoder('std_msgs/msg/Header')(new_message('std_msgs/msg/Header')) + b'\0' * 3,
            1,
        )
    with RecordingReader(path) as reader:
        (_, _, first), (_, _, second) = reader.messages()
    assert (first.stamp.sec, first.stamp.nanosec, first.frame_id) == (1, 2, 'map')
    assert second.frame_id == ''


def test_files_of_other_writers_are_read(tmp_path):
    path = tmp_path / 'foreign.mcap'
    for options in (*FOREIGN, {'definition': b''}):
        write_foreign(path, NUMBERS, **options)
        with RecordingReader(path) as reader:
            assert reader.complete, options
            assert reader.library == 'another recorder', options
            assert reader.topics() == {'/lcd': (STRING, 10)}, options
            assert [message.data for _, _, message in reader.messages()] == NUMBERS, options


def test_messages_outside_chunks_are_read_up_to_a_cut(tmp_path):
    path = tmp_path / 'foreign.mcap'
    content = write_foreign(path, NUMBERS, **UNCHUNKED)
    for size in range(content.index(string('0')), content.index(b'notes.txt')):
        path.write_bytes(content[:size])
        with RecordingReader(path) as reader:
            read = [message.data for _, _, message in reader.messages()]
            assert read == NUMBERS[: reader.count], size
    assert reader.count == 10


def test_messages_outside_chunks_keep_their_place(tmp_path):
    path = tmp_path / 'mixed.mcap'
    content = write_foreign(path, NUMBERS, **UNCOMPRESSED)
    second = content.index(string('1')) - 31
    chunk = content.rindex(b'\x06', 0, second)
    loose = struct.pack('<BQHIQQ', Opcode.MESSAGE, 22 + 10, 1, 77, 0, 0) + string('x')
    path.write_bytes(content[:chunk] + loose + content[chunk:])
    with RecordingReader(path) as reader:
        assert [message.data for _, _, message in reader.messages()][:3] == ['0', 'x', '1']


def test_reading_begins_at_a_stamp_and_unpacks_no_earlier_chunk(recording, sample, monkeypatch):
    unpacked = []

    class Noting(LimitedReader):
        def unpack(self, chunk):
            unpacked.append(chunk.message_end_time)
            return super().unpack(chunk)

    monkeypatch.setattr(reading, 'LimitedReader', Noting)
    with RecordingReader(recording) as reader:
        found = [message.stamp_ns for message in reader.raw_messages(start_ns=sample[150][2])]
    assert found == [row[2] for row in sample[150:]]
    assert len(unpacked) == 2
    assert min(unpacked) >= sample[150][2]


def test_the_definition_in_the_file_counts(tmp_path):
    path = tmp_path / 'own.mcap'
    fields = b'\7\0\0\0\2\0\0\0a\0'
    message = b'int32 number\nstring data'
    # The middleware gives a message without fields a byte.
    nested = b'std_msgs/Empty e\n%b\n%b\nMSG: std_msgs/Empty\n' % (message, b'=' * 80)
    structure = b'module a { module msg { struct B { long number; string data; }; }; };'
    for type_name, encoding, definition, data in (
        (STRING, 'ros2msg', message, fields),  # unlike that of any ROS release
        ('a/msg/B', 'ros2msg', message, fields),  # not installed
        ('a/msg/B', 'ros2msg', nested, bytes(4) + fields),
        ('a/msg/B', 'ros2idl', structure, fields),
    ):
        write_foreign(
            path, [b'\0\1\0\0' + data], type_name=type_name, definition=definition,
            schema_encoding=encoding,
        )  # fmt: skip
        with RecordingReader(path) as reader:
            assert reader.unreadable() == {}, encoding
            _, _, found = next(reader.messages())
        assert (found.number, found.data) == (7, 'a'), (type_name, definition)


def test_unreadable_topics_have_a_reason(tmp_path):
    path = tmp_path / 'own.mcap'
    other = b'module b { module msg { struct C { long number; }; }; };'
    for options, reason in (
        ({}, None),
        ({'encoding': 'json'}, "its encoding is 'json', not cdr"),
        ({'schema_encoding': 'proto'}, "'proto' is not an encoding of ROS 2 types"),
        (
            {'schema_encoding': 'ros2idl', 'definition': other},
            'its definition belongs to another type',
        ),
        (
            {'type_name': 'a/msg/B', 'definition': b''},
            "'a/msg/B' is not a message type of ROS 2 Jazzy",
        ),
    ):
        write_foreign(path, ['a'], **options)
        with RecordingReader(path) as reader:
            assert reader.unreadable() == ({'/lcd': reason} if reason else {})


def test_a_recording_being_written_is_recognised(tmp_path):
    path = tmp_path / 'new.mcap'
    with RecordingWriter(path) as writer, RecordingReader(path) as reader:
        assert reader.being_written
        writer.close()
        assert not reader.being_written
        # Asking leaves no lock.
        with path.open('rb') as other:
            fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)


def test_a_closed_reader_raises_an_error(recording):
    with RecordingReader(recording) as reader:
        messages = reader.messages()
    with pytest.raises(RecordingError, match=r'sample\.mcap: the recording is closed$'):
        next(messages)
