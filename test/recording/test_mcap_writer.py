"""The writer of MCAP files, compared byte by byte with the package's."""

import io

from hypothesis import strategies as st
from laws import given
from mcap.writer import Writer

from ballbot_ros.recording.mcap_writer import McapWriter

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
