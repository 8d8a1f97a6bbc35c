"""Recordings with valid checksums and hostile content: what a file from anyone may have."""

from __future__ import annotations

import random
import struct
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    Metadata,
    Schema,
    Statistics,
)
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

COMPRESS: dict[str, Callable[[bytes], bytes]] = {
    '': bytes,
    'zstd': zstandard.compress,
    'lz4': lz4.frame.compress,
}

NUMBERS = (0, 1, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**62, 2**63 - 1, 2**63, 2**64 - 1)

TEXTS = (
    '', ' ', '\0', 'a\0b', '/', '//', '.', '..', '../../up', '/etc/passwd', 'a/../b', '~', '\n',
    'two\nlines', '\x1b[31mred\x1b[0m', '\u202e', '\ufeff', '🤖', '%s', '{}', '[bold]', '<b>&amp;',
    '-', '--help', 'x' * 300, 'y' * 70_000, 'nan', 'None', "'", '"', '\\', 'C:\\x', '*', '$HOME',
)  # fmt: skip

VALUES = (
    'nan', '.nan', '.inf', '-.inf', '-1', '0', '1e308', '1e-320', '9' * 30, '9' * 5000, '', '[',
    '{}', '[]', '[1, 2]', 'true', 'null', '~', '"', '🤖', '&a [*a]', '!!python/name:os.system',
    '!!python/object/apply:os.system [exit]', '!!set {a}', '!!binary "AAAA"', '2026-01-01',
    '../nowhere/file', '/dev/zero', '/etc/hostname', 'map.png', 'track', 'this:aaaaaaa',
    'lqg', 'c', '"a\\0b"', '[' * 3000, '{a: ' * 3000, '1' * 70_000, '[a: b, c: d]', '? [a]: b',
)  # fmt: skip

DEFINITIONS = (
    '', '\0', 'x', 'float64', 'float64 x', 'float64[] x', 'float64[4294967295] x',
    'float64[<=4294967295] x', 'float64[0] x', 'string<=4294967295 x', 'string x', 'wstring x',
    'char x', 'byte[] x', 'float64 class', 'float64 __init__', 'float64 x\nfloat64 x',
    'int8 A=999999999999999999999', 'int32 A=x', 'float64 x 1e999', 'string A="' + 'x' * 5000 + '"',
    'nowhere/Type x', 'builtin_interfaces/Time stamp', 'std_msgs/Header header\nfloat64 x',
    'float64 a-b', 'float64 ' + 'x' * 5000, '# ' + 'x' * 5000, 'a/b/c/d x', 'float64 x' * 2000,
    '\n'.join(f'float64 x{number}' for number in range(2000)),
    '\n'.join(f'float64[100] x{number}' for number in range(200)),
)  # fmt: skip


@dataclass
class Content:
    """The content of a recording; only its form is always valid."""

    header: Header
    schemas: list[Schema] = field(default_factory=list)
    channels: list[Channel] = field(default_factory=list)
    messages: list[Message] = field(default_factory=list)
    attachments: list[Attachment] = field(default_factory=list)
    metadata: list[Metadata] = field(default_factory=list)
    statistics: Statistics | None = None
    chunks: list[Chunk] = field(default_factory=list)
    compression: str = 'zstd'
    messages_per_chunk: int = 100

    @classmethod
    def of_file(cls, path: Path) -> Content:
        """Read a whole recording."""
        content = cls(Header('ros2', ''))
        with path.open('rb') as stream:
            for record in StreamReader(stream).records:
                match record:
                    case Header():
                        content.header = record
                    case Schema() if record not in content.schemas:
                        content.schemas.append(record)
                    case Channel() if record not in content.channels:
                        content.channels.append(record)
                    case Message():
                        content.messages.append(record)
                    case Attachment():
                        content.attachments.append(record)
                    case Metadata():
                        content.metadata.append(record)
                    case Statistics():
                        content.statistics = record
        return content

    def copy(self) -> Content:
        """Return a copy whose lists can be changed; records are replaced, never changed."""
        lists = ('schemas', 'channels', 'messages', 'attachments', 'metadata', 'chunks')
        return replace(self, **{name: list(getattr(self, name)) for name in lists})

    def encode(self) -> bytes:
        """Return the bytes of the file, with valid checksums."""
        definitions = [*self.schemas, *self.channels]
        records: list[McapRecord] = [self.header, *self.attachments]
        for first in range(0, len(self.messages) or 1, self.messages_per_chunk):
            part = self.messages[first : first + self.messages_per_chunk]
            records.append(
                chunk_of([*(definitions if first == 0 else ()), *part], self.compression)
            )
        records += [*self.chunks, *self.metadata]
        data = MCAP0_MAGIC + encoded([*records])
        summary = encoded([*definitions, *([self.statistics] if self.statistics else [])])
        end = encoded([DataEnd(zlib.crc32(data))])
        start = len(data) + len(end) if summary else 0
        footer = encoded([Footer(start, 0, 0)])[:-4]
        crc = struct.pack('<I', zlib.crc32(summary + footer))
        return data + end + summary + footer + crc + MCAP0_MAGIC


def encoded(records: Sequence[McapRecord]) -> bytes:
    """Return the bytes of records."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())


def chunk_of(
    records: Sequence[McapRecord], compression: str = 'zstd', declared: int | None = None
) -> Chunk:
    """Return a chunk that declares the size of its content, or another one."""
    data = encoded(records)
    times = [record.log_time for record in records if isinstance(record, Message)]
    return Chunk(
        compression=compression,
        data=COMPRESS[compression](data),
        message_start_time=min(times, default=0),
        message_end_time=max(times, default=0),
        uncompressed_crc=zlib.crc32(data),
        uncompressed_size=len(data) if declared is None else declared,
    )


class Mutator:
    """Makes the content of a recording hostile, by random choices."""

    def __init__(self, generator: random.Random, content: Content) -> None:
        self.draw, self.content = generator, content

    def mutate(self) -> list[str]:
        """Apply one to four changes; return their names."""
        kinds = [name for name in dir(self) if name.startswith('change_')]
        chosen = self.draw.choices(kinds, k=self.draw.choice((1, 1, 1, 2, 4)))
        for name in chosen:
            getattr(self, name)()
        return [name.removeprefix('change_') for name in chosen]

    def _replace(self, records: list, **changes: Callable[[object], object]) -> None:
        """Change fields of a random record."""
        if records:
            number = self.draw.randrange(len(records))
            record = records[number]
            values = {name: change(getattr(record, name)) for name, change in changes.items()}
            records[number] = replace(record, **values)

    def _text(self, text: object) -> str:
        other = self.draw.choice(TEXTS)
        return self.draw.choice((other, f'{text}{other}', f'{other}{text}'))

    def _number(self, number: object = 0) -> int:
        return self.draw.choice(NUMBERS)

    def _bytes(self, data: bytes) -> bytes:
        """Cut, extend, or overwrite parts of some bytes."""
        damaged = bytearray(data)
        match self.draw.randrange(5):
            case 0:
                return b''
            case 1:
                return data[: self.draw.randrange(len(data) + 1)]
            case 2:
                return data + self.draw.randbytes(self.draw.choice((1, 7, 100_000)))
            case 3:
                at = self.draw.randrange(len(data) + 1)
                number = self.draw.choice(NUMBERS)
                damaged[at : at + 4] = struct.pack('<I', number % 2**32)
            case _:
                at = self.draw.randrange(len(data) + 1)
                value = self.draw.choice((float('nan'), float('inf'), 1e308, -1e308, 5e-324))
                damaged[at : at + 8] = struct.pack('<d', value)
        return bytes(damaged)

    def change_definition(self) -> None:
        """Give a type another definition."""
        text = self.draw.choice(DEFINITIONS).encode()
        self._replace(
            self.content.schemas,
            data=lambda data: self.draw.choice((text, data + b'\n' + text, self._bytes(data))),
        )

    def change_recursion(self) -> None:
        """Let a type contain itself, directly, in a list, or by another type."""
        number = self.draw.randrange(len(self.content.schemas))
        schema = self.content.schemas[number]
        short = schema.name.replace('/msg/', '/')
        rule = '\n' + '=' * 80 + '\n'
        text = self.draw.choice(
            (
                f'{short} x',
                f'{short}[] x',
                f'{short}[3] x',
                f'a/B x{rule}MSG: a/B\n{short} y',
                f'a/B x{rule}MSG: a/B\na/C[] y{rule}MSG: a/C\na/B[2] z',
                ''.join(
                    f'a/T{n} x\na/T{n} y{rule}MSG: a/T{n - 1 if n else ""}\n' for n in range(30)
                ),
                f'a/T0 x{rule}'
                + rule.join(f'MSG: a/T{n}\na/T{n + 1} x\na/T{n + 1} y' for n in range(40))
                + f'{rule}MSG: a/T40\nfloat64 x',
                f'a/T0 x{rule}'
                + rule.join(f'MSG: a/T{n}\na/T{n + 1} x' for n in range(1500))
                + f'{rule}MSG: a/T1500\nfloat64 x',
            )
        )
        self.content.schemas[number] = replace(schema, data=text.encode())

    def change_schema(self) -> None:
        """Change the name or the encoding of a type, or its number."""
        encodings = ('', 'ros2idl', 'ros1msg', 'jsonschema', '\0')
        change = self.draw.choice(
            (
                {'name': self._text},
                {'encoding': lambda _: self.draw.choice(encodings)},
                {'id': lambda _: self.draw.choice((0, 1, 2, 65535))},
            )
        )
        self._replace(self.content.schemas, **change)

    def change_topic(self) -> None:
        """Change the name of a topic."""
        others = [channel.topic for channel in self.content.channels]
        self._replace(
            self.content.channels,
            topic=lambda topic: self.draw.choice((self._text(topic), self.draw.choice(others))),
        )

    def change_channel(self) -> None:
        """Change a channel's number, type, encoding or quality of service."""
        qos = self.draw.choice((*TEXTS, *VALUES, '- history: [', '- {depth: 9e99}', '[' * 3000))
        change = self.draw.choice(
            (
                {'message_encoding': self._text},
                {'schema_id': lambda _: self.draw.choice((0, 1, 2, 3, 65535))},
                {'id': lambda _: self.draw.choice((0, 1, 2, 65535))},
                {'metadata': lambda _: {'offered_qos_profiles': qos}},
                {'metadata': lambda _: {self._text(n): self._text('') for n in range(300)}},
            )
        )
        self._replace(self.content.channels, **change)

    def change_data(self) -> None:
        """Damage the bytes of many messages."""
        for _ in range(self.draw.choice((1, 5, 200))):
            self._replace(self.content.messages, data=self._bytes)

    def change_topic_data(self) -> None:
        """Damage the bytes of all messages of a topic alike."""
        number = self.draw.choice(self.content.channels).id
        damage = self.draw.choice((
            lambda data: b'', lambda data: data[:5], lambda data: data[:-1],
            lambda data: data[:4] + b'\xff' * (len(data) - 4),
            lambda data: data[:4] + bytes(len(data) - 4),
            lambda data: b'\0\0' + data[2:], lambda data: data[:4] + data[4:][::-1],
        ))  # fmt: skip
        self.content.messages = [
            replace(each, data=damage(each.data)) if each.channel_id == number else each
            for each in self.content.messages
        ]

    def change_stamps(self) -> None:
        """Overwrite the stamps in messages."""
        stamp = struct.pack('<II', *(self._number() % 2**32 for _ in range(2)))
        share = self.draw.choice((0.002, 0.1, 1.0))
        self.content.messages = [
            replace(each, data=each.data[:4] + stamp + each.data[12:])
            if self.draw.random() < share else each
            for each in self.content.messages
        ]  # fmt: skip

    def change_times(self) -> None:
        """Change the log times of messages."""
        share, number = self.draw.choice((0.002, 0.1, 1.0)), self._number()
        factor = self.draw.choice((0, 1, 10**4, 10**6))
        self.content.messages = [
            replace(each, log_time=(number + factor * each.log_time) % 2**64)
            if self.draw.random() < share else each
            for each in self.content.messages
        ]  # fmt: skip

    def change_order(self) -> None:
        """Shuffle, repeat or leave out messages."""
        messages = self.content.messages
        match self.draw.randrange(4):
            case 0:
                self.draw.shuffle(messages)
            case 1:
                messages += messages
            case 2:
                messages.clear()
            case _:
                self.content.messages = self.draw.sample(messages, len(messages) // 2)

    def change_message(self) -> None:
        """Change the channel or the number of messages."""
        for _ in range(self.draw.choice((1, 30))):
            channel = self.draw.choice((0, 1, 2, 3, 65535))
            self._replace(
                self.content.messages,
                channel_id=lambda _, c=channel: c,
                sequence=lambda _: 2**32 - 1,
            )

    def change_statistics(self) -> None:
        """Count wrongly."""
        old, number = self.content.statistics, self._number
        if old is None:
            return
        counts = self.draw.choice(
            (
                {},
                dict.fromkeys(old.channel_message_counts, number()),
                {key: number() for key in range(1000)},
            )
        )
        self.content.statistics = self.draw.choice(
            (
                None,
                replace(old, message_count=number()),
                replace(old, message_start_time=number(), message_end_time=number()),
                replace(old, channel_message_counts=counts),
            )
        )

    def change_attachment(self) -> None:
        """Change name, type or bytes of an attachment, or its values."""
        change = self.draw.choice(
            (
                {'name': self._text},
                {'media_type': self._text},
                {'data': self._bytes},
                {'log_time': self._number, 'create_time': self._number},
                *[{'data': self._with_values}] * 6,
            )
        )
        self._replace(self.content.attachments, **change)

    def _with_values(self, data: bytes) -> bytes:
        lines = data.split(b'\n')
        for _ in range(self.draw.choice((1, 2, 10))):
            number = self.draw.randrange(len(lines))
            key, colon, _ = lines[number].partition(b':')
            lines[number] = key + (colon or b':') + b' ' + self.draw.choice(VALUES).encode()
        return b'\n'.join(lines)

    def change_more_attachments(self) -> None:
        """Attach many files, a large one, or one that a run may have."""
        names = ('map.png', 'map.bmp', 'controller.yaml', 'controller.py', 'controller.zip')
        content = self.draw.choice((
            b'', b'PK\3\4', b'\x89PNG\r\n\x1a\n' + bytes(100), b'[' * 100_000, bytes(300_000),
            b'reference: this:aaaaaaa\nclass_path: this:aaaaaaa\nsha256: ' + b'0' * 64
            + b"\npackage: ''\nportable: true\n",
            picture(self.draw.choice(NUMBERS) % 2**32, self.draw.choice((1, 4000, 100_000))),
        ))  # fmt: skip
        name = self.draw.choice((*names, *TEXTS))
        count = self.draw.choice((1, 1, 1, 500 if len(content) < 10_000 else 20))
        self.content.attachments += [
            Attachment(0, 0, f'{name}{number or ""}', '', content) for number in range(count)
        ]

    def change_metadata(self) -> None:
        """Add metadata, or change those that are there."""
        names = ('ballbot_incomplete', 'ballbot_participants', 'ballbot_run', 'rosbag2', *TEXTS)
        name = self.draw.choice([*names, *(each.name for each in self.content.metadata)])
        count = self.draw.choice((0, 1, 5, 2000))
        texts = {f'{self._text("")}{n}': self._text('reason') for n in range(min(count, 20))}
        texts |= {str(n): '' for n in range(20, count)}
        known = ('reason', 'outcome', 'ticks', 'duty_sha256', 'serialized_metadata')
        texts |= {each: self.draw.choice((*TEXTS, *VALUES)) for each in known}
        self.content.metadata.append(Metadata(name, texts))

    def change_header(self) -> None:
        """Change the profile or the library."""
        name = self.draw.choice(('profile', 'library', 'library'))
        self.content.header = replace(self.content.header, **{name: self._text('x')})

    def change_form(self) -> None:
        """Compress otherwise, or in many chunks."""
        self.content.compression = self.draw.choice(('', 'lz4', 'zstd'))
        self.content.messages_per_chunk = self.draw.choice((1, 7, 10_000))

    def change_chunks(self) -> None:
        """Add chunks of zeros, empty ones, or some that are not what they declare."""
        zeros = [Message(1, 0, bytes(self.draw.choice((0, 10_000, 2**24))), 0, 0)]
        declared = self.draw.choice((None, None, 0, 100, 2**40, 2**64 - 1))
        chunk = chunk_of(zeros, self.draw.choice(('', 'zstd', 'lz4')), declared)
        if self.draw.random() < 0.2:
            chunk = replace(chunk, compression=self.draw.choice(('brotli', 'zstd', 'lz4', '\0')))
        self.content.chunks += [chunk] * self.draw.choice((1, 1, 3))

    def change_participants(self) -> None:
        """Damage texts in messages: names, values and hashes of participants and events."""
        for number, each in enumerate(self.content.messages):
            if len(each.data) > 60 and self.draw.random() < 0.05:
                at = self.draw.randrange(16, len(each.data))
                text = self.draw.choice((*TEXTS[:20], *VALUES[:20])).encode()[:40]
                data = each.data[:at] + text + each.data[at + len(text) :]
                self.content.messages[number] = replace(each, data=data)


def picture(width: int, height: int) -> bytes:
    """Return a PNG that declares a size and ends early."""
    head = b'IHDR' + struct.pack('>IIBBBBB', width, height, 8, 0, 0, 0, 0)
    body = b'IDAT' + zlib.compress(bytes(1000))
    parts = [struct.pack('>I', len(each) - 4) + each + struct.pack('>I', zlib.crc32(each))
             for each in (head, body, b'IEND')]  # fmt: skip
    return b'\x89PNG\r\n\x1a\n' + b''.join(parts)


def hostile_file(base: Content, seed: str) -> tuple[bytes, list[str]]:
    """Return a hostile recording made from the content of another, and what was changed."""
    content = base.copy()
    changed = Mutator(random.Random(seed), content).mutate()
    return content.encode(), changed
