"""Pushes and sticks that vary, and the runs of a study as scenarios."""

from dataclasses import replace

import numpy as np
import pytest
from laws import refusal
from study_reruns import rerun_of

from ballbot_ros.engine.scenario.scenario import ScheduledPush
from ballbot_ros.errors import BallbotError, StudyError
from ballbot_ros.lab.studies.programs import with_values
from ballbot_ros.lab.studies.reader import read_study
from ballbot_ros.lab.studies.runs import OrdinarySimulator, scenarios_of_runs, simulator_for
from ballbot_ros.lab.studies.sampling import Sampler
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.robot.brick.faults import KINDS, OWN_TASK, TASKS
from ballbot_ros.run.execution import execute

PUSHES = """purpose: x
scenario: push
profile: hardware
parameters: {plant_sim: {duration: 16}}
runs: 50
vary:
  push.1.force: {uniform: [0.0, 3.0]}
  push.1.direction: {uniform: [-180.0, 180.0]}
  push.2.time: {uniform: [5.0, 6.0]}
  push.3.duration: {uniform: [0.05, 0.3]}
  plant_sim.body_mass: {uniform: [0.6, 0.8]}
  controller.k_f.2: {uniform: [-1.7, -1.5]}
expectations:
  peak_pitch_deg: {max: 5.0}
  peak_position_m: {max: 0.2, from: 3.0, to: 7.0}
"""
STICKS = """purpose: x
scenario: square
runs: 20
vary:
  stick.vertical.forward.value: {list: [-100, -50, 30]}
  stick.vertical.backward.from: {uniform: [20.0, 21.0]}
  stick.horizontal.right.to: {uniform: [13.0, 15.0]}
  plant_sim.duration: {uniform: [34.0, 36.0]}
expectations: {peak_pitch_deg: {max: 5.0}}
"""


@pytest.fixture(scope='module')
def study_of(tmp_path_factory):
    def study(text):
        path = tmp_path_factory.mktemp('studies') / 'mine.yaml'
        path.write_text(text)
        return read_study(str(path))

    return study


def row_of(samples, run):
    return {name: column[run] for name, column in {**samples.values, **samples.events}.items()}


def test_a_push_keeps_everything_but_what_varies(study_of):
    study = study_of(PUSHES)
    samples = Sampler(study).part(0, 5)
    before = study.spec.scenario.pushes
    for run, scenario in enumerate(scenarios_of_runs(study.spec, samples)):
        row = row_of(samples, run)
        one, two, three, four = scenario.pushes
        assert one == ScheduledPush(
            before[0].time,
            before[0].duration,
            force=row['push.1.force'],
            direction=row['push.1.direction'],
        )
        assert two.time == row['push.2.time']
        assert two.components == before[1].components
        assert three.duration == row['push.3.duration']
        assert four == before[3]


def test_a_segment_keeps_everything_but_what_varies(study_of):
    study = study_of(STICKS)
    samples = Sampler(study).part(0, 5)
    for run, scenario in enumerate(scenarios_of_runs(study.spec, samples)):
        row = row_of(samples, run)
        forward, backward = scenario.vertical.segments
        value = row['stick.vertical.forward.value']
        assert forward.points == ((2.0, value), (6.0, value))
        assert backward.points == ((row['stick.vertical.backward.from'], 100.0), (24.0, 100.0))
        assert scenario.horizontal.segments[0].end == row['stick.horizontal.right.to']
        assert scenario.horizontal.segments[1] == study.spec.scenario.horizontal.segments[1]


def test_what_a_run_cannot_have_is_refused_with_its_number(study_of):
    pushes, sticks = study_of(PUSHES), study_of(STICKS)
    for study, name, value, told in (
        (pushes, 'push.2.time', 16.0, 'push.2: a push begins after the end of the run (run 12)'),
        (pushes, 'push.3.duration', 0.0, 'push.3: must last longer than 0 s (run 12)'),
        (
            sticks,
            'stick.vertical.backward.from',
            25.0,
            'stick.vertical.backward: time goes back from 25 to 24 s (run 12)',
        ),
        (
            sticks,
            'stick.vertical.backward.from',
            5.0,
            "'backward' begins at 5 s, 'forward' lasts until 6 s (run 12)",
        ),
    ):
        part = Sampler(study).part(10, 14)
        columns = {**part.values, **part.events}
        columns[name] = np.where(np.arange(4) == 2, value, columns[name])
        samples = study.samples(columns, 10)
        message = refusal(StudyError, scenarios_of_runs, study.spec, samples)
        assert message.startswith(name.rpartition('.')[0].removesuffix('.backward')), message
        assert message.endswith(told), message


@pytest.mark.parametrize('text', [PUSHES, STICKS])
def test_any_run_can_be_repeated_from_a_scenario_file(study_of, text, tmp_path):
    study = study_of(text)
    samples = Sampler(study).part(0, 3)
    scenarios = scenarios_of_runs(study.spec, samples)
    compiled = simulator_for(study.spec, study.measures).simulate(samples)
    ordinary = OrdinarySimulator(study.spec, study.measures).simulate(samples.part(1, 2))
    np.testing.assert_array_equal(compiled.duty_sha256[1:2], ordinary.duty_sha256)
    for run in range(2):
        spec = rerun_of(study, samples, run, tmp_path / str(run))
        again = spec.scenario
        assert again.pushes == scenarios[run].pushes
        for stick in ('vertical', 'horizontal'):
            segments = getattr(scenarios[run], stick).segments
            assert getattr(again, stick).segments == segments
        assert again.expectations == study.expectations
        result = execute(spec)
        assert result.duty_sha256 == compiled.duty_sha256[run].tobytes().hex()


OTHER_PLANTS = (
    # Shorter than the scenario: its last pushes are not reached.
    ('push', 'duration: 9, hold_time: 0.5', 'push.1.force: {uniform: [0.0, 2.0]}',
     'peak_pitch_deg: {max: 9.0, to: 0.75}'),
    # Longer, with a push and a window after the scenario's end.
    ('push', 'duration: 30', 'push.4.time: {uniform: [23.0, 25.0]}',
     'peak_pitch_deg: {max: 9.0, to: 29.0}'),
    ('push', 'ball_mass: 0.02', 'plant_sim.duration: {uniform: [25.0, 40.0]}',
     'peak_pitch_deg: {max: 9.0, to: 25.0}'),
    # Another map and start.
    ('stationary', 'map: track, start_position_x: -0.7, start_position_y: -0.55',
     'plant_sim.body_mass: {uniform: [0.6, 0.8]}', 'wall_clearance_m: {min: 0.0}'),
)  # fmt: skip


@pytest.mark.parametrize(('scenario', 'plant', 'vary', 'expectation'), OTHER_PLANTS)
def test_a_scenario_file_fits_a_plant_other_than_its_own(
    study_of, scenario, plant, vary, expectation, tmp_path
):
    study = study_of(
        f'purpose: x\nscenario: {scenario}\nruns: 5\nparameters: {{plant_sim: {{{plant}}}}}\n'
        f'vary:\n  {vary}\nexpectations:\n  {expectation}\n'
    )
    samples = Sampler(study).part(3, 4)
    spec = rerun_of(study, samples, 0, tmp_path)
    assert spec.scenario.expectations == study.expectations
    varied = {name: each[0] for name, each in samples.values.items()}
    plant = with_values(study.spec.parameters, varied).of(PlantParameters)
    assert spec.plant == replace(plant, scenario=spec.plant.scenario)


FAULTS = """purpose: x
scenario: {path}
runs: 12
vary:
  fault.1.time: {{uniform: [1.5, 3.0]}}
  fault.1.duration: {{uniform: [0.01, 0.1]}}
  fault.1.type: {{list: [stuck, garbage, intermittent]}}
  fault.1.component: {{list: [gyro_x, gyro_y]}}
  fault.2.amount: {{uniform: [0.2, 1.0]}}
expectations: {{peak_pitch_deg: {{max: 5.0}}}}
"""
SCENARIO = """purpose: x
duration: 4
faults:
  - {component: gyro_x, type: stuck, time: 2, duration: 0.02}
  - {component: motor_x, type: weak, time: 2}
"""


def test_faults_vary_and_a_run_comes_back(study_of, tmp_path):
    path = tmp_path / 'failing.yaml'
    path.write_text(SCENARIO, encoding='utf-8')
    study = study_of(FAULTS.format(path=path))
    samples = Sampler(study).part(0, 12)
    results = simulator_for(study.spec, study.measures).simulate(samples)
    expected = OrdinarySimulator(study.spec, study.measures).simulate(samples)
    assert results.duty_sha256.tolist() == expected.duty_sha256.tolist()
    assert len({each.tobytes() for each in results.duty_sha256}) > 4
    spec = rerun_of(study, samples, 5, tmp_path / 'rerun')
    digest = bytes(results.duty_sha256[5]).hex()
    assert execute(spec).duty_sha256 == digest


@pytest.mark.parametrize(
    ('vary', 'told'),
    [
        ('fault.3.time: {list: [1, 2]}', "the scenario has no fault '3'; its faults are 1 … 2"),
        ('fault.1.amount: {list: [1, 2]}', "fault.1 has no 'amount'; it has component, type, time"),
        ('fault.1.type: {list: [weak, wrong]}', 'gyro_x weak: only motor can have this'),
        ('fault.1.time: {list: [1, 5]}', 'fault.1: a fault begins after the end of the run'),
        ('fault.1.type: {list: [broken]}', "'broken' is not one of off, stuck"),
    ],
)
def test_impossible_faults_of_a_study_are_refused(study_of, tmp_path, vary, told):
    path = tmp_path / 'failing.yaml'
    path.write_text(SCENARIO, encoding='utf-8')
    text = f'purpose: x\nscenario: {path}\nruns: 4\nvary:\n  {vary}\n'
    assert told in refusal(BallbotError, study_of, text)


KINDS_STUDY = """purpose: x
scenario: {scenario}
profile: hardware
controller: {controller}
sampling: grid
faults:
- {{component: gyro_x, type: stuck, time: 2, duration: 0.02}}
vary:
  {vary}
"""


@pytest.mark.parametrize(
    ('controller', 'tasks'), [('python', list(TASKS)), ('lqg', [OWN_TASK]), ('pid', [OWN_TASK])]
)
def test_all_kinds_are_those_that_the_robot_can_have(study_of, controller, tasks):
    study = study_of(
        KINDS_STUDY.format(scenario='push', controller=controller, vary='fault.1.kind: {list: all}')
    )
    others = {*TASKS, OWN_TASK}.difference(tasks)
    kinds = study.variables[0].distribution.levels
    assert kinds == tuple(each for each in KINDS if each.split()[0] not in others)
    assert study.runs == len(kinds)
    assert [str(each) for each in study.spec.scenario.faults] == [
        'gyro_x stuck time=2 duration=0.02'
    ]


def test_faults_of_a_study_come_after_those_of_its_scenario(study_of, tmp_path):
    path = tmp_path / 'failing.yaml'
    path.write_text(SCENARIO, encoding='utf-8')
    vary = 'fault.3.kind: {list: [motor_y weak, brick restart, gamepad off]}'
    study = study_of(KINDS_STUDY.format(scenario=path, controller='python', vary=vary))
    samples = Sampler(study).part(0, 3)
    results = simulator_for(study.spec, study.measures).simulate(samples)
    expected = OrdinarySimulator(study.spec, study.measures).simulate(samples)
    assert results.duty_sha256.tolist() == expected.duty_sha256.tolist()
    for run, kind in enumerate(samples.events['fault.3.kind'].tolist()):
        spec = rerun_of(study, samples, run, tmp_path / str(run))
        assert [f'{each.component} {each.type}' for each in spec.scenario.faults] == [
            'gyro_x stuck', 'motor_x weak', kind,
        ]  # fmt: skip
        assert execute(spec).duty_sha256 == bytes(results.duty_sha256[run]).hex()


@pytest.mark.parametrize(
    ('vary', 'line', 'told'),
    [
        ('fault.1.kind: {list: [gyro_x weak]}', 9, "'gyro_x weak' is not one of gyro_x off, "),
        ('fault.1.kind: {list: [tick slow]}', 9, "'tick slow' is not one of gyro_x off, "),
        ('fault.1.kind: {list: any}', 9, 'is not a list'),
        ('fault.1.type: {list: [stuck, weak]}', 8, 'gyro_x weak: only motor can have this'),
        ('fault.1.component: {list: [sonar, battery]}', 8, 'battery stuck: only gyro, encoder'),
        ('fault.2.kind: {list: all}', 9, "the scenario has no fault '2'; its faults are 1 … 1"),
        (
            'fault.1.kind: {list: [gyro_x off]}\n  fault.1.type: {list: ["off"]}',
            9,
            'fault.1.kind is a component and its type',
        ),
        (
            'fault.1.kind: {list: [task_ts1 slow]}\nparameters: {controller: {kernel: false}}',
            8,
            'task_ts1 slow: requires kernel: true',
        ),
    ],
)
def test_impossible_kinds_are_refused_when_the_study_is_read(study_of, vary, line, told):
    text = KINDS_STUDY.format(scenario='push', controller='python', vary=vary)
    message = refusal(BallbotError, study_of, text)
    assert told in message
    assert f'mine.yaml:{line}: ' in message
