"""`ballbot identify`: tables of verdicts, values and residuals, JSON, picture, parameter file."""

import json
import re

import numpy as np
import pytest
from graph import call
from recordings import copy_recording

import ballbot_ros as bb
from ballbot_ros.analysis.data_log import read_data_log, write_data_log
from ballbot_ros.analysis.identification.identification import (
    HARD_TO_MEASURE,
    ExperimentSummary,
    Identifiability,
    Identification,
    IdentifiedParameter,
)
from ballbot_ros.cli.identify_output import MAX_RATIO, IdentifyOutput, with_interval
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.parameters.files import read_parameter_file
from ballbot_ros.recording.csv_log import HEADER
from ballbot_ros.recording.reader import RecordingReader

PNG = b'\x89PNG\r\n\x1a\n'
MASS = 0.75
HEIGHT = 0.16
FIT = '--truth', '--fit=body_mass,ball_friction'


@pytest.fixture(scope='module')
def recordings(tmp_path_factory):
    """Return two recordings of one robot, and one of a robot held still."""
    folder = tmp_path_factory.mktemp('recordings')
    runs = {
        'heavy': {'body_mass': MASS},
        'heavy_too': {'body_mass': MASS, 'start_pitch_y': 0.03},
        'still': {'hold_time': 60.0},
    }
    return {
        name: simulated(folder / name, 'stationary', duration=12.0, **plant)
        for name, plant in runs.items()
    }


def simulated(folder, scenario, **plant):
    """Return the recording of a run, made in this process."""
    folder.mkdir()
    parameters = {f'plant_sim.{name}': value for name, value in plant.items()}
    return bb.simulate(scenario, parameters=parameters).save(folder / f'{scenario}.mcap')


@pytest.fixture(scope='module')
def logs(tmp_path_factory):
    """Return two data logs of one robot that is driven, and one of a robot held still."""
    folder = tmp_path_factory.mktemp('logs')
    runs = {
        'low': ('excitation', {'body_height': HEIGHT, 'duration': 24.0}),
        'low_too': ('excitation', {'body_height': HEIGHT, 'duration': 8.0}),
        'still_log': ('stationary', {'hold_time': 60.0}),
    }
    return {
        name: data_log(folder / name, scenario, **plant) for name, (scenario, plant) in runs.items()
    }


def data_log(folder, scenario, **plant):
    with RecordingReader(simulated(folder, scenario, **plant)) as reader:
        (path,) = write_data_log(read_data_log(reader), folder / 'log.csv')
    return path


def rows(text):
    """Return the cells of the rows of all tables."""
    lines = [line for line in text.splitlines() if line.startswith('│')]
    return [[cell.strip() for cell in line.strip('│').split('│')] for line in lines]


@pytest.fixture(scope='module')
def identified(recordings, tmp_path_factory):
    """Return what the command prints, and the folder of the files that it writes."""
    folder = tmp_path_factory.mktemp('identified')
    words = (
        'identify', recordings['heavy'], *FIT, '--check', recordings['heavy_too'],
        '--set=plant_sim.ball_friction=0.001',
        '--output', folder / 'found.yaml', '--plot', folder / 'found.png',
    )  # fmt: skip
    done = call(*words)
    assert (done.returncode, done.stderr) == (0, '')
    return done.stdout, folder


def test_tables_of_verdicts_values_and_residuals(identified):
    text, _ = identified
    verdicts, values, residuals = map(rows, text.split('┏')[1:])
    assert [row[:2] for row in verdicts] == [
        ['body_mass', 'identified'], ['ball_friction', 'identified'],
    ]  # fmt: skip
    assert [row[0] for row in values] == ['body_mass', 'ball_friction']
    assert values[0][1].startswith('0.75 ± ')
    assert [row[4] for row in values] == ['0.682', '0.001']
    assert values[0][5].startswith('0.75 ')
    assert [row[0] for row in residuals if row[0]] == ['1 fitted', '2 checked with']
    assert [row[1] for row in residuals[:3]] == ['pitch rate', 'pitch', 'position']
    assert re.match(
        r'1  \S+heavy/stationary.mcap  fitted: \d+\.\d s in \d+ segments(, \d+ dropped)?\n', text
    )


def test_nothing_is_written_if_nothing_is_identified(command, recordings, tmp_path):
    output, plot = tmp_path / 'found.yaml', tmp_path / 'found.png'
    status, text, stderr = command(
        'identify', recordings['still'], '--output', output, '--plot', plot, '--json'
    )
    assert status == 2
    assert 'scenario `excitation`' in stderr
    assert len(stderr.splitlines()) == 1
    found = json.loads(text)
    assert set(found['parameters']) == set(HARD_TO_MEASURE)
    assert found['parameters']['body_mass']['relative'] is None
    assert not output.exists()
    assert not plot.exists()


def test_the_output_gives_a_run_the_identified_robot(command, identified, recordings, tmp_path):
    text, folder = identified
    output, plot = folder / 'found.yaml', folder / 'found.png'
    assert f'plot  {plot}\nparameters  {output}\n' in text
    assert plot.read_bytes().startswith(PNG)
    first, *_ = output.read_text().splitlines()
    fit = '--fit=body_mass --fit=ball_friction'
    more = f'--check={recordings["heavy_too"]} --truth --set=plant_sim.ball_friction=0.001'
    assert first == f'# ballbot identify {recordings["heavy"]} {fit} {more}'
    found = read_parameter_file(output)
    assert found.of(PlantParameters).body_mass == pytest.approx(MASS, rel=1e-3)
    assert {name for _, name, _ in found} == {'body_mass', 'ball_friction'}
    status, _, stderr = command(
        'run', 'stationary', '--processes=none', '--params', output,
        '--set=plant_sim.duration=0.1', '--output', tmp_path / 'run',
    )  # fmt: skip
    assert stderr == ''
    assert status in (0, 1)


@pytest.mark.slow
def test_a_data_log_tells_the_height_and_says_what_it_cannot_tell(command, logs, tmp_path):
    output = tmp_path / 'found.yaml'
    status, text, stderr = command(
        'identify', logs['low'], '--check', logs['low_too'], '--output', output,
        '--set=plant_sim.backlash=0.0698', '--fit=torque_constant,body_height,dead_zone',
    )  # fmt: skip
    assert (status, stderr) == (0, '')
    assert text.count('A data log has no duties') == 2
    verdicts, values, residuals = map(rows, text.split('┏')[1:])
    assert [row[1] for row in verdicts] == ['not seen', 'identified', 'not seen']
    (height,) = values
    assert height[0] == 'body_height'
    assert [row[1] for row in residuals] == 2 * ['estimated pitch', 'encoder']
    found = read_parameter_file(output)
    assert {name for _, name, _ in found} == {'body_height'}
    assert found.of(PlantParameters).body_height == pytest.approx(HEIGHT, rel=0.04)
    assert float(height[2].strip('± ')) < 7.0


def test_the_log_of_a_robot_at_rest_tells_nothing(command, logs):
    status, text, stderr = command('identify', logs['still_log'])
    assert status == 2
    assert [row[1] for row in rows(text)] == ['not seen'] * len(HARD_TO_MEASURE)
    assert 'an identification needs 20 s' in text
    assert 'nothing was identified' in stderr


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['{heavy}', '--fit=body_mas'], 'did you mean body_mass?'),
        (['{heavy}', '--fit=,'], "',' names nothing"),
        (['{heavy}', '--fit=body_mass', '--fit=body_mass'], 'body_mass is given twice'),
        (['{heavy}', '{heavy}'], 'is given twice'),
        (['{heavy}', '--check={heavy}'], 'is fitted, too; check with a recording that is not'),
        (['{heavy}', '{still}', '--run=1'], '--run needs exactly one recording'),
        (['{heavy}', '--run=2'], 'run 2 not found; the file has run 1'),
        (['{heavy}', '--set=controller.k_i=1'], 'takes parameters of plant_sim only'),
        (['missing.mcap'], 'missing.mcap: No such file'),
        (['missing.csv'], 'missing.csv: No such file'),
        (['{low}', '--run=1'], '--run needs exactly one recording'),
        (['{low}', '--truth'], 'a data log has no true states'),
        (['{low}', '{heavy}'], 'files with and without duties cannot be fitted together'),
        (['{binary}'], 'not a data log: it is not ASCII text'),
        (['{table}'], "not a data log: its first line must be 'Time,Data1"),
        (['{empty}'], 'a data log without packets'),
        (['{text}'], 'not an MCAP file'),
        (['{bare}'], 'was not recorded'),
        ([], 'Missing argument'),
    ],
)  # fmt: skip
def test_a_mistake_ends_with_one_line(command, recordings, logs, tmp_path, words, message):
    output, text = tmp_path / 'found.yaml', tmp_path / 'text.mcap'
    text.write_text('no recording')
    bare = tmp_path / 'bare.mcap'
    if '{bare}' in words:
        copy_recording(bare, recordings['heavy'], wanted=lambda topic: 'joint_states' not in topic)
    contents = {'binary': b'\xff', 'table': b'a,b\n1,2\n', 'empty': f'{HEADER}\n'.encode()}
    files = {name: tmp_path / f'{name}.csv' for name in contents}
    for name, content in contents.items():
        files[name].write_bytes(content)
    paths = {**recordings, **logs, **files, 'text': text, 'bare': bare}
    status, stdout, stderr = command(
        'identify', *(word.format(**paths) for word in words), f'--output={output}'
    )
    assert (status, stdout) == (2, '')
    assert message in stderr
    assert len(stderr.splitlines()) == 1
    assert not output.exists()


@pytest.mark.parametrize(
    ('value', 'half_width', 'text'),
    [
        (0.7512, 0.0123, '0.751 ± 0.012'),
        (0.75, 0.0996, '0.75 ± 0.10'),
        (123.4, 25.0, '123 ± 25'),
        (-0.021, 0.05, '−0.021 ± 0.050'),
        (1.0034e-5, 1.2e-7, '(1.003 ± 0.012)e−5'),
        (0.0, 0.01, '0.000 ± 0.010'),
        (0.75, float('inf'), '0.75 ± ∞'),
        (0.75, 1.94e-13, '0.75 ± 1.9e−13'),
    ],
)
def test_an_interval_has_two_digits_and_the_value_ends_there(value, half_width, text):
    assert with_interval(value, half_width) == text


def parameter(name, verdict, value, half_width=0.1, **more):
    start = getattr(PlantParameters(), name)
    return IdentifiedParameter(name, '%', verdict, start, value, half_width, half_width, **more)


def experiment(name, gyro, encoder):
    residuals = {'gyro': gyro, 'encoder': encoder}
    units = {'gyro': 'deg/s', 'encoder': 'deg'}
    return ExperimentSummary(name, 5.0, 10, 1, residuals, residuals, units, ('A note.',))


def identification(*parameters, checks=()):
    size = sum(row.value is not None for row in parameters)
    return Identification(
        parameters, (experiment('fit.mcap', 1.0, 1.0),), tuple(checks),
        np.eye(size),
    )  # fmt: skip


def test_every_verdict_has_its_reason(capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', '80')
    IdentifyOutput(
        identification(
            parameter('dead_zone', Identifiability.IDENTIFIED, 4.0, recorded=4.05),
            parameter('body_mass', Identifiability.UNCERTAIN, 0.7, 0.125, recorded=0.9),
            parameter(
                'wheel_mass', Identifiability.NOT_TOLD_APART, None, alike=('dead_zone', 'body_mass')
            ),
            parameter('gravity', Identifiability.NOT_TOLD_APART, None),
            parameter('ball_mass', Identifiability.NOT_SEEN, None, 0.5),
            parameter('ball_radius', Identifiability.NOT_SEEN, None, float('inf')),
            parameter('motor_inertia', Identifiability.NOT_SEEN, None, 12.0),
        )
    ).print()
    text = capsys.readouterr().out
    verdicts, values, _ = map(rows, text.split('┏')[1:])
    assert [row[2] for row in verdicts] == [
        '± 10 %', '± 12.5 %, more than 10 %', 'acts like dead_zone, body_mass',
        'acts like several together', '± 50 % as the only unknown',
        'no trace in the readings', '> ± 1000 % as the only unknown',
    ]  # fmt: skip
    assert [row[3] for row in verdicts] == ['', '', '0.015', '9.81', '0.013', '0.026', '1e−5']
    assert [row[5] for row in values] == ['4.05 ✓', '0.9 ✗']
    assert max(map(len, text.splitlines())) <= 80
    assert '1  fit.mcap  fitted: 5.0 s in 10 segments, 1 dropped\n   A note.\n' in text


def test_json_has_what_the_tables_have():
    row = parameter('dead_zone', Identifiability.IDENTIFIED, 4.0, recorded=4.05)
    checks = [experiment('other.mcap', 2.0, 2.0)]
    output = IdentifyOutput(identification(row, checks=checks))
    found = output.as_json()
    assert set(found) == {'parameters', 'recordings', 'checks', 'warnings', 'engine', 'correlation'}
    told = found['parameters']['dead_zone']
    names = ('verdict', 'start', 'value', 'recorded', 'unit')
    assert [told[name] for name in names] == ['identified', row.start, 4.0, 4.05, '%']
    (recording,), (check,) = found['recordings'], found['checks']
    assert recording['residuals'].keys() == {'gyro', 'encoder'}
    assert check['recording'] == 'other.mcap'
    assert found['warnings'] == output.warnings
    assert found['correlation'] == {'names': ['dead_zone'], 'matrix': [[1.0]]}


def test_a_value_below_its_bound_is_written_as_the_bound():
    output = IdentifyOutput(identification(
        parameter('dead_zone', Identifiability.IDENTIFIED, -0.02),
        parameter('body_mass', Identifiability.UNCERTAIN, 0.7),
    ))  # fmt: skip
    assert output.corrections == ['dead_zone is below its bound: the file has 0']
    assert '{dead_zone: 0.0}' in output.parameter_file()
    assert output.as_json()['parameters']['dead_zone']['allowed'] == 0.0


def test_checks_whose_residuals_are_much_larger_are_named():
    row = parameter('dead_zone', Identifiability.IDENTIFIED, 1.0)
    alike, other = experiment('alike.mcap', 1.0, 1.7), experiment('other.mcap', 2.0, 2.0)
    assert IdentifyOutput(identification(row, checks=[alike])).warnings == []
    (line,) = IdentifyOutput(identification(row, checks=[alike, other])).warnings
    assert f'other.mcap are 2 times those of the fit, more than {MAX_RATIO:g}' in line
    assert 'the values do not describe this recording' in line
