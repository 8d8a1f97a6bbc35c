"""The data log as CSV: its format, and refused files."""

import pytest

from ballbot_ros.errors import RecordingError
from ballbot_ros.recording.csv_log import HEADER, read_csv_log, write_csv_log
from ballbot_ros.robot.brick.bluetooth import LogPacket


def packet(time_ms):
    return LogPacket(time_ms, -1, 2, 8005, 0, -123, 45, -2048, 2048, 0, 0, 255)


def test_a_row_has_the_columns_of_the_header(tmp_path):
    path = tmp_path / 'log.csv'
    write_csv_log(path, [packet(1100)])
    assert path.read_bytes() == (
        b'Time,Data1,Data2,Battery,Motor Rev A,Motor Rev B,Motor Rev C,ADC S1,ADC S2,ADC S3,'
        b'ADC S4,I2C\n1100,-1,2,8005,0,-123,45,-2048,2048,0,0,255\n'
    )


def test_what_was_written_is_read_again(tmp_path):
    path = tmp_path / 'log.csv'
    packets = [packet(2**32 - 50), packet(50), packet(150)]
    write_csv_log(path, packets)
    assert read_csv_log(path) == packets
    with path.open('a') as file:
        file.write('250,0,0,80')
    assert read_csv_log(path) == packets, 'a line that was cut off counts'


@pytest.mark.parametrize(
    ('path', 'reason'),
    [('/dev/full', 'already exists; choose another --output'), ('no/log.csv', 'No such file')],
)
def test_a_file_that_cannot_be_written_is_named(tmp_path, path, reason):
    with pytest.raises(RecordingError, match=rf'{path}: {reason}'):
        write_csv_log(tmp_path / path, [packet(1100)])


ROW = '0,0,8005,0,-123,45,-2048,2048,0,0,255'


@pytest.mark.parametrize(
    ('lines', 'message'),
    [
        ([], ': is not a data log: its first line must be'),
        (['Time,Battery', f'100,{ROW}'], ': is not a data log: its first line must be'),
        ([HEADER, '', f'100,{ROW}'], ', line 2: 12 values are needed, not 1'),
        ([HEADER, f'100,{ROW},7'], ', line 2: 12 values are needed, not 13'),
        ([HEADER, f'1e2,{ROW}'], ", line 2: '1e2' is not a whole number"),
        ([HEADER, f'nan,{ROW}'], ", line 2: 'nan' is not a whole number"),
        ([HEADER, f'-1,{ROW}'], ', line 2: '),
        ([HEADER, f'100,{ROW}'.replace('2048', '40000')], ', line 2: '),
        ([HEADER, f'200,{ROW}', f'200,{ROW}'], ', line 3: its time, 200 ms, is not after 200 ms'),
        ([HEADER, f'200,{ROW}', f'100,{ROW}'], ', line 3: its time, 100 ms, is not after 200 ms'),
        ([HEADER, '²,' + ROW], ': is not a data log: it is not ASCII text'),
    ],
)
def test_what_is_not_a_log_is_refused_with_its_line(tmp_path, lines, message):
    path = tmp_path / 'log.csv'
    path.write_text('\n'.join([*lines, '']), 'utf-8')
    with pytest.raises(RecordingError) as refused:
        read_csv_log(path)
    assert str(refused.value).startswith(f'{path}{message}')
    assert '\n' not in str(refused.value)


@pytest.mark.parametrize('name', ['missing.csv', ''])
def test_a_file_that_cannot_be_read_is_refused(tmp_path, name):
    path = tmp_path / name
    with pytest.raises(RecordingError) as refused:
        read_csv_log(path)
    assert str(refused.value).startswith(f'{path}: ')
