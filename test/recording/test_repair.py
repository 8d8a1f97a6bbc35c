"""Repair: what is before the damage is recovered byte for byte."""

import re
import shutil
import struct

import pytest
import yaml
from hypothesis import example
from hypothesis import strategies as st
from laws import given
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory
from recorded_bytes import FOREIGN, flip, write_foreign
from rosbags.highlevel import AnyReader
from text_messages import STRING, string

from ballbot_ros.errors import RecordingError
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.repair import Repair, repair
from ballbot_ros.recording.writer import RecordingWriter

CHUNKS = 10
MAGIC_SIZE = 8
PER_CHUNK = 28
HEADER_END = 40
"""Position after the first eight bytes and the header, which identify a recording of ROS 2."""


def chunk_places(content):
    """Return start and end of each chunk."""
    return [place[1:] for place in record_places(content) if place[0] == Opcode.CHUNK]


def record_places(content):
    """Return opcode, start and end of each record."""
    places = []
    position = MAGIC_SIZE
    while position < len(content) - MAGIC_SIZE:
        opcode, length = struct.unpack_from('<BQ', content, position)
        places.append((opcode, position, position + 9 + length))
        position = places[-1][2]
    return places


def place_of(content, opcode):
    """Return start and end of the first record with an opcode."""
    return next(place[1:] for place in record_places(content) if place[0] == opcode)


@pytest.fixture(scope='module')
def whole(record, sample, tmp_path_factory):
    path = tmp_path_factory.mktemp('whole') / 'sample.mcap'
    return record(path, sample, flush_every=PER_CHUNK)


@pytest.fixture(scope='module')
def content(whole):
    return whole.read_bytes()


@pytest.fixture(scope='module')
def places(content):
    places = chunk_places(content)
    assert len(places) == CHUNKS
    return places


@pytest.fixture(scope='module')
def repair_bytes(tmp_path_factory):
    """Return a function that repairs a file of the given bytes."""
    folder = tmp_path_factory.mktemp('damaged')

    def repair_bytes(content):
        path, output = folder / 'damaged.mcap', folder / 'damaged_repaired.mcap'
        path.write_bytes(content)
        output.unlink(missing_ok=True)
        return repair(path)

    return repair_bytes


def raw(path):
    with RecordingReader(path) as reader:
        assert reader.corruption is None
        messages = [tuple(message) for message in reader.raw_messages()]
        assert reader.count == len(messages)
        return messages


def expected(sample):
    return [
        (topic, stamp, number, data) for number, (topic, _, stamp, _, data) in enumerate(sample)
    ]


def assert_everyone_reads(path, count):
    with path.open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert summary.statistics.message_count == count
        assert len(list(reader.iter_decoded_messages())) == count
        channels = summary.channels.values()
        assert all(channel.metadata['offered_qos_profiles'] for channel in channels)
        assert len({channel.topic for channel in channels}) == len(channels)
        records = list(reader.iter_metadata())
        names = [record.name for record in records]
        assert names.count('rosbag2') == 1
        assert 'incomplete' in names
        text = records[names.index('rosbag2')].metadata['serialized_metadata']
        described = yaml.safe_load(text)['topics_with_message_count']
        assert {
            each['topic_metadata']['name']: each['topic_metadata']['offered_qos_profiles']
            for each in described
        } == {
            each.topic: yaml.safe_load(each.metadata['offered_qos_profiles']) for each in channels
        }
    if count:
        with AnyReader([path]) as reader:
            decoded = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages()]
        assert len(decoded) == count


def test_a_complete_file_is_left_alone(whole):
    before = sorted(whole.parent.iterdir())
    assert repair(whole) == Repair(None, 280, 'no repair needed, 280 messages intact')
    assert sorted(whole.parent.iterdir()) == before


def test_a_cut_off_file_keeps_the_chunks_before_the_cut(content, places, sample, repair_bytes):
    for begin, end in places:
        for cut in (begin - 1, begin, begin + 1, end - 1, end, end + 1):
            found = repair_bytes(content[:cut])
            kept = PER_CHUNK * sum(end <= cut for _, end in places)
            assert raw(found.output) == expected(sample)[:kept], cut
            assert found.message_count == kept, cut
            assert found.description.startswith(f'cut off at byte {cut}; '), cut
    assert_everyone_reads(found.output, kept)


@given(place=st.floats(0, 1, exclude_max=True))
def test_cut_anywhere(place, content, sample, repair_bytes):
    cut = 8 + int(place * (len(content) - 8))
    found = repair_bytes(content[:cut])
    messages = raw(found.output)
    assert messages == expected(sample)[: len(messages)]
    assert len(messages) % PER_CHUNK == 0


@given(place=st.floats(0, 1, exclude_max=True), bits=st.integers(1, 255))
@example(place=0.5, bits=1)
def test_any_changed_byte(place, bits, content, places, sample, repair_bytes):
    position = int(place * len(content))
    try:
        found = repair_bytes(flip(content, position, bits))
    except RecordingError:
        assert position < HEADER_END
        return
    if found.output is None:
        # The damage is in bytes that are never read, such as the length of a skipped record.
        assert found.message_count == len(sample)
        return
    messages = raw(found.output)
    assert messages == expected(sample)[: len(messages)]
    assert len(messages) >= PER_CHUNK * sum(end <= position for _, end in places)


@given(
    begin=st.floats(0, 1, exclude_max=True),
    size=st.integers(1, 20_000),
    fill=st.one_of(st.just(None), st.binary(min_size=1, max_size=50)),
)
def test_any_overwritten_or_missing_stretch(begin, size, fill, content, sample, repair_bytes):
    position = HEADER_END + int(begin * (len(content) - HEADER_END))
    end = min(position + size, len(content))
    middle = b'' if fill is None else (fill * (size // len(fill) + 1))[: end - position]
    found = repair_bytes(content[:position] + middle + content[end:])
    if found.output:
        rest = iter(expected(sample))
        assert all(any(message == other for other in rest) for message in raw(found.output))


def test_what_is_before_a_lost_chunk_is_kept_and_the_description_says_so(
    content, places, sample, repair_bytes
):
    found = repair_bytes(flip(content, places[4][1] - 10))
    messages = raw(found.output)
    assert messages == expected(sample)[: 4 * PER_CHUNK]
    assert re.fullmatch(
        r'corrupt before byte [0-9]+; 112 messages up to 1\.444 s kept',
        found.description,
    )
    with RecordingReader(found.output) as reader:
        assert reader.damage == f'repaired: {found.description}'
    assert_everyone_reads(found.output, len(messages))


def test_an_end_without_a_checksum_costs_no_message(content, sample, repair_bytes):
    for damaged in (content[:-1], flip(content, len(content) - 1)):
        found = repair_bytes(damaged)
        assert raw(found.output) == expected(sample)
        assert found.description.endswith('; 280 messages up to 2.116 s kept')
        with RecordingReader(found.output) as reader:
            assert reader.attachments()['scenario.yaml'].data == b'name: stationary\n'
            assert reader.metadata()['run'] == {'seed': '1'}


TEXTS = [f'{number:02d}' for number in range(40)]
QOS = {'offered_qos_profiles': '- history: 1\n', 'more': 'kept'}


def test_everything_is_kept_of_files_of_others(tmp_path):
    path = tmp_path / 'foreign.mcap'
    for options in FOREIGN:
        content = write_foreign(path, TEXTS, type_name='some_msgs/msg/Own', metadata=QOS, **options)
        assert repair(path) == Repair(None, 40, 'no repair needed, 40 messages intact'), options
        path.write_bytes(content[:-20])
        found = repair(path)
        with found.output.open('rb') as stream:
            reader = make_reader(stream, validate_crcs=True)
            rows = list(reader.iter_messages())
            (attachment,) = reader.iter_attachments()
            metadata = {record.name: record.metadata for record in reader.iter_metadata()}
        found.output.unlink()
        assert len(rows) == 40, options
        for number, (schema, channel, message) in enumerate(rows):
            assert (schema.name, schema.data) == ('some_msgs/msg/Own', b'string data')
            assert channel.metadata == QOS
            assert (message.log_time, message.publish_time) == (number, number + 7)
            assert (message.sequence, message.data) == (number, string(TEXTS[number]))
        assert attachment.data == b'notes'
        assert metadata['origin'] == {'robot': 'another'}
        described = yaml.safe_load(metadata['rosbag2']['serialized_metadata'])
        (topic,) = described['topics_with_message_count']
        assert topic['topic_metadata']['type'] == 'some_msgs/msg/Own'
        assert topic['message_count'] == 40


def test_a_topic_without_a_definition_is_kept(tmp_path):
    path, output = tmp_path / 'foreign.mcap', tmp_path / 'mended.mcap'
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start('ros2')
        channel = writer.register_channel('/json', 'json', 0)
        writer.add_message(channel, 5, b'{}', 6)
        writer.finish()
    path.write_bytes(path.read_bytes()[:-1])
    assert repair(path, output).output == output
    with RecordingReader(output) as reader:
        assert [tuple(each) for each in reader.raw_messages()] == [('/json', 5, 0, b'{}')]
        assert reader.topics() == {'/json': ('', 1)}
        assert reader.unreadable() == {'/json': "its encoding is 'json', not cdr"}


def test_progress_is_the_number_of_messages(tmp_path, content):
    path = tmp_path / 'cut.mcap'
    path.write_bytes(content[:20_000])
    calls = []
    kept = repair(path, progress=lambda *call: calls.append(call)).message_count
    assert calls == [(done, kept) for done in range(PER_CHUNK, kept + 1, PER_CHUNK)]


def test_a_recording_without_messages(tmp_path):
    path = tmp_path / 'empty.mcap'
    with RecordingWriter(path) as writer:
        writer.add_topic('/lcd', STRING)
    content = path.read_bytes()
    assert repair(path).output is None
    path.write_bytes(content[:60])
    found = repair(path)
    assert found.message_count == 0
    assert raw(found.output) == []


def test_mistakes_are_one_line(tmp_path, whole, content):
    other = tmp_path / 'other.txt'
    other.write_text('no recording')
    with pytest.raises(RecordingError, match='not an MCAP file'):
        repair(other)
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(content[:9000])
    shutil.copy(whole, tmp_path / 'cut_repaired.mcap')
    with pytest.raises(RecordingError, match=r'cut_repaired\.mcap: already exists'):
        repair(cut)
    assert (tmp_path / 'cut_repaired.mcap').read_bytes() == content
    with (
        RecordingWriter(tmp_path / 'new.mcap'),
        pytest.raises(RecordingError, match='still being recorded'),
    ):
        repair(tmp_path / 'new.mcap')


def test_an_output_that_is_removed_meanwhile_is_reported(tmp_path, content):
    cut, output = tmp_path / 'cut.mcap', tmp_path / 'mended.mcap'
    cut.write_bytes(content[:20_000])
    with pytest.raises(
        RecordingError, match=r'mended\.mcap: moved or removed while being written$'
    ):
        repair(cut, output, lambda *_: output.unlink(missing_ok=True))


def test_a_full_disk_leaves_no_file(tmp_path, content, monkeypatch):
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(content[:20_000])

    def fail(*_, **__):
        raise RecordingError('x: No space left on device')

    monkeypatch.setattr(RecordingWriter, 'write', fail)
    with pytest.raises(RecordingError, match='No space left'):
        repair(cut)
    assert [path.name for path in tmp_path.iterdir()] == ['cut.mcap']
