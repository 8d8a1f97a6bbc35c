"""`ballbot export --to log`: the data log of a recording, and refused files."""

import pytest
from graph import call

from ballbot_ros.recording.csv_log import HEADER
from ballbot_ros.recording.schemas import encoder, new_message
from ballbot_ros.recording.writer import RecordingWriter
from ballbot_ros.robot.brick.bluetooth import LogPacket


def export(*arguments):
    return call('export', *arguments, '--to', 'log')


def write_recording(path, events, prefix=''):
    """Write runs, given by their start [s], and packets with log times [s], given as pairs."""
    header, array = new_message('std_msgs/msg/Header'), new_message('std_msgs/msg/UInt8MultiArray')
    writer = RecordingWriter(path)
    run = writer.add_topic(f'{prefix}/plant/run', 'std_msgs/msg/Header')
    packets = writer.add_topic(f'{prefix}/bluetooth/tx', 'std_msgs/msg/UInt8MultiArray')
    for number, event in enumerate(events, 1):
        if isinstance(event, tuple):
            time_s, array.data = event
            data = encoder('std_msgs/msg/UInt8MultiArray')(array)
            writer.write(packets, round(time_s * 1e9), data, number)
        else:
            header.stamp.sec = event
            data = encoder('std_msgs/msg/Header')(header)
            writer.write(run, event * 10**9, data, number)
    writer.close()


def packet(time_ms):
    return time_ms / 1e3, LogPacket(time_ms, 0, 0, 8005, 0, 1, 2, 3, 4, 0, 0, 255).encode()


def row(time_ms):
    return f'{time_ms},0,0,8005,0,1,2,3,4,0,0,255'


@pytest.mark.parametrize('prefix', ['', '/robot'])
def test_each_run_becomes_a_file(tmp_path, prefix):
    recording = tmp_path / 'drive.mcap'
    write_recording(recording, [1, packet(1100), 5, packet(1200), packet(5100)], prefix)
    done = export(recording)
    assert (done.returncode, done.stderr) == (0, '')
    first, second = tmp_path / 'drive_log/drive.csv', tmp_path / 'drive_log/drive_2.csv'
    assert done.stdout == f'{first}\n{second}\n'
    assert first.read_text() == f'{HEADER}\n{row(1100)}\n{row(1200)}\n'
    assert second.read_text() == f'{HEADER}\n{row(5100)}\n'


def test_malformed_packets_are_skipped_and_counted(tmp_path):
    recording = tmp_path / 'drive.mcap'
    write_recording(recording, [1, packet(1100), (1.1, b'short'), packet(1200)])
    done = export(recording, '--output', tmp_path / 'new')
    assert done.returncode == 0
    assert done.stderr == f'{recording}: skipped 1 malformed log packets\n'
    assert (tmp_path / 'new/drive.csv').read_text() == f'{HEADER}\n{row(1100)}\n{row(1200)}\n'


def test_nothing_is_overwritten(tmp_path):
    recording = tmp_path / 'drive.mcap'
    write_recording(recording, [1, packet(1100)])
    table = tmp_path / 'drive_log/drive.csv'
    table.parent.mkdir()
    table.write_text('precious')
    done = export(recording)
    assert done.returncode == 2
    assert done.stderr == f'error: {table}: already exists; choose another --output\n'
    assert table.read_text() == 'precious'


def test_a_file_without_a_log_is_named(tmp_path):
    other = tmp_path / 'other.mcap'
    writer = RecordingWriter(other)
    topic = writer.add_topic('/plant/run', 'std_msgs/msg/Header')
    header = new_message('std_msgs/msg/Header')
    writer.write(topic, 1, encoder('std_msgs/msg/Header')(header), 1)
    writer.close()
    done = export(other)
    assert done.returncode == 2
    assert done.stderr == (
        f"error: {other}: topic 'bluetooth/tx' not found; the file has /plant/run\n"
    )
    assert list(tmp_path.iterdir()) == [other]
