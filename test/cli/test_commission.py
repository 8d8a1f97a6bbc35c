"""`ballbot commission`: what it prints, and the profile that other commands take."""

import json
import re

import pytest
from real_runs import write_csv

import ballbot_ros as bb
from ballbot_ros.engine.scenario.reader import load_profile
from ballbot_ros.parameters import GyroParameters, PlantParameters
from ballbot_ros.recording.csv_log import HEADER
from benchmark.commissioning import BATTERIES_V, drawn_robot, simulated_log

DURATIONS = {'rest_time': 61.0, 'step_time': 0.06, 'play_time': 0.06, 'tilt_time': 0.1}
NAMES = (
    'gyro_driver.zero_rate_offset_x', 'gyro_driver.zero_rate_offset_y', 'gyro_driver.noise',
    'gyro_driver.drift', 'plant_sim.dead_zone', 'plant_sim.voltage_slope',
    'plant_sim.voltage_offset', 'plant_sim.backlash',
)  # fmt: skip


@pytest.fixture(scope='module')
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp('logs')
    return [
        write_csv(folder / f'{n}.csv', simulated_log(drawn_robot(1), volts, 1, DURATIONS))
        for n, volts in enumerate(BATTERIES_V)
    ]


def test_it_prints_all_and_writes_a_profile_with_a_picture(command, logs, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, output, error = command('commission', *logs)
    assert (status, error) == (0, '')
    for name in NAMES:
        assert re.search(rf'{name} .* [-−0-9.]+ ± [0-9.]+ ', output), name
    assert output.count('on motor B turned B by +') == output.count('on motor C turned') == 2
    assert output.count('not tilted') == 2
    assert output.endswith('picture  robot.png\nprofile  robot.yaml\n')
    assert (tmp_path / 'robot.png').read_bytes().startswith(b'\x89PNG')
    profile, hardware = load_profile('./robot.yaml'), load_profile('hardware')
    plant = profile.of(PlantParameters)
    assert plant.dead_zone == pytest.approx(drawn_robot(1)['plant_sim', 'dead_zone'], abs=0.3)
    changed = {
        f'{node}.{name}' for node, name, value in profile
        if value != getattr(hardware.of_node(node), name)
    }  # fmt: skip
    assert changed == {*NAMES}
    run = bb.simulate('stationary', profile='robot.yaml', parameters={'plant_sim.duration': 2.0})
    assert run.metrics['peak_pitch_deg'] < 10.0
    # It is never overwritten, and can be what another one begins with.
    status, _, error = command('commission', *logs)
    assert status == 2
    assert error == 'error: --output robot.yaml: exists; choose another name\n'
    own = 'controller: {ros__parameters: {user.own: 3}}\n'
    (tmp_path / 'robot.yaml').write_text((tmp_path / 'robot.yaml').read_text() + own)
    assert command('commission', logs[0], '--profile', 'robot.yaml', '--output', 'a.yaml')[0] == 0
    again = load_profile('a.yaml')
    assert again.of(PlantParameters).voltage_slope == plant.voltage_slope
    assert again.undeclared == {'user.own': 3}


def test_json_has_the_same(command, logs, tmp_path):
    output = tmp_path / 'mine.yaml'
    status, text, _ = command('commission', *logs, '--json', '--output', output)
    assert status == 0
    found = json.loads(text)
    assert (*found['parameters'],) == NAMES
    assert len(found['checks']) == 6
    assert ['for a period of 300 s' in note for note in found['notes']] == [True]
    for name, each in found['parameters'].items():
        assert each['half_width'] > 0.0, name
        node, _, parameter = name.partition('.')
        written = getattr(load_profile(str(output)).of_node(node), parameter)
        assert written == pytest.approx(each['value'], rel=1e-5)
    gyro = GyroParameters()
    assert found['parameters']['gyro_driver.noise']['unit'] == 'deg/s'
    assert found['parameters']['gyro_driver.drift']['of_devices'].keys() == {'gyro x', 'gyro y'}
    assert load_profile(str(output)).of(GyroParameters).drift_period == gyro.drift_period


@pytest.mark.parametrize(
    ('words', 'told'),
    [
        ((), 'Missing argument'),
        (('{log}', '{log}'), 'a log is given twice: it would count twice'),
        (('{log}', '--profile', 'x'), "unknown profile 'x'; known: ideal, hardware, stand"),
        (('{log}', '--profile', './x.yaml'), 'x.yaml: No such file'),
        (('{log}', '--output', 'no/folder.yaml'), '--output no/folder.png: No such file or'),
        (('{log}', '--output', 'x.png'), '--output x.png: must end in .yaml'),
        (('{log}', '--output', '.'), '--output .: must end in .yaml'),
        (('{log}', '--output', 'x/'), 'x/: is a folder'),
        (('{empty}',), 'a data log without packets'),
        (('nothing.csv',), 'nothing.csv: No such file or directory'),
        (
            ('{log}', '--profile', 'stalled.yaml'),
            'a motor of the profile has no speed without load: plant_sim.torque_constant',
        ),
        (('{log}', '--profile', 'unbraked.yaml'), 'or back_emf_constant and motor_friction'),
    ],
)
def test_a_mistake_is_one_line(command, logs, tmp_path, monkeypatch, words, told):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'empty.csv').write_text(f'{HEADER}\n')
    (tmp_path / 'stalled.yaml').write_text('plant_sim: {ros__parameters: {torque_constant: 0.0}}\n')
    (tmp_path / 'unbraked.yaml').write_text(
        'plant_sim: {ros__parameters: {back_emf_constant: 0.0, motor_friction: 0.0}}\n'
    )
    files = {each.name for each in tmp_path.iterdir()}
    names = {'log': logs[0], 'empty': 'empty.csv'}
    status, output, error = command('commission', *[word.format(**names) for word in words])
    assert status == 2
    assert output == ''
    assert told in error
    assert error.count('\n') == 1
    assert {each.name for each in tmp_path.iterdir()} == files
