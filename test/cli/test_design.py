"""`ballbot design`: both loops side by side, as tables, JSON and picture."""

import json
import re
import warnings

import pytest

from ballbot_ros.analysis.loop_figure import loop_table
from ballbot_ros.design.loop_analysis import analyse_ideal, analyse_sampled
from ballbot_ros.parameters import ParameterSet

PNG = b'\x89PNG\r\n\x1a\n'


def words(command, *arguments):
    status, stdout, stderr = command('design', *arguments)
    assert (status, stderr) == (0, '')
    return stdout


def cells(text, name):
    """Return the cells of a row of a table."""
    (row,) = [line for line in text.splitlines() if line.strip('│ ').startswith(f'{name} ')]
    return [cell.strip() for cell in row.strip('│').split('│')][1:]


def content(command, *arguments):
    return json.loads(words(command, '--json', *arguments))


def test_both_loops_stand_side_by_side(command):
    text = words(command)
    ideal, sampled = analyse_ideal(ParameterSet()), analyse_sampled(ParameterSet())
    (heading,) = [line for line in text.splitlines() if 'ideal, continuous' in line]
    assert heading.index('ideal, continuous') < heading.index('as it runs')
    assert cells(text, 'gain') == ['0.495 … ∞', '0.523 … 1.05', '0.343 Hz … 125 Hz']
    delays = [f'{each.margins.dead_time_ms.value:.3g} ms' for each in (ideal, sampled)]
    assert cells(text, 'dead time, motors')[:2] == delays
    assert cells(text, 'dead time, encoders') == ['–', '0.93 ms', '125 Hz']
    assert 'Rings at 125 Hz: pole −0.9374, damping 0.0206.' in text
    assert '1.05 times the gain: oscillates at 125 Hz.' in text
    assert re.search(r'encoder\s+55\.5 %', text)
    assert max(map(len, text.splitlines())) <= 80


def test_json_has_what_the_tables_have(command):
    found = content(command)
    sampled = analyse_sampled(ParameterSet())
    assert found['as_it_runs']['stable']
    assert found['as_it_runs']['margins']['gain_high'] == sampled.margins.gain_high._asdict()
    assert found['ideal']['margins']['gain_high'] == {'value': None, 'hz': None}
    assert len(found['as_it_runs']['poles']) == len(sampled.poles) == 7
    samples = found['as_it_runs']['samples']
    assert samples['duty_percent_per_gyro_count'] == sampled.samples.gyro_noise
    assert samples['encoder_dead_time_ms'] == sampled.samples.encoder_dead_time_ms._asdict()
    assert found['ideal']['samples'] is None
    assert found['gains']['in_use'] == pytest.approx(found['gains']['computed'], rel=1e-6)
    assert found['neglected'] == []


def test_an_unstable_loop_says_where_it_grows(command):
    text = words(command, '--set', 'plant_sim.actuator_delay=4')
    assert cells(text, 'gain') == ['0.495 … ∞', 'not stable', '']
    assert 'Unstable: pole 0.1299 ± 1.116j grows at 57.9 Hz.' in text
    found = content(command, '--set', 'plant_sim.actuator_delay=4')
    assert found['delays_ms'] == {'actuator': 4.0, 'gyro': 0.0, 'encoder': 0.0}
    assert not found['as_it_runs']['stable']
    assert found['as_it_runs']['margins'] is None


@pytest.mark.parametrize('assignment', ['plant_sim.gravity=0', 'plant_sim.torque_constant=0'])
def test_a_robot_without_a_servo_design_still_has_a_loop(command, assignment):
    text = words(command, '--set', assignment)
    assert 'section 4.2 gives no gains: the system is not controllable' in text
    assert cells(text, 'θ')[0] == '–'
    assert cells(text, 'gain')
    found = content(command, '--set', assignment)
    assert found['gains']['computed'] is None
    assert found['as_it_runs']['poles']


def test_a_robot_that_only_falls_does_not_oscillate(command):
    text = words(command, '--set', 'plant_sim.voltage_slope=0')
    assert 'Unstable: pole 1.025 grows.' in text


@pytest.mark.parametrize('assignment', [
    'plant_sim.body_mass=1e-6', 'plant_sim.wheel_radius=1', 'controller.pwm_gain=100',
    'plant_sim.voltage_slope=0', 'plant_sim.ball_radius=0.001', 'controller.k_i=-1e-7',
    'controller.k_f=[1e9,1e9,1e9,1e9]',
])  # fmt: skip
def test_no_robot_makes_libraries_complain(command, tmp_path, assignment):
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        words(command, '--set', assignment, '--plot', tmp_path / 'loop.png')


def test_a_long_dead_time_does_not_fill_the_screen(command):
    text = words(command, '--set', 'plant_sim.actuator_delay=100')
    assert len(text.splitlines()) < 60
    assert re.search(r'^\d+ more decay faster', text, re.MULTILINE)
    assert (
        len(content(command, '--set', 'plant_sim.actuator_delay=100')['as_it_runs']['poles']) > 25
    )


def test_a_motion_that_never_decays_is_named(command):
    text = words(command, '--set', 'controller.a_gd=1')
    assert 'Not stable: what belongs to the pole 1 never decays.' in text


def test_what_the_linear_model_leaves_out_is_named(command):
    assignments = [
        'plant_sim.dead_zone=2', 'plant_sim.backlash=0.03', 'plant_sim.battery_model=draining',
        'controller.pwm_offset=1', 'encoder_driver.delay_jitter=1',
    ]  # fmt: skip
    found = content(command, *[word for each in assignments for word in ('--set', each)])
    assert found['neglected'] == [
        'the dead zone', 'the gear play', 'pwm_offset', 'the draining battery',
        'the variation of the dead times (jitter), which count with their means',
    ]  # fmt: skip


def test_the_loop_of_another_controller_is_not_guessed(command):
    text = words(command, '--set', 'controller.implementation=pid')
    assert "The loop is known for the document's program only, not for pid." in text
    assert 'as it runs' not in text
    found = content(command, '--set', 'controller.implementation=pid')
    assert (found['ideal'], found['as_it_runs']) == (None, None)


@pytest.mark.parametrize('assignments', [(), ('--set', 'controller.pwm_gain=1.2')])
def test_the_picture_is_written(command, tmp_path, assignments):
    path = tmp_path / 'loop.png'
    assert words(command, '--plot', path, *assignments).endswith(f'plot  {path}\n')
    assert path.read_bytes().startswith(PNG)


def test_the_responses_of_the_picture_are_alike_below_one_hertz_and_differ_above():
    table = loop_table(ParameterSet())
    for frequency, ratio in ((0.2, (0.95, 1.0)), (50.0, (10.0, 100.0))):
        index = int(abs(table['frequency_hz'] - frequency).argmin())
        low, high = ratio
        assert low < table['sampled_gain'][index] / table['ideal_gain'][index] < high


@pytest.mark.parametrize(('arguments', 'expected'), [
    (['--plot', '/nowhere/loop.png'], '--plot /nowhere/loop.png: No such file or directory'),
    (['--plot', 'x/'], 'x/: is a folder; name a file to write'),
    (['--set', 'plant_sim.actuator_delay=101'], '101 is not within 0 … 100 ms'),
    (['--set', 'encoder_driver.delay=1.5'], '1.5 is not a whole number'),
    (['--set', 'controller.implementation=pid', '--plot', 'x.png'], "document's program only"),
    (['--controller', 'lqg', '--json'], 'omit --plot and --json'),
    (['--params', '/nowhere.yaml'], '/nowhere.yaml'),
])  # fmt: skip
def test_mistakes_are_one_line(command, tmp_path, monkeypatch, arguments, expected):
    monkeypatch.chdir(tmp_path)
    status, stdout, stderr = command('design', *arguments)
    assert (status, stdout) == (2, '')
    assert expected in stderr
    assert stderr.count('\n') == 1
    assert list(tmp_path.iterdir()) == []
