"""`ballbot design`: both loops side by side, as tables, JSON and picture."""

import json
import re
import warnings

import pytest

from ballbot_ros.analysis.loop_figure import loop_table
from ballbot_ros.controllers.codegen.implementation import compose_controller
from ballbot_ros.controllers.design.loop_analysis import analyse_ideal, analyse_sampled
from ballbot_ros.parameters import ControllerParameters, ParameterSet
from ballbot_ros.parameters.files import read_parameter_file

DELAY = 'plant_sim.actuator_delay=8'
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


def test_another_period_has_other_margins(command):
    document = content(command, '--period', '2')
    assert document['as_it_runs']['margins']['dead_time_ms']['value'] == pytest.approx(
        3.74, abs=0.01
    )
    assert 'Poles of the loop that runs, every 6 ms' in words(command, '--period', '6')


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


POLES = '-0.3,-0.6+0.6j,-0.6-0.6j,-5,-7'


@pytest.mark.parametrize('arguments', [
    ('--method', 'lqr', '--r', '1e8'),
    ('--method', 'dlqr'),
    ('--method', 'dlqr', '--q', '1, 6e5, 1, 1, 1e3', '--delay', '4'),
    ('--method', 'place', f'--poles={POLES}'),
])  # fmt: skip
def test_the_designed_gains_are_analysed_and_written(command, tmp_path, arguments):
    path = tmp_path / 'gains.yaml'
    found = content(command, *arguments, '--output', path)
    own = read_parameter_file(path).of(ControllerParameters)
    assert found['gains']['in_use'] == [*own.k_f, own.k_i]
    assert found['gains']['in_use'] != pytest.approx(list(found['gains']['computed']), rel=0.01)
    assert found['as_it_runs']['stable']
    assert found['as_it_runs'] == content(command, '--params', path)['as_it_runs']


def test_a_redesign_is_shown_beside_the_documents(command, tmp_path):
    path = tmp_path / 'gains.yaml'
    text = words(command, '--method', 'dlqr', '--set', 'controller.a_r=0.99', '--output', path)
    (heading,) = [line for line in text.splitlines() if 'published' in line]
    assert 'designed' in heading
    assert 'in use' not in heading
    assert cells(text, 'θ')[0] == '-0.01504899'
    own = read_parameter_file(path).of(ControllerParameters)
    assert cells(text, 'θ')[2] == f'{own.k_f[0]:.8f}'
    assert text.endswith(f'gains  {path}\n')
    assert path.read_text(encoding='utf-8').splitlines() == [
        '# ballbot design --set=controller.a_r=0.99 --method=dlqr',
        '/**/controller:',
        '  ros__parameters:',
        f'    k_f: [{", ".join(map(str, own.k_f))}]',
        f'    k_i: {own.k_i}',
        '    a_d: 0.8',
        '    a_r: 0.99',
        '    a_gd: 0.999',
    ]


def test_the_lqr_with_the_documents_weights_gives_its_gains(command):
    found = content(command, '--method', 'lqr')['gains']
    assert found['in_use'] == pytest.approx(found['computed'], rel=1e-7)


def test_a_design_for_a_dead_time_bears_more_of_it(command):
    plain, late = (
        content(command, '--method', 'dlqr', '--set', 'plant_sim.actuator_delay=70', *delay)
        for delay in (('--delay', '0'), ())
    )
    assert late['as_it_runs']['stable']
    assert not plain['as_it_runs']['stable']


def test_the_lqg_for_a_dead_time_is_a_parameter_file(command, tmp_path):
    path = tmp_path / 'lqg.yaml'
    arguments = ('--method', 'lqg', '--q', '0.01,1,4,25,100', '--r', '4', '--delay', '12')
    assert words(command, *arguments, '--output', path) == ''
    assert words(command, *arguments) == path.read_text(encoding='utf-8')
    parameters = read_parameter_file(path)
    compose_controller(parameters)
    values = parameters.of(ControllerParameters).values()
    assert values['implementation'] == 'lqg'
    scales = ('theta', 'psi', 'theta_dot', 'psi_dot', 'integral', 'voltage')
    assert [values[f'user.{name}_scale'] for name in scales] == [10.0, 1.0, 0.5, 0.2, 0.1, 0.5]
    assert values['user.actuator_delay'] == 12.0
    assert len(values['user.lead']) == 4 * (4 + 3)


def test_the_lqg_is_designed_for_the_robot_and_its_dead_time(command, tmp_path):
    def values(*arguments):
        path = tmp_path / f'{len(list(tmp_path.iterdir()))}.yaml'
        words(command, '--method', 'lqg', *arguments, '--output', path)
        assert path.read_text(encoding='utf-8').startswith('# ballbot design --')
        parameters = read_parameter_file(path)
        compose_controller(parameters)
        return parameters.of(ControllerParameters).values()

    usual = values()
    heavy = values('--set', 'plant_sim.body_mass=0.9')
    assert heavy['model.body_mass'] == 0.9
    assert heavy['user.feedback'] != usual['user.feedback']
    late = ('--set', 'plant_sim.actuator_delay=6')
    assert values(*late)['user.actuator_delay'] == 6.0
    assert values(*late, '--delay', '2')['user.actuator_delay'] == 2.0
    own = ('--set', 'controller.user.actuator_delay=3.0', '--set', 'controller.model.body_mass=0.7')
    chosen = values('--set', 'plant_sim.body_mass=0.9', *late, *own)
    assert (chosen['user.actuator_delay'], chosen['model.body_mass']) == (3.0, 0.7)


@pytest.mark.parametrize('name', ['new\nline.yaml', '\udcff.yaml'])
def test_a_file_of_any_name_can_be_named_in_the_first_line(command, tmp_path, name):
    base, path = tmp_path / name, tmp_path / 'gains.yaml'
    base.write_text('controller: {ros__parameters: {a_d: 0.9}}')
    words(command, '--params', base, '--method', 'lqr', '--output', path)
    assert read_parameter_file(path).of(ControllerParameters).a_d == 0.9


def test_a_run_takes_the_designed_gains(command, tmp_path):
    path = tmp_path / 'gains.yaml'
    words(command, '--method', 'dlqr', '--delay', '8', '--output', path)
    run = ('run', 'stationary', '--processes', 'none', '--no-record', '--json', '--set', DELAY)
    duties = [
        json.loads(command(*run, *parameters)[1])['metrics']['duty_rms_percent']
        for parameters in ((), ('--params', path))
    ]
    assert duties[1] < 0.5 * duties[0]


@pytest.mark.parametrize(('arguments', 'expected'), [
    (['--method', 'dlqr', '--q', '1,2,3'], "'1,2,3': 5 numbers are needed, not 3"),
    (['--method', 'dlqr', '--q=-1,1,1,1,1'], "'-1' is not 0 or within 1e-20 … 1e20"),
    (['--method', 'lqr', '--r', '0'], "'--r': '0' is not within 1e-20 … 1e20"),
    (['--method', 'lqr', '--r', 'nan'], "'--r': 'nan' is not within 1e-20 … 1e20"),
    (['--method', 'dlqr', '--delay', 'nan'], "'--delay': 'nan' is not within 0 … 100 ms"),
    (['--method', 'place'], '--method place needs --poles'),
    (['--method', 'place', '--poles=-1,-2,x,-4,-5'], "'x' is not a pole, such as -7+5j"),
    (['--method', 'place', '--poles=-1,-2,-3,-4,5'], 'the pole 5 1/s needs a real part below'),
    (['--method', 'place', '--poles=-1,-2,-3,-4,-9+1j'], 'the pole -9+1j 1/s needs its conjugate'),
    (['--method', 'place', '--poles=-1,-2,-30,-40,-50'], 'no design: the motion of a pole at'),
    (['--method', 'place', f'--poles={POLES}', '--r=1'], '--r: --method place takes --poles'),
    (['--method', 'place', f'--poles={POLES}', '--set=controller.pwm_gain=0'], 'cannot be placed'),
    (['--method', 'dlqr', '--output', 'x.yaml', '--plot', '/nowhere/x.png'], '--plot /nowhere/x'),
    (['--method', 'lqr', '--delay', '3'], '--delay: --method lqr takes --q, --r'),
    (['--delay', '3'], '--delay needs --method'),
    (['--period', '2', '--method', 'lqr'], '--period only analyses: omit --method, --controller'),
    (['--period', '0.5'], "'--period': 0.5 is not in the range 1.0<=x<=20.0"),
    (['--output', 'x.yaml'], '--output needs --method or --controller'),
    (['--method', 'dlqr', '--output', '/nowhere/x.yaml'], '--output /nowhere/x.yaml: No such file'),
    (['--method', 'dlqr', '--controller', 'lqg'], 'omit --method'),
    (['--method', 'lqg', '--q', '0,1,1,1,1'], '--q: --method lqg needs weights above 0'),
    (['--method', 'lqg', '--json'], '--method lqg prints a parameter file: omit --plot and --json'),
    (['--method', 'nope'], "'nope' is not one of 'lqr', 'dlqr', 'place', 'lqg'"),
    (['--method', 'dlqr', '--set', 'plant_sim.torque_constant=0'], 'is not controllable'),
    (['--method', 'lqr', '--set', 'controller.implementation=pid'], "document's program only"),
    (['--method', 'dlqr', '--set', 'controller.a_gd=1'], 'no gains are found with which the loop'),
    (['--plot', '/nowhere/loop.png'], '--plot /nowhere/loop.png: No such file or directory'),
    (['--plot', 'x/'], 'x/: is a folder; name a file to write'),
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
