"""info, repair, export and play as a user sees them: output and exit status."""

import csv
import json
import math
from importlib.util import find_spec

import pytest
from graph import call, record

from ballbot_ros.cli.play import command as play
from ballbot_ros.cli.play import parse_keys
from ballbot_ros.parameters import ParameterError
from ballbot_ros.recording.playback import KEYS


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp('run')
    return record(folder, 'stationary', '--set=plant_sim.duration=2.0')[0]


@pytest.fixture
def cut(run, tmp_path):
    path = tmp_path / 'cut.mcap'
    path.write_bytes(run.read_bytes()[:-80_000])
    return path


def test_info_shows_the_content_of_a_file(run):
    result = call('info', run, '--json')
    assert result.returncode == 0, result.stderr
    told = json.loads(result.stdout)
    assert told['complete'] is True
    assert (told['start_s'], told['end_s'], told['duration_s']) == (1.0, 2.996, 1.996)
    assert told['outcome']['outcome'] == 'completed'
    assert told['outcome']['ticks'] == '500'
    assert told['runs_s'] == [1.0]
    assert told['made_by']['seed'] == 1
    assert told['topics']['/clock'] == {
        'type': 'rosgraph_msgs/msg/Clock', 'count': 500, 'rate_hz': pytest.approx(250.0),
        'largest_gap_s': 0.004, 'largest_gap_at_s': 1.0, 'derived': False,
    }  # fmt: skip
    derived = {name for name, topic in told['topics'].items() if topic['derived']}
    assert derived == {
        '/tf', '/tf_static', '/odom', '/imu/data', '/markers', '/robot_description',
    }  # fmt: skip
    assert set(told['attachments']) == {'scenario.yaml', 'parameters.yaml', 'versions.yaml'}
    text = call('info', run).stdout
    assert 'tf2_msgs/msg/TFMessage, derived' in text
    assert 'state       complete\n' in text
    assert 'outcome     completed\n' in text


def test_info_and_repair_of_a_cut_file(cut):
    result = call('info', cut)
    assert result.returncode == 0
    assert f'cut off at byte {cut.stat().st_size}; `ballbot repair {cut}` recovers' in result.stdout
    result = call('repair', cut)
    assert result.returncode == 0, result.stderr
    repaired = cut.with_name('cut_repaired.mcap')
    assert result.stdout.startswith(f'{cut}: cut off at byte {cut.stat().st_size}; ')
    assert ' messages up to 2.000 s kept\n' in result.stdout
    assert result.stdout.endswith(f'\nrepaired  {repaired}\n')
    told = json.loads(call('info', repaired, '--json').stdout)
    assert told['missing'].startswith('repaired: cut off at byte')
    assert told['complete'] is False
    assert call('repair', cut).returncode == 2
    result = call('repair', repaired)
    assert (result.returncode, 'no repair needed' in result.stdout) == (0, True)


def test_export_writes_tables(run, cut, tmp_path):
    result = call('export', run, '--to', 'csv', '--output', tmp_path / 'a', '--topics',
                     '/plant/imu,/motor_duty')  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert sorted(path.name for path in (tmp_path / 'a').iterdir()) == [
        'motor_duty.csv',
        'plant_imu.csv',
    ]
    with (tmp_path / 'a/plant_imu.csv').open(newline='') as stream:
        first = next(csv.DictReader(stream))
    assert float(first['pitch_x_rad']) == pytest.approx(0.069813, abs=1e-5)
    result = call('export', cut, '--to', 'csv', '--joined')
    assert result.returncode == 0, result.stderr
    assert 'the tables have the rest' in result.stderr
    with cut.with_name('cut_csv').joinpath('joined.csv').open(newline='') as stream:
        rows = list(csv.DictReader(stream))
    assert (len(rows), rows[-1]['time_s']) == (251, '2.0')
    assert {'motor_duty_x_percent', 'operating_state_data', 'sonar_range_m'} <= set(rows[0])


def test_exported_columns_say_what_they_mean(run, tmp_path):
    result = call('export', run, '--to', 'csv', '--output', tmp_path / 'a')
    assert result.returncode == 0, result.stderr

    def columns(topic):
        with (tmp_path / 'a' / f'{topic}.csv').open(newline='') as stream:
            rows = list(csv.DictReader(stream))
        return {name: [row[name] for row in rows] for name in rows[0]}

    def numbers(topic, name):
        return [float(text) for text in columns(topic)[name]]

    readings = numbers('gyro', 'reading_x_deg_per_s')
    assert readings[0] == pytest.approx(600.0)
    rates = map(math.degrees, numbers('gyro', 'angular_velocity_y_rad_per_s'))
    assert readings == pytest.approx(list(rates))
    encoders = numbers('joint_states', 'encoder_x_deg')
    assert max(encoders) > 10.0
    assert encoders == pytest.approx([round(angle) for angle in encoders])
    pitch = numbers('controller_state', 'estimated_pitch_x_deg')
    estimated = map(math.degrees, numbers('controller_state', 'position_psi_x_rad'))
    assert pitch == pytest.approx(list(estimated))
    assert set(columns('gamepad')['stick_vertical_percent']) == {'0.0'}
    # One name never means two things: y of the map grows leftward, the position rightward.
    odom = columns('plant_odom')
    assert not {name for name in odom if name.startswith('position_')}
    leftward = numbers('plant_odom', 'map_y_m')
    assert [-y for y in leftward] == numbers('plant_odom', 'plane_position_y_m')
    assert numbers('plant_odom', 'map_x_m') == numbers('plant_odom', 'plane_position_x_m')


def test_derived_topics_are_exported_only_when_they_are_named(run, tmp_path):
    for folder, options in (('all', ()), ('named', ('--topics', '/tf,/odom'))):
        result = call('export', run, '--to', 'csv', '--output', tmp_path / folder, *options)
        assert result.returncode == 0, result.stderr
    tables = {path.stem for path in (tmp_path / 'all').iterdir()}
    assert 'plant_odom' in tables
    assert not tables & {'tf', 'tf_static', 'odom', 'imu_data', 'markers', 'robot_description'}
    assert {path.stem for path in (tmp_path / 'named').iterdir()} == {'tf', 'odom'}
    with (tmp_path / 'named' / 'odom.csv').open(newline='') as stream:
        assert {'odom_x_m', 'odom_y_m', 'odom_z_m'} <= set(next(csv.reader(stream)))


@pytest.mark.parametrize(
    ('name', 'value'), [('rate', 0.0), ('rate', float('nan')), ('start', -1.0)]
)
def test_a_rate_or_start_out_of_bounds_is_refused_with_the_bounds(run, name, value):
    with pytest.raises(ParameterError, match=rf'^player\.{name}: .* is not within \S+ … '):
        play.main([str(run), f'--{name}', str(value)], standalone_mode=False)


def test_keys_that_arrive_together_are_separated():
    assert parse_keys('++\x1b[C\x1b[D q') == ['+', '+', '\x1b[C', '\x1b[D', ' ', 'q']
    for key in KEYS:
        for sent in key.terminal:
            assert parse_keys(f'x{sent}.') == ['x', sent, '.']


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['--to', 'cvs'], "'csv', 'parquet', 'log' (did you mean csv?)"),
        (['--to', 'csv', '--topics', '/motor_dty'], "'/motor_dty' not found (did you mean "),
        (['--to', 'csv', '--output', ''], "'--output': names nothing"),
        (['--to', 'csv', '--output', '{file}'], ': not a folder; choose another --output'),
    ],
)
def test_a_mistake_of_export_is_named(command, run, tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    status, output, errors = command('export', run, *(word.format(file=run) for word in words))
    assert (status, output) == (2, '')
    assert message in errors.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []
    assert list(run.parent.glob('*_csv')) == []


def test_a_file_without_messages_is_not_exported(command, run, tmp_path):
    path = tmp_path / 'beginning.mcap'
    path.write_bytes(run.read_bytes()[:20])
    status, output, errors = command('export', '--to', 'csv', path)
    assert (status, output) == (2, '')
    assert errors.splitlines()[-1] == f'error: {path}: no messages to export'


@pytest.mark.parametrize('words', [['info'], ['repair'], ['export', '--to', 'csv'], ['play']])
def test_a_file_that_is_not_a_recording_is_one_line(command, words, tmp_path):
    if words == ['play'] and not find_spec('rclpy'):
        pytest.skip('needs rclpy')
    path = tmp_path / 'other.mcap'
    path.write_bytes(b'SQLite format 3\0')
    status, _, errors = command(*words, path)
    assert status == 2
    assert errors.startswith(f'error: {path}: ')
    assert errors.count('\n') == 1
    assert list(tmp_path.iterdir()) == [path]
