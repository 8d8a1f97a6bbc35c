"""Repair: intact messages are recovered byte for byte, losses are listed, no number is wrong."""

import shutil

import pytest
from hypothesis import example
from hypothesis import strategies as st
from laws import given
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from text_messages import STRING, string

from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.repair import repair
from ballbot_ros.recording.writer import RecordingWriter

CHUNKS = 10
PER_CHUNK = 28
HEADER_END = 40
"""Position after the first eight bytes and the header, which identify a recording of ROS 2."""


def chunk_places(content):
    """Return start and end of each chunk."""
    places = []
    position = 8
    while position < len(content) - 8:
        length = int.from_bytes(content[position + 1 : position + 9], 'little')
        if content[position] == 6:
            places.append((position, position + 9 + length))
        position += 9 + length
    return places


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


def assert_subset(found, sample):
    rest = iter(expected(sample))
    assert all(any(message == other for other in rest) for message in found)


def assert_everyone_reads(path, count):
    with path.open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert summary.statistics.message_count == count
        assert len(list(reader.iter_decoded_messages())) == count
        assert all(c.metadata['offered_qos_profiles'] for c in summary.channels.values())
        names = [record.name for record in reader.iter_metadata()]
        assert names.count('rosbag2') == 1
        assert 'incomplete' in names
    if count:
        with AnyReader([path]) as reader:
            decoded = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages()]
        assert len(decoded) == count


def flip(content, position, bits=1):
    return content[:position] + bytes([content[position] ^ bits]) + content[position + 1 :]


def test_a_complete_file_is_left_alone(whole, sample):
    before = sorted(whole.parent.iterdir())
    found = repair(whole)
    assert (found.output, found.message_count, found.nothing_lost) == (None, len(sample), True)
    assert sorted(whole.parent.iterdir()) == before


@pytest.mark.parametrize('chunk', range(CHUNKS))
@pytest.mark.parametrize('where', ['begin', 'end'])
@pytest.mark.parametrize('offset', [-1, 0, 1])
def test_cut_at_every_chunk_boundary(chunk, where, offset, content, places, sample, repair_bytes):
    cut = places[chunk][where == 'end'] + offset
    found = repair_bytes(content[:cut])
    messages = raw(found.output)
    whole_chunks = sum(end <= cut for _, end in places)
    assert messages == expected(sample)[: whole_chunks * PER_CHUNK]
    assert found.message_count == len(messages)
    assert found.damage == [f'cut off at byte {cut}']
    if offset == 0:
        assert_everyone_reads(found.output, len(messages))


@given(place=st.floats(0, 1, exclude_max=True))
def test_cut_anywhere(place, content, sample, repair_bytes):
    cut = 8 + int(place * (len(content) - 8))
    found = repair_bytes(content[:cut])
    messages = raw(found.output)
    assert messages == expected(sample)[: len(messages)]
    assert len(messages) % PER_CHUNK == 0
    assert not found.nothing_lost or len(messages) == len(sample)


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
    hit = any(begin <= position < end for begin, end in places)
    assert len(messages) >= len(sample) - PER_CHUNK * hit
    assert_subset(messages, sample)


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
        assert_subset(raw(found.output), sample)


def test_a_lost_chunk_is_counted(content, places, sample, repair_bytes):
    found = repair_bytes(flip(content, places[4][1] - 10))
    messages = raw(found.output)
    lost = expected(sample)[4 * PER_CHUNK : 5 * PER_CHUNK]
    assert messages == [m for m in expected(sample) if m not in lost]
    assert {topic: (each.count, each.counted) for topic, each in found.lost.items()} == {
        topic: (2, True) for topic, *_ in lost
    }
    (span,) = found.spans
    assert (span.start_ns, span.end_ns) == (sample[111][2], sample[140][2])
    with RecordingReader(found.output) as reader:
        assert reader.damage == f'repaired: {found.reason}'
        assert reader.attachments()['scenario.yaml'].data == b'name: stationary\n'
        assert reader.metadata()['run'] == {'seed': '1'}
    assert_everyone_reads(found.output, len(messages))


@pytest.mark.parametrize(
    ('what', 'offset'), [('opcode', 0), ('length', 3), ('records length', 9 + 32 + 4 + 3)]
)
def test_a_chunk_with_a_broken_header_is_recovered_completely(
    what, offset, content, places, sample, repair_bytes
):
    found = repair_bytes(flip(content, places[3][0] + offset, 0x40))
    assert raw(found.output) == expected(sample)
    assert found.nothing_lost


def test_the_topics_of_a_lost_first_chunk_are_in_the_summary(content, places, sample, repair_bytes):
    found = repair_bytes(flip(content, places[0][1] - 10))
    assert raw(found.output) == expected(sample)[PER_CHUNK:]


def test_the_loss_after_a_cut_is_estimated(tmp_path):
    path = tmp_path / 'run.mcap'
    with RecordingWriter(path) as writer:
        topic = writer.add_topic('/lcd', STRING)
        for number in range(300):
            writer.write(topic, number * 10**7, string(str(number**5)), number + 1)
            if number % 100 == 99:
                writer.flush()
    content = path.read_bytes()
    path.write_bytes(content[: chunk_places(content)[2][1] - 5])
    found = repair(path)
    assert str(found.lost['/lcd']) == 'about 100 or more'
    assert str(found.spans[0]) == 'from 1.990 s to 2.990 s or later'
    # If the middle chunk is lost, too, the publisher's sequence numbers give the exact number.
    path.write_bytes(
        flip(content[: chunk_places(content)[2][1] + 1], chunk_places(content)[1][0] + 80)
    )
    again = repair(path, tmp_path / 'again.mcap')
    assert str(again.lost['/lcd']) == 'about 100 or more'
    assert str(again.spans[0]) == 'from 0.990 s to 2.000 s'


def test_a_second_recording_in_the_file_is_named(content, sample, repair_bytes):
    found = repair_bytes(content * 2)
    assert raw(found.output) == expected(sample)
    assert f'another recording begins at byte {len(content)}: left out' in found.reason
    assert not found.nothing_lost


def test_a_lost_attachment_is_named(content, repair_bytes):
    found = repair_bytes(content.replace(b'name: stationary', b'name: stationarz'))
    assert 'attachment scenario.yaml lost' in found.reason
    assert found.nothing_lost


def write_foreign(path, **options):
    with path.open('wb') as stream:
        writer = Writer(stream, **options)
        writer.start('ros2', 'another recorder')
        schema = writer.register_schema('some_msgs/msg/Own', 'ros2msg', b'string data')
        qos = {'offered_qos_profiles': '- history: 1\n', 'more': 'kept'}
        channel = writer.register_channel('/own', 'cdr', schema, qos)
        for number in range(40):
            data = b'\0\1\0\0\3\0\0\0%02d\0' % number
            writer.add_message(channel, number, data, number + 7, number)
        writer.add_attachment(3, 4, 'notes.txt', 'text/plain', b'notes')
        writer.finish()
    return path


@pytest.mark.parametrize(
    'options',
    [
        {'use_chunking': False},
        {'compression': CompressionType.LZ4, 'chunk_size': 100},
        {'compression': CompressionType.NONE, 'chunk_size': 100},
        {'chunk_size': 100, 'repeat_channels': False, 'repeat_schemas': False},
    ],
)
def test_everything_is_kept_of_files_of_others(tmp_path, options):
    path = write_foreign(tmp_path / 'foreign.mcap', **options)
    path.write_bytes(path.read_bytes()[:-20])
    found = repair(path)
    with found.output.open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        rows = list(reader.iter_messages())
        (attachment,) = reader.iter_attachments()
    assert len(rows) == 40
    for number, (schema, channel, message) in enumerate(rows):
        assert (schema.name, schema.data) == ('some_msgs/msg/Own', b'string data')
        assert channel.metadata == {'offered_qos_profiles': '- history: 1\n', 'more': 'kept'}
        assert (message.log_time, message.publish_time) == (number, number + 7)
        assert (message.sequence, message.data[8:10]) == (number, b'%02d' % number)
    assert (attachment.create_time, attachment.log_time, attachment.data) == (3, 4, b'notes')


def test_a_changed_message_in_an_uncompressed_chunk_is_not_recovered(tmp_path):
    path = write_foreign(
        tmp_path / 'foreign.mcap', compression=CompressionType.NONE, chunk_size=300
    )
    content = path.read_bytes()
    for position in range(chunk_places(content)[1][0], chunk_places(content)[1][1]):
        path.write_bytes(flip(content, position, 0x55))
        output = tmp_path / f'{position}.mcap'
        if repair(path, output).output:
            with RecordingReader(output) as reader:
                for message in reader.raw_messages():
                    assert message.data[8:10] == b'%02d' % message.sequence
                    assert message.stamp_ns == message.sequence


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


def test_a_full_disk_leaves_no_file(tmp_path, content, monkeypatch):
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(content[:20_000])

    def fail(*_, **__):
        raise RecordingError('x: No space left on device')

    monkeypatch.setattr(RecordingWriter, 'write', fail)
    with pytest.raises(RecordingError, match='No space left'):
        repair(cut)
    assert [path.name for path in tmp_path.iterdir()] == ['cut.mcap']
