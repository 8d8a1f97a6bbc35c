"""Recordings of another tool, and damage to the bytes of a recording."""

from mcap.writer import CompressionType, IndexType, Writer
from text_messages import STRING, string

UNCHUNKED = {'use_chunking': False}
UNCOMPRESSED = {'compression': CompressionType.NONE, 'chunk_size': 100}
WITHOUT_CHECKSUMS = {**UNCOMPRESSED, 'enable_crcs': False}
FOREIGN = (
    {},
    UNCHUNKED,
    UNCOMPRESSED,
    WITHOUT_CHECKSUMS,
    {'compression': CompressionType.LZ4, 'chunk_size': 100},
    {'use_statistics': False},
    {'repeat_channels': False, 'repeat_schemas': False},
    {
        'repeat_channels': False, 'repeat_schemas': False, 'use_statistics': False,
        'use_summary_offsets': False, 'index_types': IndexType.NONE,
    },
)  # fmt: skip
"""Options of mcap's writer; with the last ones a file has no summary."""


def write_foreign(
    path,
    contents,
    *,
    profile='ros2',
    type_name=STRING,
    definition=b'string data',
    schema_encoding='ros2msg',
    encoding='cdr',
    metadata=None,
    **options,
):
    """Write messages on /lcd, an attachment and a metadata record with mcap's own writer.

    A message is the bytes or the text of a std_msgs/String; its number is its sequence number and
    log time [ns], the publish time is 7 ns later. Return the bytes of the file.
    """
    with path.open('wb') as stream:
        writer = Writer(stream, **options)
        writer.start(profile, 'another recorder')
        schema = writer.register_schema(type_name, schema_encoding, definition)
        channel = writer.register_channel('/lcd', encoding, schema, metadata or {})
        for number, content in enumerate(contents):
            data = content if isinstance(content, bytes) else string(content)
            writer.add_message(channel, number, data, number + 7, number)
        writer.add_attachment(3, 4, 'notes.txt', 'text/plain', b'notes')
        writer.add_metadata('origin', {'robot': 'another'})
        writer.finish()
    return path.read_bytes()


def flip(content, position, bits=1):
    """Return a copy with other bits in one byte."""
    return content[:position] + bytes([content[position] ^ bits]) + content[position + 1 :]
