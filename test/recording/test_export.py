"""Tables: columns with units, one table per topic or one joined table."""

import csv
import errno
import json
import math
import os
import sys

import numpy as np
import pytest
from recorded_bytes import UNCOMPRESSED, flip, write_foreign

from ballbot_ros.errors import MissingExtraError, RecordingError
from ballbot_ros.recording import columns
from ballbot_ros.recording.columns import ColumnHints, ComputedColumn, TopicColumns
from ballbot_ros.recording.export import Exporter
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.schemas import encoder, new_message
from ballbot_ros.recording.writer import RecordingWriter

IMU = 'sensor_msgs/msg/Imu'
JOINTS = 'sensor_msgs/msg/JointState'
RANGE = 'sensor_msgs/msg/Range'
STRING = 'std_msgs/msg/String'
BYTES = 'std_msgs/msg/UInt8MultiArray'
TICK_NS = 4_000_000


class Recording:
    def __init__(self, path):
        self.writer = RecordingWriter(path)
        self.topics = {}

    def add(self, topic, type_name, stamp_ns, **values):
        message = new_message(type_name)
        for name, value in values.items():
            *parents, last = name.split('__')
            target = message
            for parent in parents:
                target = getattr(target, parent)
            setattr(target, last, value)
        if topic not in self.topics:
            self.topics[topic] = self.writer.add_topic(topic, type_name)
        self.writer.write(self.topics[topic], stamp_ns, encoder(type_name)(message), 1)


@pytest.fixture
def recording(tmp_path):
    recording = Recording(tmp_path / 'run.mcap')
    yield recording
    recording.writer.close()


def export(recording, *, joined=False, hints=None, topics=None, texts=(), to='csv'):
    recording.writer.close()
    path = recording.writer.path
    with RecordingReader(path) as reader:
        chosen = topics or sorted(reader.topics())
        exporter = Exporter(reader, path.with_name('tables'), to, chosen, hints or {})
        if joined:
            exporter.write_joined(TICK_NS, texts)
        else:
            exporter.write_topics()
    return {file.stem: file for file in exporter.files}


def rows(path):
    with path.open(newline='', encoding='utf-8') as stream:
        return list(csv.DictReader(stream))


def test_columns_have_names_and_units(recording):
    recording.add(
        '/imu', IMU, 1_004_000_000, angular_velocity__y=0.1, orientation__w=0.7,
        header__stamp__sec=1, header__stamp__nanosec=3_000_000,
    )  # fmt: skip
    names = ['motor_x', 'motor_y']
    recording.add('/joints', JOINTS, 10**9, name=names, position=[0.1, 1 / 3], velocity=[2.0, 3.0])
    recording.add('/sonar', RANGE, 10**9, range=math.inf)
    recording.add('/odd', BYTES, 10**9, data=b'\x01\xff')
    files = export(recording)
    (imu,) = rows(files['imu'])
    assert (imu['time_s'], imu['stamp_s']) == ('1.004', '1.003')
    assert imu['angular_velocity_y_rad_per_s'] == '0.1'
    assert imu['linear_acceleration_x_m_per_s2'] == '0.0'
    assert imu['orientation_w'] == '0.7'
    assert imu['orientation_covariance'] == str([0.0] * 9)
    (joints,) = rows(files['joints'])
    assert list(joints)[3:] == [
        'position_motor_x_rad', 'position_motor_y_rad',
        'velocity_motor_x_rad_per_s', 'velocity_motor_y_rad_per_s',
    ]  # fmt: skip
    assert float(joints['position_motor_y_rad']) == 1 / 3
    (sonar,) = rows(files['sonar'])
    assert float(sonar['range_m']) == math.inf
    assert not any('ULTRASOUND' in name for name in sonar)
    (odd,) = rows(files['odd'])
    assert odd['data'] == '01ff'


def test_knowledge_about_a_topic_is_added(recording):
    recording.add('/imu', IMU, 10**9, angular_velocity__y=0.5)
    hints = ColumnHints(
        names={'angular_velocity_y_rad_per_s': 'pitch_rate_rad_per_s'},
        extra={
            'double': ComputedColumn(('angular_velocity_y_rad_per_s',), lambda rate: 2 * rate),
            'missing': ComputedColumn(('other',), lambda other: other),
        },
    )
    (row,) = rows(export(recording, hints={('/imu', IMU): hints})['imu'])
    assert (row['pitch_rate_rad_per_s'], row['double'], row['missing']) == ('0.5', '1.0', 'nan')


def test_colliding_names_are_made_unique(recording):
    recording.add('/odom', 'nav_msgs/msg/Odometry', 10**9, pose__pose__position__x=1.5)
    recording.add('/a/b', STRING, 10**9, data='first')
    recording.add('/a_b', STRING, 10**9, data='second')
    files = export(recording)
    (odom,) = rows(files['odom'])
    assert odom['position_x_m'] == '1.5'
    assert {'pose_covariance', 'twist_covariance', 'linear_x_m_per_s'} <= set(odom)
    assert rows(files['a_b'])[0]['data'] == 'first'
    assert rows(files['a_b_'])[0]['data'] == 'second'


def test_joined_rows_hold_values_until_the_next(recording):
    stamps = [10**9 + tick * TICK_NS for tick in range(6)]
    for stamp in stamps:
        recording.add('/fast', RANGE, stamp, range=float(stamp - 10**9))
        if stamp == stamps[2]:
            # One message a tick late in the file, and one between two ticks.
            recording.add('/slow', RANGE, stamps[1] + 1, range=7.0)
            recording.add('/state', STRING, stamps[1], data='balance')
    recording.add('/text', STRING, stamps[5], data='left out')
    found = rows(export(recording, joined=True, texts=['/state'])['joined'])
    assert [row['time_s'] for row in found] == [str(stamp / 1e9) for stamp in stamps]
    assert [float(row['fast_range_m']) for row in found] == [stamp - 10**9 for stamp in stamps]
    assert [row['slow_range_m'] for row in found] == ['', '', '7.0', '7.0', '7.0', '7.0']
    assert [row['state_data'] for row in found] == ['', *['balance'] * 5]
    assert not any('text' in name or name.endswith('stamp_s') for name in found[0])


def test_a_message_may_be_a_second_late(recording):
    first, last = 2_500_000, 2_500_500
    stamps = [first + 1, first, *range(first + 2, last), last - 250, last, last - 1]
    for tick in stamps:
        recording.add('/fast', RANGE, tick * TICK_NS, range=float(tick))
    found = rows(export(recording, joined=True)['joined'])
    assert [float(row['fast_range_m']) for row in found] == list(range(first, last + 1))
    assert [float(row['time_s']) for row in found] == [
        tick * TICK_NS / 1e9 for tick in range(first, last + 1)
    ]


@pytest.mark.parametrize('later_ns', [-250 * TICK_NS, -2 * 10**9, 7200 * 10**9])
def test_stamps_out_of_order_are_an_error(recording, later_ns):
    for tick in range(800):
        recording.add('/fast', RANGE, 10**10 + tick * TICK_NS, range=float(tick))
    recording.add('/fast', RANGE, 10**10 + 799 * TICK_NS + later_ns)
    with pytest.raises(RecordingError, match=r'/fast at .* s is out of order'):
        export(recording, joined=True)
    assert not recording.writer.path.with_name('tables').exists()


def test_a_late_message_may_repeat_what_the_table_has(recording):
    recording.add('/roll_call', 'std_msgs/msg/Header', 10**10, frame_id='run')
    for tick in range(800):
        recording.add('/fast', RANGE, 10**10 + tick * TICK_NS, range=float(tick))
    recording.add('/roll_call', 'std_msgs/msg/Header', 10**10, frame_id='run')
    assert len(rows(export(recording, joined=True)['joined'])) == 800


def test_a_topic_without_messages_has_no_table(recording):
    recording.topics['/text'] = recording.writer.add_topic('/text', STRING)
    assert export(recording, joined=True) == {}


@pytest.mark.parametrize('joined', [False, True])
def test_a_topic_whose_messages_are_all_damaged_has_no_table(tmp_path, joined):
    path = tmp_path / 'foreign.mcap'
    content = write_foreign(path, ['only'], **UNCOMPRESSED)
    path.write_bytes(flip(content, content.index(b'only')))
    with RecordingReader(path) as reader:
        assert reader.topics()['/lcd'].message_count == 1  # according to the summary
        exporter = Exporter(reader, tmp_path / 'tables', 'csv', ['/lcd'], {})
        exporter.write_joined(TICK_NS) if joined else exporter.write_topics()
        assert reader.corruption
    assert exporter.files == []


def test_changing_joints_and_axes_are_an_error(tmp_path):
    for number, (type_name, first, second) in enumerate((
        (JOINTS, {'name': ['a'], 'position': [0.1]}, {'name': ['b'], 'position': [0.1]}),
        (JOINTS, {'position': [0.1]}, {'position': [0.1, 0.2]}),
        ('sensor_msgs/msg/Joy', {'axes': [0.1]}, {'axes': [0.1, 0.2]}),
    )):  # fmt: skip
        recording = Recording(tmp_path / f'{number}.mcap')
        recording.add('/list', type_name, 10**9, **first)
        recording.add('/list', type_name, 2 * 10**9, **second)
        with pytest.raises(RecordingError, match=r'/list at 2\.000 s: the names or the number'):
            export(recording)


def test_every_column_of_the_graph_is_one_of_four_kinds(graph_types):
    for type_name in graph_types:
        columns = TopicColumns(new_message(type_name), ColumnHints()).columns
        assert {column.kind for column in columns} <= {bool, int, float, str}, type_name
    joints = new_message(JOINTS)
    joints.name, joints.position = ['a'], np.array([0.1])
    columns = TopicColumns(joints, ColumnHints()).columns
    assert {column.name: column.kind for column in columns}['position_a_rad'] is float


def test_lists_are_json(recording):
    key_value = new_message('diagnostic_msgs/msg/KeyValue')
    key_value.key, key_value.value = 'größe', '2'
    status = new_message('diagnostic_msgs/msg/DiagnosticStatus')
    status.level, status.values = 2, [key_value]
    recording.add('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', 10**9, status=[status])
    recording.add('/polygon', 'geometry_msgs/msg/Polygon', 10**9)
    files = export(recording)
    (diagnostics,), (polygon,) = rows(files['diagnostics']), rows(files['polygon'])
    assert json.loads(diagnostics['status']) == [
        {
            'level': 2, 'name': '', 'message': '', 'hardware_id': '',
            'values': [{'key': 'größe', 'value': '2'}],
        }
    ]  # fmt: skip
    assert 'größe' in diagnostics['status']
    assert polygon['points'] == '[]'


def test_a_closed_table_is_on_disk(tmp_path):
    path = tmp_path / 'table.csv'
    table = columns.CsvTable(path, [('a', int), ('b', float)])
    table.add([1, None])
    table.close()
    assert rows(path) == [{'a': '1', 'b': ''}]
    assert table  # It still exists: without `close`, its end would have written the file.


def test_the_error_is_reported_even_if_a_table_is_gone(recording, tmp_path):
    recording.add('/text', STRING, 10**9, data='a')
    recording.writer.close()
    calls = []

    def fail(*call):
        calls.append(call)
        (tmp_path / 'text.csv').unlink()
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with RecordingReader(recording.writer.path) as reader:
        exporter = Exporter(reader, tmp_path, 'csv', ['/text'], {}, fail)
        with pytest.raises(RecordingError, match=r': No space left on device$'):
            exporter.write_topics()
    assert calls == [(1, 1)]


def test_an_interrupted_export_leaves_no_folder_of_its_own(recording, tmp_path):
    def interrupt(*_):
        raise KeyboardInterrupt

    recording.add('/text', STRING, 10**9, data='a')
    recording.writer.close()
    theirs = tmp_path / 'theirs'
    theirs.mkdir()
    with RecordingReader(recording.writer.path) as reader:
        for folder, stays in ((tmp_path / 'ours', False), (theirs, True)):
            exporter = Exporter(reader, folder, 'csv', ['/text'], {}, interrupt)
            with pytest.raises(KeyboardInterrupt):
                exporter.write_topics()
            assert folder.exists() is stays


def test_no_file_is_overwritten(recording):
    recording.add('/text', STRING, 10**9, data='a')
    export(recording)
    with pytest.raises(RecordingError, match=r'text\.csv: already exists'):
        export(recording)
    folder = recording.writer.path.with_name('tables')
    (folder / 'text.csv').unlink()
    folder.rmdir()
    folder.touch()
    with pytest.raises(RecordingError, match=r'tables: not a folder; choose another --output$'):
        export(recording)


def test_parquet_has_the_same_values(recording, monkeypatch):
    parquet = pytest.importorskip('pyarrow.parquet')
    monkeypatch.setattr(columns, 'CELLS_AT_ONCE', 24)  # two rows of each topic
    for tick in range(3):
        recording.add('/sonar', RANGE, 10**9 + tick * TICK_NS, range=0.5 * tick)
    recording.add('/text', STRING, 10**9, data='a')
    path = export(recording, to='parquet')['sonar']
    assert parquet.ParquetFile(path).num_row_groups == 2
    table = parquet.read_table(path)
    assert table['time_s'].to_pylist() == [1.0, 1.004, 1.008]
    assert table['range_m'].to_pylist() == [0.0, 0.5, 1.0]
    assert str(table.schema.field('radiation_type').type) == 'int64'


def test_a_parquet_column_without_values_keeps_its_type(recording, monkeypatch):
    parquet = pytest.importorskip('pyarrow.parquet')
    monkeypatch.setattr(columns, 'CELLS_AT_ONCE', 26)  # two rows
    for tick in range(5):
        recording.add('/fast', RANGE, 10**9 + tick * TICK_NS, range=0.5 * tick)
    recording.add('/slow', RANGE, 10**9 + 3 * TICK_NS, range=7.0)
    table = parquet.read_table(export(recording, joined=True, to='parquet')['joined'])
    assert table['fast_range_m'].to_pylist() == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert table['slow_range_m'].to_pylist() == [None, None, None, 7.0, 7.0]
    assert len(table.schema) == 13


def test_a_missing_pyarrow_is_named(recording, monkeypatch):
    recording.add('/text', STRING, 10**9, data='a')
    monkeypatch.setitem(sys.modules, 'pyarrow', None)
    with pytest.raises(MissingExtraError, match=r'pyarrow.*, or use --to csv$'):
        export(recording, to='parquet')
    assert not recording.writer.path.with_name('tables').exists()


def test_a_number_that_parquet_cannot_store_is_an_error(recording):
    pytest.importorskip('pyarrow')
    recording.add('/large', 'std_msgs/msg/UInt64', 10**9, data=2**63)
    with pytest.raises(RecordingError, match=r'large\.parquet: '):
        export(recording, to='parquet')
    assert not recording.writer.path.with_name('tables').exists()
