"""Properties of studies: columns, verdicts, and the same values as in single runs."""

import math
from dataclasses import replace
from typing import get_args, get_type_hints

import numpy as np
import pytest
from laws import refusal
from simulated_runs import compiled_simulator, spec_of
from tried_studies import carry_out, write

from ballbot_ros.engine.scenario.properties import DRIVE_MODES, OF_MOTION
from ballbot_ros.engine.scenario.property_language import parse_property
from ballbot_ros.engine.scenario.scenario import Expectation, Measure
from ballbot_ros.errors import StudyError
from ballbot_ros.lab.studies.columns import OTHERS, MeasureColumn
from ballbot_ros.lab.studies.job import passed
from ballbot_ros.lab.studies.reader import read_study
from ballbot_ros.lab.studies.rerun import rerun_spec
from ballbot_ros.lab.studies.runs import OrdinarySimulator, Results, Samples
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.run.execution import execute
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.spec import RunOptions, RunSpec

TEXTS = {
    'recovers': 'after each push: eventually within 0.3 s: always for 0.2 s: '
                'abs(pitch_x_deg) < 3 deg and abs(pitch_y_deg) < 3 deg',
    'gentle': 'until the first push: always: abs(duty_x_percent) < 60',
    'slow': 'always: abs(speed_x_m_per_s) < 0.3 and abs(speed_y_m_per_s) < 0.3',
    'remote': 'while remote: always: pitch_x_deg < 5',
    'autonomous': 'while autonomous: from 1.5 s: always: position_x_m > -0.1',
    'late': 'from 2 s: eventually: abs(pitch_x_deg) < 0.5 deg',
}  # fmt: skip
PROPERTIES = [parse_property(name, text) for name, text in TEXTS.items()]
READINGS = {
    'quiet': 'always: abs(gyro_x_deg_per_s - 600) < 100 and abs(gyro_y_deg_per_s - 600) < 90',
    'turned': 'always: -400 deg < encoder_x_deg and encoder_y_deg < 500 deg',
    'swinging': 'always: abs(pitch_rate_x_deg_per_s) < 200 and pitch_rate_y_deg_per_s < 100',
}
READ = [parse_property(name, text) for name, text in READINGS.items()]
CLEAR = parse_property('clear', 'always: wall_clearance_m > 0.05 m')


def test_the_drive_modes_are_those_of_the_parameter():
    assert get_args(get_type_hints(ControllerParameters)['mode']) == DRIVE_MODES


@pytest.mark.parametrize(
    ('name', 'values', 'events'),
    [
        ('push', {
            'plant_sim.body_mass': np.linspace(0.6, 0.75, 5),
            'controller.mode': np.array(['remote', 'autonomous', 'remote', 'remote', 'remote']),
            'plant_sim.duration': np.array([3.0, 3.0, 2.5, 3.0, 1.2]),
            'plant_sim.hold_time': np.array([1.0, 1.0, 1.1, 1.0, 1.0]),
         }, {'push.1.time': np.array([2.0, 2.0, 1.2, 1.7, 1.15])}),
        ('autonomous', {
            'plant_sim.body_width': np.array([0.1, 0.12, 0.12, 0.1]),
            'plant_sim.start_position_x': np.linspace(-0.72, -0.6, 4),
         }, {}),
    ],
)  # fmt: skip
def test_both_simulators_give_the_same_results(name, values, events):
    spec = spec_of(name)
    measures = [Measure('peak_pitch_deg'), *PROPERTIES, *([CLEAR] if name == 'autonomous' else [])]
    samples = Samples(len(next(iter(values.values()))), values, events=events)
    compiled = compiled_simulator(spec, measures).simulate(samples)
    ordinary = OrdinarySimulator(spec, measures).simulate(samples)
    # To the bit, unlike metrics.
    assert compiled.measured[:, 1:].tobytes() == ordinary.measured[:, 1:].tobytes()
    assert np.isfinite(compiled.measured[0, 3])
    if name == 'push':
        by_name = dict(zip(TEXTS, compiled.measured[:, 1:].T, strict=True))
        assert np.isinf(by_name['remote']).tolist() == [False, True, False, False, False]
        assert np.isinf(by_name['autonomous']).tolist() == [True, False, True, True, True]
        # The last run ends before its push does, and at 1.2 s.
        assert math.isinf(by_name['recovers'][4])
        assert math.isinf(by_name['late'][4])


def test_both_expectations_and_properties_decide():
    measured = np.array([[1.0, 0.0], [1.0, -0.1], [9.0, 1.0], [1.0, math.nan], [1.0, math.inf]])
    results = Results.empty(5, 2)._replace(measured=measured)
    measures = [Measure('peak_pitch_deg'), PROPERTIES[0]]
    expectation = Expectation('peak_pitch_deg', maximum=5.0)
    assert passed(results, measures, [expectation]).tolist() == [True, False, False, False, True]


def test_a_column_has_the_unit_and_the_text():
    column = MeasureColumn.of(PROPERTIES[1])
    assert (column.name, column.unit, column.minimum, column.maximum) == ('gentle', '%', 0.0, None)
    assert column.meaning == f'robustness of {TEXTS["gentle"]}'
    # The smallest is the worst.
    assert column.badness(np.array([1.0, -2.0])).tolist() == [-1.0, 2.0]


def test_readings_are_those_of_a_recording(tmp_path):
    options = RunOptions(
        processes=Processes.NONE, output=tmp_path / 'run', profile='hardware',
        assignments=('plant_sim.duration=3.5',),
    )  # fmt: skip
    spec = RunSpec.of_scenario('push', options)
    spec = replace(spec, scenario=replace(spec.scenario, properties=tuple(READ)))
    live = [each.robustness for each in execute(spec).properties]
    assert np.isfinite(live).all()
    samples = Samples(2, {'plant_sim.body_mass': np.array([spec.plant.body_mass] * 2)})
    for simulator in (compiled_simulator(spec, READ), OrdinarySimulator(spec, READ)):
        for row in simulator.simulate(samples).measured:
            assert row.tolist() == live


CONTENT = {
    'purpose': 'pushes of various strength',
    'scenario': 'push',
    'runs': 24,
    'parameters': {'plant_sim': {'duration': 6.0}},
    'vary': {'push.1.force': {'uniform': [0.5, 3.0]}},
    'metrics': ['peak_pitch_deg'],
    'properties': {name: TEXTS[name] for name in ('recovers', 'gentle', 'autonomous')},
}


@pytest.fixture(scope='module')
def data(tmp_path_factory):
    pytest.importorskip('pyarrow')
    folder = tmp_path_factory.mktemp('study')
    return carry_out(write(folder, {**CONTENT, 'expectations': {}}), folder / 'results')


def test_a_study_has_a_column_for_each_property(data):
    names = [each.name for each in data.study.measures]
    assert sorted(names) == ['autonomous', 'gentle', 'peak_pitch_deg', 'recovers']
    recovers, gentle = data.column('recovers'), data.column('gentle')
    assert data.column('passed').tolist() == ((recovers >= 0.0) & (gentle >= 0.0)).tolist()
    assert 0 < data.totals().passed < 24
    assert np.isnan(data.column('autonomous')).all()
    summary = {each.column.name: each for each in data.summary().measures}
    assert summary['recovers'].worst[0].value == recovers.min()
    assert summary['recovers'].quantiles[2] == np.median(recovers)
    assert summary['autonomous'].missing == 24


def test_a_run_of_a_study_gives_the_same_again(data, tmp_path):
    number = data.worst('recovers', 1)[0].number
    row = data.row(number)
    spec = rerun_spec(data.study, row, tmp_path / 'again', Processes.NONE)
    result = execute(replace(spec, record=False, output=None))
    found = {each.of.name: each.robustness for each in result.properties}
    assert (found['recovers'], found['gentle']) == (
        row.measures['recovers'], row.measures['gentle'],
    )  # fmt: skip
    assert found['autonomous'] == math.inf
    assert result.passed == row.passed


def test_which_requirements_a_study_has(tmp_path):
    scenario = tmp_path / 'pushed.yaml'
    scenario.write_text(
        'purpose: x\nduration: 5\nexpectations: {peak_pitch_deg: {max: 3}}\n'
        'properties: {upright: "always: pitch_x_deg < 5"}\n'
    )
    base = {
        'purpose': 'x', 'scenario': str(scenario), 'runs': 3,
        'vary': {'plant_sim.body_mass': {'uniform': [0.6, 0.7]}},
    }  # fmt: skip
    own = {'properties': {'mine': 'always: pitch_y_deg < 5'}}
    for more, properties in (
        ({}, ['upright']),
        (own, ['mine']),
        # Its own expectations take the place of all that the scenario asks for.
        ({'expectations': {'peak_pitch_deg': {'max': 2.0}}}, []),
    ):
        study = read_study(str(write(tmp_path, {**base, **more})))
        assert [each.name for each in study.properties] == properties
        assert study.common_scenario[0].properties == study.properties
    path = write(tmp_path, {**base, 'properties': {'mine': 'always: distance_m > 0.1'}})
    line = next(n for n, text in enumerate(path.read_text().splitlines(), 1) if 'mine' in text)
    assert refusal(StudyError, read_study, str(path)) == (
        f"{path}:{line}: 'mine': studies lack distance_m; known: {', '.join((*OF_MOTION, *OTHERS))}"
    )
