"""Repair: intact messages are recovered byte for byte, losses are listed, no number is wrong."""

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
from recorded_bytes import (
    FOREIGN,
    UNCHUNKED,
    UNCOMPRESSED,
    WITHOUT_CHECKSUMS,
    flip,
    write_foreign,
)
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


def assert_subset(found, sample):
    rest = iter(expected(sample))
    assert all(any(message == other for other in rest) for message in found)


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
            assert found.description.startswith(f'cut off at byte {cut}: '), cut
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


def test_a_lost_chunk_costs_its_messages_and_nothing_else(content, places, sample, repair_bytes):
    found = repair_bytes(flip(content, places[4][1] - 10))
    messages = raw(found.output)
    assert messages == expected(sample)[: 4 * PER_CHUNK] + expected(sample)[5 * PER_CHUNK :]
    with RecordingReader(found.output) as reader:
        assert reader.damage == f'repaired: {found.description}'
        assert reader.attachments()['scenario.yaml'].data == b'name: stationary\n'
        assert reader.metadata()['run'] == {'seed': '1'}
    assert_everyone_reads(found.output, len(messages))


def test_a_chunk_with_a_broken_header_costs_no_other(content, places, sample, repair_bytes):
    begin = places[3][0]
    chunk = expected(sample)[3 * PER_CHUNK : 4 * PER_CHUNK]
    others = [message for message in expected(sample) if message not in chunk]
    opcodes = [(begin, Opcode.CHUNK ^ opcode) for opcode in (*Opcode, 0x40) if opcode != 6]
    lengths = [(begin + at, bits) for at in (1, 3, 9 + 32 + 4, 9 + 32 + 4 + 3) for bits in (1, 64)]
    for position, bits in opcodes + lengths:
        found = repair_bytes(flip(content, position, bits))
        is_lost = found.description.startswith(f'corrupt from byte {begin} to {places[4][0]}: ')
        kept = others if is_lost else expected(sample)
        assert raw(found.output) == kept, (position - begin, bits)


def test_the_description_says_what_is_damaged_kept_and_lost(content, places, repair_bytes):
    begins, ends = zip(*places, strict=True)
    size, summary_at = len(content), place_of(content, Opcode.DATA_END)[1]
    data_end_at = place_of(content, Opcode.DATA_END)[0]
    attachment_at, attachment_end = place_of(content, Opcode.ATTACHMENT)
    one, first = flip(content, ends[4] - 10), flip(content, ends[0] - 10)
    rows = {
        'a chunk': (
            one,
            (begins[4], begins[5]),
            '112 messages up to 1.444 s and 140 from 1.560 s on kept; 28 lost',
        ),
        'a chunk, and the last byte': (
            flip(one, size - 1),
            (begins[4], begins[5]),
            '112 messages up to 1.444 s and 140 from 1.560 s on kept; 28 lost',
        ),
        'the first chunk': (
            first,
            (begins[0], begins[1]),
            '0 messages and 252 from 1.112 s on kept; 28 lost',
        ),
        'two chunks': (
            flip(one, ends[7] - 10),
            (begins[4], begins[5], begins[7], begins[8]),
            '112 messages up to 1.444 s and 112 from 1.560 s on kept; 56 lost',
        ),
        'a chunk and the end': (
            one[: begins[9] + 50],
            (begins[4], begins[5], begins[9]),
            '112 messages up to 1.444 s and 112 from 1.560 s on kept',
        ),
        'the first chunk and the summary': (
            first[: summary_at + 5],
            (begins[0], begins[1], summary_at),
            '0 messages kept; 252 left out, because their topic is lost',
        ),
        'the summary': (
            content[:summary_at],
            (summary_at,),
            '280 messages up to 2.116 s kept',
        ),
        'a byte of the summary': (
            flip(content, summary_at + 30),
            (summary_at, size),
            '280 messages up to 2.116 s kept',
        ),
        'an inserted byte': (
            content[: begins[3]] + b'\xff' + content[begins[3] :],
            (begins[3], begins[3] + 1, summary_at + 1, size + 1),
            '84 messages up to 1.332 s and 196 from 1.336 s on kept',
        ),
        'an index': (
            flip(content, ends[6] + 1, 0x40),
            (ends[6], begins[7]),
            '196 messages up to 1.780 s and 84 from 1.784 s on kept; none lost',
        ),
        'an attachment': (
            content.replace(b'name: stationary', b'name: stationarz'),
            (attachment_at, attachment_end),
            '280 messages up to 2.116 s kept; none lost',
        ),
        'the end of the data': (
            flip(content, data_end_at),
            (data_end_at, summary_at),
            '280 messages up to 2.116 s kept; none lost',
        ),
        'another recording': (
            content * 2,
            (summary_at, 2 * size),
            '280 messages up to 2.116 s kept',
        ),
        'a chunk, and another recording': (
            flip(content, ends[9] - 10) + content,
            (begins[9], attachment_at, summary_at, 2 * size),
            '252 messages up to 2.004 s kept',
        ),
        'the end, and another recording': (
            content[: begins[9] + 50] + content,
            (begins[9], begins[9] + 50 + size),
            '252 messages up to 2.004 s kept',
        ),
    }
    for name, (damaged, (begin, *ends), kept) in rows.items():
        is_cut = len(ends) % 2 == 0
        bounds = [begin, *ends, *[len(damaged)] * is_cut]
        left_out = sum(bounds[1::2]) - sum(bounds[::2])
        which = ' (the first of 2 places)' if len(ends) == 3 else ''
        parts = [f'corrupt from byte {begin} to {ends[0]}{which}'] if ends else []
        parts += [f'cut off at byte {len(damaged)}'] if is_cut else []
        description = f'{", ".join(parts)}: {left_out} bytes left out; {kept}'
        assert repair_bytes(damaged).description == description, name


def test_damage_in_a_part_without_a_checksum_is_described(content, repair_bytes):
    summary_at, size = place_of(content, Opcode.DATA_END)[1], len(content)
    for damaged, place in (
        (content.replace(b'seed', b'sead'), f'corrupt before byte {summary_at}'),
        (flip(content, size - 1), f'cut off at byte {size}'),
    ):
        assert repair_bytes(damaged).description == (
            f'{place}, in a part without a checksum; 280 messages up to 2.116 s kept; none lost'
        )


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
        assert (attachment.create_time, attachment.log_time, attachment.data) == (3, 4, b'notes')
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


def test_progress_is_the_position_in_two_passes(tmp_path, content):
    path = tmp_path / 'cut.mcap'
    path.write_bytes(content[:20_000])
    calls = []
    repair(path, progress=lambda *call: calls.append(call))
    assert {total for _, total in calls} == {40_000}
    places = [done for done, _ in calls]
    half = len(places) // 2
    assert places[half:] == [20_000 + place for place in places[:half]]
    assert places == sorted(places)
    assert places[-1] == 40_000


def numbers(content, repair_bytes):
    """Repair a file of another recorder; return the sequence numbers of the kept messages."""
    found = repair_bytes(content)
    if found.output is None:
        return list(range(found.message_count))
    messages = raw(found.output)
    assert all(data == string(TEXTS[number]) for _, _, number, data in messages)
    assert all(stamp == number for _, stamp, number, _ in messages)
    return [message[2] for message in messages]


def test_a_changed_message_in_an_uncompressed_chunk_is_not_recovered(tmp_path, repair_bytes):
    content = write_foreign(tmp_path / 'foreign.mcap', TEXTS, **UNCOMPRESSED)
    begin, end = chunk_places(content)[1]
    (lost,) = {
        tuple(sorted({*range(40)} - {*numbers(flip(content, position, 0x55), repair_bytes)}))
        for position in range(begin + 9 + 40, end)
    }
    assert lost == (1, 2, 3)


def test_behind_the_damage_only_what_a_checksum_proves_is_kept(tmp_path, repair_bytes):
    path = tmp_path / 'foreign.mcap'
    proven = write_foreign(path, TEXTS, **UNCOMPRESSED)
    unproven = write_foreign(path, TEXTS, **WITHOUT_CHECKSUMS)
    loose = write_foreign(path, TEXTS, **UNCHUNKED)
    third, fourth = [place for place in record_places(loose) if place[0] == Opcode.MESSAGE][2][1:]
    found = {
        'chunks with checksums': numbers(flip(proven, chunk_places(proven)[1][0]), repair_bytes),
        'chunks without': numbers(flip(unproven, chunk_places(unproven)[1][0]), repair_bytes),
        'no chunks': numbers(flip(loose, third), repair_bytes),
        'a wrong length': numbers(flip(loose, third + 1), repair_bytes),
        'cut off behind a message': numbers(loose[:fourth], repair_bytes),
    }
    assert found == {
        'chunks with checksums': [0, *range(4, 40)],
        'chunks without': [0],
        'no chunks': [0, 1],
        'a wrong length': [0, 1],
        'cut off behind a message': [0, 1, 2],
    }


def attachments_and_metadata(content, repair_bytes):
    with RecordingReader(repair_bytes(content).output) as reader:
        own = reader.metadata().keys() - {'rosbag2', 'incomplete'}
        return sorted(reader.attachments()), sorted(own)


def test_behind_the_damage_an_attachment_needs_a_checksum_and_metadata_none(tmp_path, repair_bytes):
    content = write_foreign(tmp_path / 'foreign.mcap', TEXTS, **UNCOMPRESSED)
    begin, _ = chunk_places(content)[-1]
    _, crc_end = place_of(content, Opcode.ATTACHMENT)
    damaged = flip(content, begin)
    without = damaged[: crc_end - 4] + bytes(4) + damaged[crc_end:]
    assert attachments_and_metadata(damaged, repair_bytes) == (['notes.txt'], ['origin'])
    assert attachments_and_metadata(without, repair_bytes) == ([], ['origin'])
    # Before the damage, an attachment may have no checksum.
    only_attached = content[: crc_end - 4] + bytes(4) + content[crc_end:-1]
    assert attachments_and_metadata(only_attached, repair_bytes) == (['notes.txt'], ['origin'])


def test_bytes_of_a_damaged_chunk_are_not_taken_for_metadata(tmp_path, repair_bytes):
    metadata = struct.pack('<BQII', Opcode.METADATA, 8, 0, 0)
    content = write_foreign(tmp_path / 'foreign.mcap', [metadata * 9], **UNCOMPRESSED)
    (place,) = chunk_places(content)
    assert attachments_and_metadata(flip(content, place[0]), repair_bytes) == (
        ['notes.txt'],
        ['origin'],
    )


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
