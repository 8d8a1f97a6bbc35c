"""Files that would need far more memory than they have bytes."""

import tracemalloc
import weakref
from dataclasses import replace

import pytest
from mcap.records import Attachment, Channel, Header, Message, Metadata, Schema

from ballbot_ros.recording import mcap_records, reader
from ballbot_ros.recording.mcap_records import (
    ALLOWANCE,
    ENTRY,
    MAX_CHUNK,
    MAX_DESCRIPTIONS,
    MAX_RATIO,
    MESSAGE,
    LimitedReader,
)
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.repair import repair
from campaign.hostile_files import Content, chunk_of

STRING = Schema(id=1, name='std_msgs/msg/String', encoding='ros2msg', data=b'string data')
LCD = Channel(id=1, topic='/lcd', message_encoding='cdr', metadata={}, schema_id=1)


def message(number, size=8):
    return Message(1, number, b'\0\1\0\0' + bytes(size), number, number)


def content(**parts):
    messages = [message(number) for number in range(5)]
    return Content(Header('ros2', ''), [STRING], [LCD], messages, **parts)


def count(path):
    with RecordingReader(path) as opened:
        return sum(1 for _ in opened.raw_messages()), opened.damage


@pytest.fixture
def path(tmp_path):
    return tmp_path / 'run.mcap'


@pytest.mark.parametrize('compression', ['', 'zstd', 'lz4'])
def test_a_chunk_is_refused_that_is_too_large_or_larger_than_it_declares(
    path, compression, monkeypatch
):
    largest = 2**20
    monkeypatch.setattr(mcap_records, 'MAX_CHUNK', largest)
    large = chunk_of([message(9, largest)], compression)
    lied = chunk_of([message(9, 1000)], compression, declared=100)
    for chunk, told in ((large, f'more than {largest})'), (lied, 'larger than it declares)')):
        parts = content(chunks=[chunk, chunk_of([message(10)])])
        path.write_bytes(parts.encode())
        found, damage = count(path)
        assert found == 5
        assert damage.startswith('corrupt before byte ')
        assert damage.endswith(told)
        repaired = path.with_name('repaired.mcap')
        done = repair(path, repaired)
        assert done.message_count == 5
        assert told in done.description
        assert count(repaired)[0] == 5
        repaired.unlink()


def test_a_chunk_as_large_as_allowed_is_read(path):
    largest = chunk_of([message(9, MAX_CHUNK - 9 - 22 - 4)])
    path.write_bytes(content(chunks=[largest]).encode())
    assert count(path) == (6, None)


def test_many_chunks_are_refused_that_are_much_larger_than_the_file(path):
    chunk = chunk_of([message(9, 2**24)])
    path.write_bytes(content(chunks=[chunk] * 10).encode())
    found, damage = count(path)
    allowed = (ALLOWANCE + MAX_RATIO * path.stat().st_size) // 2**24
    assert 5 < found <= 5 + allowed
    assert f'more than {MAX_RATIO} times the bytes of the file' in damage


def test_messages_are_limited_in_number(path, monkeypatch):
    """Each is small, but commands keep columns of them."""
    allowance = 2**21
    monkeypatch.setattr(mcap_records, 'ALLOWANCE', allowance)
    chunk = chunk_of([message(number) for number in range(1000)], 'zstd')
    path.write_bytes(content(chunks=[chunk] * 10).encode())
    limit = 5 + (allowance + MAX_RATIO * path.stat().st_size) // MESSAGE
    found, damage = count(path)
    assert 5 < found <= limit
    assert f'more than {MAX_RATIO} times the bytes of the file' in damage
    with RecordingReader(path) as opened:
        assert opened.count <= limit
    assert 5 < repair(path, path.with_name('repaired.mcap')).message_count <= limit


def test_one_chunk_at_a_time_is_in_memory(path, monkeypatch):
    path.write_bytes(content(chunks=[chunk_of([message(number)]) for number in range(5)]).encode())
    seen, kept = [], []

    class Noting(LimitedReader):
        def unpack(self, chunk):
            kept.append(sum(batch() is not None for batch in seen))
            return super().unpack(chunk)

    with RecordingReader(path) as opened:
        monkeypatch.setattr(reader, 'LimitedReader', Noting)
        seen.extend(map(weakref.ref, opened.batches()))
    assert kept == [0] * 6


def test_descriptions_are_limited_one_by_one_and_together(path, monkeypatch):
    long = content(metadata=[Metadata('long', {'a': 'x' * mcap_records.MAX_DESCRIPTION})])
    path.write_bytes(long.encode())
    assert 'a description of ' in count(path)[1]
    monkeypatch.setattr(mcap_records, 'MAX_DESCRIPTIONS', 100_000)
    schemas = [Schema(n, b'x' * 1000, 'ros2msg', f'a/T{n}') for n in range(2, 200)]
    path.write_bytes(content(chunks=[chunk_of(schemas)]).encode())
    assert 'schema records of more than 100000 bytes' in count(path)[1]


def test_records_are_limited_in_number(path):
    chunks = [chunk_of([])] * 10_000
    path.write_bytes(content(chunks=chunks).encode())
    assert f'more than {MAX_RATIO} times the bytes of the file' in count(path)[1]


def test_attachments_are_limited_in_number(path):
    files = [Attachment(0, 0, str(number), '', b'') for number in range(5000)]
    path.write_bytes(content(attachments=files).encode())
    with RecordingReader(path) as opened:
        assert 'attachment records of more than' in opened.damage
        assert len(opened.attachments()) == MAX_DESCRIPTIONS // ENTRY
    done = repair(path, path.with_name('repaired.mcap'))
    assert done.message_count == 0  # those behind it are not read


def test_a_bomb_takes_little_memory(path):
    """A quarter of a gigabyte: one chunk, one with another size in its data, and small ones."""
    small = chunk_of([message(9, 2**20)])
    for compression in ('zstd', 'lz4'):
        bomb = chunk_of([message(9, 2**28)], compression)
        lied = replace(bomb, uncompressed_size=2**20)
        for chunks in ([bomb], [lied], [small] * 256):
            path.write_bytes(content(chunks=chunks).encode())
            tracemalloc.start()
            count(path)
            peak = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            assert peak < 2**23, (compression, len(chunks))
