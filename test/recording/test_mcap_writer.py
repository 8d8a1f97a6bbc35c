"""The writer of MCAP files, compared byte by byte with the package's."""

import io

import numpy as np
from hypothesis import strategies as st
from laws import given
from mcap.writer import Writer

from ballbot_ros.recording.mcap_writer import McapWriter, MessageBlock

small = st.integers(0, 2**16)
data = st.binary(max_size=300)
actions = st.lists(
    st.one_of(
        st.tuples(st.just('schema'), st.text(max_size=5), data),
        st.tuples(st.just('channel'), st.text(max_size=5), small),
        st.tuples(st.just('message'), small, st.integers(0, 2**63 - 1), data, small, small),
        st.tuples(st.just('message'), small, st.integers(0, 20), data, small, small),
        st.tuples(st.just('attachment'), small, small, st.text(max_size=5), data),
        st.tuples(st.just('metadata'), st.text(max_size=5)),
        st.tuples(st.just('flush')),
    ),
    max_size=40,
)


@given(actions=actions, chunk_size=st.sampled_from([10, 300, 2**20]))
def test_the_file_is_the_one_that_the_package_writes(actions, chunk_size):
    assert_same_file(actions, chunk_size)


def test_chunks_end_at_the_same_size():
    message = ('message', 0, 1, b'data', 2, 3)
    actions = [
        ('channel', 'a', 0),
        message,
        ('schema', 'b', b'text'),
        message,
        ('channel', 'c', 1),
        message,
    ]
    for chunk_size in range(30, 300):
        assert_same_file(actions, chunk_size)


blocks = st.lists(
    st.tuples(
        st.integers(0, 2),
        st.lists(st.integers(0, 20), min_size=1, max_size=8).map(sorted),
        st.integers(1, 60),
    ),
    min_size=1,
    max_size=5,
)


@given(parts=st.lists(blocks, max_size=4), chunk_size=st.sampled_from([10, 300, 2**20]))
def test_blocks_are_written_like_their_messages_in_the_order_of_their_times(parts, chunk_size):
    one_by_one, at_once = io.BytesIO(), io.BytesIO()
    writers = [McapWriter(each, 'ros2', 'us', chunk_size) for each in (one_by_one, at_once)]
    for writer in writers:
        for channel in 'abc':
            writer.add_channel(channel, 'cdr', 0, {})
    for part in parts:
        made, messages = [], []
        for number, (channel, times, size) in enumerate(part):
            sequences = np.arange(len(times)) + number
            data = [bytes([number, *range(size)]) for _ in times]
            rows = np.array([np.frombuffer(each, f'V{size + 1}')[0] for each in data])
            made.append(MessageBlock(channel + 1, sequences, np.array(times), rows))
            messages += zip(times, [channel + 1] * len(times), data, sequences, strict=True)
        for log_ns, channel, content, sequence in sorted(messages, key=lambda each: each[0]):
            writers[0].add_message(channel, log_ns, content, log_ns, sequence)
        writers[1].add_messages(made)
    for writer in writers:
        writer.finish()
    assert at_once.getvalue() == one_by_one.getvalue()


def assert_same_file(actions, chunk_size):
    expected, written = io.BytesIO(), io.BytesIO()
    theirs = Writer(expected, chunk_size, enable_data_crcs=True)
    theirs.start('ros2', 'library')
    ours = McapWriter(written, 'ros2', 'library', chunk_size)
    schemas, channels, times = [0], [], []
    for action, *what in actions:
        if action == 'schema':
            name, content = what
            schemas.append(theirs.register_schema(name, 'ros2msg', content))
            assert ours.add_schema(name, 'ros2msg', content) == schemas[-1]
        elif action == 'channel':
            name, number = what
            channel = (name, 'cdr', schemas[number % len(schemas)], {'key': 'value'})
            channels.append(theirs.register_channel(*channel))
            assert ours.add_channel(*channel) == channels[-1]
        elif action == 'message' and channels:
            number, log_ns, content, publish_ns, sequence = what
            message = (channels[number % len(channels)], log_ns, content, publish_ns, sequence)
            theirs.add_message(*message)
            ours.add_message(*message)
            times.append(log_ns)
        elif action == 'attachment':
            created, logged, name, content = what
            theirs.add_attachment(created, logged, name, 'text/plain', content)
            ours.add_attachment(created, logged, name, 'text/plain', content)
        elif action == 'metadata':
            theirs.add_metadata(what[0], {'key': 'value'})
            ours.add_metadata(what[0], {'key': 'value'})
        elif action == 'flush':
            theirs.flush()
            ours.flush()
            assert written.getvalue() == expected.getvalue()
            assert ours.times_ns == ((min(times), max(times)) if times else None)
    theirs.finish()
    ours.finish()
    assert written.getvalue() == expected.getvalue()
