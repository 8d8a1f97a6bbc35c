"""The data log as CSV: its format, one file per run, and refused paths."""

from pathlib import Path

import pytest

from ballbot_ros.brick.bluetooth import LogPacket
from ballbot_ros.teleop.csv_log import HEADER, CsvLog
from ballbot_ros.teleop.errors import TeleopError


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
