"""The data log as CSV: its format, one file per run, and refused paths."""

from pathlib import Path

import pytest

from ballbot_ros.errors import RecordingError, TeleopError
from ballbot_ros.recording.csv_log import HEADER, CsvLog, read_csv_log
from ballbot_ros.robot.brick.bluetooth import LogPacket


def packet(time_ms):
    return LogPacket(time_ms, -1, 2, 8005, 0, -123, 45, -2048, 2048, 0, 0, 255)


def times(path):
    header, *rows = path.read_text().splitlines()
    assert header == HEADER
    return [int(row.split(',')[0]) for row in rows]


def test_a_row_has_the_columns_of_the_header(tmp_path):
    path = tmp_path / 'log.csv'
    log = CsvLog(path)
    log.write(packet(1100))
    log.flush()
    assert path.read_bytes() == (
        b'Time,Data1,Data2,Battery,Motor Rev A,Motor Rev B,Motor Rev C,ADC S1,ADC S2,ADC S3,'
        b'ADC S4,I2C\n1100,-1,2,8005,0,-123,45,-2048,2048,0,0,255\n'
    )
    log.close()


def test_each_run_has_a_file_and_late_packets_go_to_theirs(tmp_path):
    log = CsvLog(tmp_path / 'log.csv')
    log.begin_run(1000)
    log.write(packet(1100))
    log.begin_run(5000)
    log.write(packet(4900))  # overtaken by the announcement of the next run
    log.write(packet(5100))
    log.begin_run(9000)
    log.begin_run(9500)  # a run without a packet leaves no file
    log.write(packet(9600))
    log.close()
    names = ['log.csv', 'log_2.csv', 'log_3.csv']
    assert [path.name for path in log.paths] == sorted(p.name for p in tmp_path.iterdir()) == names
    assert [times(path) for path in log.paths] == [[1100, 4900], [5100], [9600]]


def test_the_clock_of_the_brick_may_wrap_around(tmp_path):
    log = CsvLog(tmp_path / 'log.csv')
    log.begin_run(1000)
    log.begin_run(2**32 - 100)
    log.write(packet(50))
    log.close()
    assert times(log.paths[1]) == [50]


def test_no_file_is_overwritten(tmp_path):
    path = tmp_path / 'log.csv'
    path.write_text('precious')
    with pytest.raises(TeleopError, match=r'log.csv: already exists'):
        CsvLog(path)
    assert path.read_text() == 'precious'
    path.unlink()
    (tmp_path / 'log_2.csv').write_text('precious')
    log = CsvLog(path)
    log.begin_run(1000)
    log.begin_run(5000)
    log.write(packet(5100))
    log.close()
    assert (tmp_path / 'log_2.csv').read_text() == 'precious'
    assert log.paths == [path, tmp_path / 'log_3.csv']


def test_a_path_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(TeleopError, match=r'nowhere/log.csv: No such file or directory'):
        CsvLog(tmp_path / 'nowhere/log.csv')


def test_a_full_disk_is_named(tmp_path):
    log = CsvLog(tmp_path / 'log.csv')
    log._file.close()
    log._file = Path('/dev/full').open('w')  # noqa: SIM115
    log.write(packet(1100))
    with pytest.raises(TeleopError, match=r'log.csv: No space left on device'):
        log.flush()


def test_what_was_written_is_read_again(tmp_path):
    path = tmp_path / 'log.csv'
    packets = [packet(2**32 - 50), packet(50), packet(150)]
    log = CsvLog(path)
    for each in packets:
        log.write(each)
    log.close()
    assert read_csv_log(path) == packets
    with path.open('a') as file:
        file.write('250,0,0,80')
    assert read_csv_log(path) == packets, 'a line that was cut off counts'


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
