"""Messages as arrays, with the same numbers as the single messages."""

import struct

import numpy as np
import pytest
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from text_messages import STRING, string

from ballbot_ros.errors import RecordingError
from ballbot_ros.recording.batch import Batch
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.schemas import encoder, new_message
from ballbot_ros.recording.writer import RecordingWriter

HEADER = 'std_msgs/msg/Header'
JOINTS = 'sensor_msgs/msg/JointState'


def all_records(reader, topic):
    """Return the messages of a topic as arrays, each group with the messages themselves."""
    for batch in reader.batches():
        for rows, records in reader.records(topic, batch, batch.rows()[topic]):
            yield records, [reader.decode(batch.message(row)) for row in rows]


def is_same(found, value):
    if isinstance(value, str) or (isinstance(value, list) and not hasattr(found, 'dtype')):
        return True
    if hasattr(value, '__msgtype__'):
        names = found.dtype.names or ()
        return all(is_same(found[name], getattr(value, name)) for name in names)
    return np.array_equal(found, value, equal_nan=np.asarray(value).dtype.kind == 'f')


def test_the_arrays_have_the_content_of_the_messages(recording, sample):
    compared = 0
    with RecordingReader(recording) as reader:
        for topic in reader.topics():
            for records, messages in all_records(reader, topic):
                for record, message in zip(records, messages, strict=True):
                    assert is_same(record, message), (topic, message)
                    compared += 1
    assert compared == len(sample)


def test_a_chunk_without_records_has_no_messages():
    batch = Batch.of_records(b'', {})
    assert list(batch.messages()) == []
    assert batch.rows() == {}


@pytest.mark.parametrize(
    'options',
    [
        {'compression': CompressionType.ZSTD, 'chunk_size': 500},
        {'compression': CompressionType.LZ4},
        {'use_chunking': False},
    ],
)
def test_batches_are_the_messages_of_the_mcap_package(tmp_path, options):
    path = tmp_path / 'foreign.mcap'
    with path.open('wb') as stream:
        writer = Writer(stream, **options)
        writer.start('ros2')
        schema = writer.register_schema(HEADER, 'ros2msg', b'')
        channels = [writer.register_channel(name, 'cdr', schema) for name in ('/a', '/b', '/a')]
        for number in range(20_000 if 'use_chunking' in options else 300):
            content = struct.pack('<4siI', b'\0\1\0\0', number, 1) + b'text' * (number % 3)
            writer.add_message(channels[number % 3], 5, content, 7, number)
        writer.finish()
    with path.open('rb') as stream:
        expected = [
            (channel.topic, message.log_time, message.sequence, message.data)
            for _, channel, message in make_reader(stream).iter_messages(log_time_order=False)
        ]
    with RecordingReader(path) as reader:
        assert [tuple(each) for each in reader.raw_messages()] == expected
        batches = list(reader.batches())
        assert [each for batch in batches for each in batch.messages()] == expected
        assert len(batches) < 50
        assert all(len(batch.data) < 2**19 for batch in batches)
        assert sum(len(batch.rows()['/a']) for batch in reader.batches(['/a'])) == sum(
            topic == '/a' for topic, *_ in expected
        )


def write(path, type_name, contents):
    with RecordingWriter(path) as writer:
        topic = writer.add_topic('/topic', type_name)
        for number, content in enumerate(contents):
            writer.write(topic, number, content, number)
    return path


def joints(*names):
    message = new_message(JOINTS)
    message.name, message.position = list(names), [float(len(name)) for name in names]
    return encoder(JOINTS)(message)


def test_content_is_not_matched_beyond_its_message(tmp_path):
    contents = [string(text) for text in ('a', 'b', 'a')]
    with RecordingReader(write(tmp_path / 'texts.mcap', STRING, contents)) as reader:
        (batch,) = reader.batches()
        rows = batch.rows()['/topic']
        assert batch.match_bytes(rows, 8, b'a').tolist() == [True, False, True]
        next_opcode = bytes([Opcode.MESSAGE])
        assert not batch.match_bytes(rows, 8, b'a\0' + next_opcode).any()


def test_the_largest_log_time_is_that_of_int64(tmp_path):
    path = tmp_path / 'late.mcap'
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start('ros2')
        channel = writer.register_channel('/a', 'cdr', 0)
        writer.add_message(channel, 2**64 - 1, b'', 0)
        writer.finish()
    with RecordingReader(path) as reader:
        assert [batch.log_ns.tolist() for batch in reader.batches()] == [[2**63 - 1]]


def test_messages_of_several_forms_are_distinguished(tmp_path):
    contents = [joints('a', 'b'), joints('a'), joints('a', 'c'), joints('a', 'b'), joints()]
    with RecordingReader(write(tmp_path / 'forms.mcap', JOINTS, contents)) as reader:
        (batch,) = reader.batches()
        groups = [
            (rows.tolist(), records.position.tolist())
            for rows, records in reader.records('/topic', batch, batch.rows()['/topic'])
        ]
    assert groups == [
        ([0, 3], [[1.0, 1.0]] * 2),
        ([1], [[1.0]]),
        ([2], [[1.0, 1.0]]),
        ([4], [[]]),
    ]


def test_each_message_has_its_own_byte_order(tmp_path):
    big = b'\0\0\0\0' + struct.pack('>iII4s', 1, 2, 4, b'map\0')
    little = b'\0\1\0\0' + struct.pack('<iII4s', 3, 4, 4, b'map\0')
    with RecordingReader(write(tmp_path / 'order.mcap', HEADER, [big, little, big])) as reader:
        found = [records.stamp.sec.tolist() for records, _ in all_records(reader, '/topic')]
        stamps = [batch.stamps_ns(np.arange(len(batch))).tolist() for batch in reader.batches()]
    assert found == [[1, 1], [3]]
    assert stamps == [[1_000_000_002, 3_000_000_004, 1_000_000_002]]


def test_a_malformed_message_is_found_among_others(tmp_path):
    contents = [joints('a'), joints('a')[:-3], joints('a')]
    with (
        RecordingReader(write(tmp_path / 'none.mcap', JOINTS, contents)) as reader,
        pytest.raises(
            RecordingError, match=r'/topic at 1 ns is not a valid sensor_msgs/msg/JointState'
        ),
    ):
        list(all_records(reader, '/topic'))


@pytest.mark.parametrize(
    'records',
    [
        struct.pack('<BQ', 5, 22) + bytes(21),
        struct.pack('<BQ', 5, 2**63) + bytes(22),
        struct.pack('<BQ', 5, 10) + bytes(10),
        struct.pack('<BQH', 5, 22, 9) + bytes(20),
    ],
)
def test_incomplete_records_are_refused(records):
    with pytest.raises(McapError):
        Batch.of_records(records, {0: '/topic'})
