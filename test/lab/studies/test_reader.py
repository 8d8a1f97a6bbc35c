"""Study files: what they say, and the errors in them."""

import math

import pytest
from laws import given, is_read_or_refused_in_one_line, refusal, yaml_texts

from ballbot_ros.controllers.document.axis import ProgramConstants
from ballbot_ros.engine.scenario.scenario import Expectation, Measure
from ballbot_ros.errors import BallbotError, StudyError
from ballbot_ros.lab.studies.reader import STUDY_KEYS, read_study
from ballbot_ros.lab.studies.study import Sampling, grid_shape
from ballbot_ros.lab.studies.variables import WITHOUT_EFFECT, Levels, LogUniform, Normal, Uniform
from ballbot_ros.parameters import ROBOT_CLASSES, ControllerParameters, PlantParameters

HEAD = 'purpose: x\nscenario: push\nruns: 100\n'
STICK = 'purpose: x\nscenario: square\nruns: 100\n'
VARY = HEAD + 'vary:\n  '
FORCE = 'push.1.force: {uniform: [0.0, 2.0]}\n'
GRID = 'purpose: x\nscenario: push\nsampling: grid\nvary:\n  plant_sim.backlash: '
FULL = """purpose: everything at once
scenario: push
profile: hardware
parameters:
  controller: {a_d: 0.7}
  plant_sim:
    gravity: 9.8
runs: 1000
seed: 7
sampling: sobol
vary:
  plant_sim.body_mass: {uniform: [0.6, 0.8]}
  plant_sim.ball_friction: {log_uniform: [1.0e-4, 1.0e-2]}
  gyro_driver.noise: {normal: [0.7, 0.2], min: 0.0, max: 1.5}
  plant_sim.plant_model: {list: [linear, nonlinear]}
  plant_sim.actuator_delay: {uniform: [0, 8]}
  controller.k_i: {normal: [-0.007, 0.001]}
  controller.k_f.2: {uniform: [-1.7, -1.4]}
  push.1.force: {uniform: [0.0, 2.0]}
  push.1.direction: {uniform: [-180.0, 180.0]}
metrics: [peak_pitch_deg, settling_time_s]
expectations:
  peak_pitch_deg: {max: 10.0}
  peak_position_m: {max: 1.0, from: 3.0}
"""


@pytest.fixture(scope='module')
def read(tmp_path_factory):
    path = tmp_path_factory.mktemp('studies') / 'mine.yaml'

    def read_text(text, **options):
        path.write_bytes(text.encode(errors='replace'))
        return read_study(str(path), **options)

    return read_text


def test_a_profile_of_your_own_is_a_file_next_to_the_study(tmp_path, monkeypatch):
    folder = tmp_path / 'mine'
    folder.mkdir()
    (folder / 'own.yaml').write_text('plant_sim: {ros__parameters: {dead_zone: 3.0}}')
    (folder / 'study.yaml').write_text(VARY.replace('vary', 'profile: own.yaml\nvary') + FORCE)
    monkeypatch.chdir(tmp_path)
    study = read_study('mine/study.yaml')
    assert study.spec.parameters.of(PlantParameters).dead_zone == 3.0
    assert 'own.yaml' not in study.spec.scenario.text


def test_controller_and_parameters_can_be_other_ones(read, tmp_path):
    text = (
        'purpose: p\nscenario: push\nruns: 9\ncontroller: pid\n'
        'parameters: {plant_sim: {backlash: 0.1}}\n'
    )
    path = tmp_path / 'other.yaml'
    path.write_text('/**/plant_sim:\n  ros__parameters: {backlash: 0.2, dead_zone: 3.0}\n')
    for options, controller, plant in (
        ({}, 'pid', (0.1, 0.0)),
        ({'controller': 'lqg'}, 'lqg', (0.1, 0.0)),
        ({'parameter_file': path}, 'pid', (0.2, 3.0)),
    ):
        spec = read(text, **options).spec
        assert spec.parameters.of(ControllerParameters).implementation == controller
        assert (spec.plant.backlash, spec.plant.dead_zone) == plant


def test_a_study_has_everything_that_its_file_says(read):
    study = read(FULL)
    assert (study.name, study.purpose, study.text) == ('mine', 'everything at once', FULL)
    assert (study.runs, study.seed, study.sampling) == (1000, 7, Sampling.SOBOL)
    distributions = {each.name: each.distribution for each in study.variables}
    assert distributions['plant_sim.body_mass'] == Uniform(0.6, 0.8)
    assert distributions['plant_sim.ball_friction'] == LogUniform(1e-4, 1e-2)
    assert distributions['gyro_driver.noise'] == Normal(0.0, 1.5, 0.7, 0.2)
    assert distributions['plant_sim.plant_model'] == Levels(('linear', 'nonlinear'))
    assert distributions['plant_sim.actuator_delay'].ends == (0, 8)
    assert distributions['controller.k_i'] == Normal(-1e9, 1e9, -0.007, 0.001)
    assert distributions['push.1.direction'] == Uniform(-180.0, 180.0)
    units = {each.name: each.parameter.unit for each in study.variables}
    assert (units['push.1.force'], units['plant_sim.body_mass']) == ('N', 'kg')
    assert study.columns == (*distributions, 'plant_sim.seed')
    assert study.metrics == ('peak_pitch_deg', 'settling_time_s')
    assert study.expectations == (
        Expectation('peak_pitch_deg', maximum=10.0),
        Expectation('peak_position_m', maximum=1.0, start=3.0),
    )
    assert study.measures == (
        Measure('peak_pitch_deg'),
        Measure('settling_time_s'),
        Measure('peak_position_m', 3.0, math.inf),
    )
    assert study.spec.plant.gravity == 9.8
    assert study.spec.plant.backlash > 0.0
    assert study.spec.parameters.of(ControllerParameters).a_d == 0.7


def test_the_defaults(read):
    study = read(HEAD)
    assert (study.sampling, study.seed, study.variables) == (Sampling.RANDOM, 1, ())
    assert study.draws_seeds
    assert study.expectations == study.spec.scenario.expectations
    assert study.metrics == (
        'peak_pitch_deg',
        'settling_time_s',
        'peak_position_m',
        'position_rms_m',
    )
    # The whole run, then the windows that the expectations have, and the properties.
    windows = {each.measure for each in study.expectations}
    whole = set(map(Measure, study.metrics))
    assert set(study.measures) == windows | whole | set(study.spec.scenario.properties)


def test_runs_and_seed_can_be_overridden(read):
    assert read(HEAD, runs=7, seed=3).runs == 7
    assert read(HEAD, runs=7, seed=3).seed == 3
    assert read('purpose: x\nscenario: push\n', runs=7).runs == 7
    grid = GRID + '{grid: [0.0, 0.2, 5]}\n'
    assert read(grid).runs == 5
    assert read(grid + 'repeats: 3\n').runs == 15
    assert read(grid + 'repeats: 3\n', runs=10).runs == 10
    assert '--runs 0: not within 1 …' in refusal(StudyError, lambda: read(HEAD, runs=0))
    assert '--seed -1: not within 0 …' in refusal(StudyError, lambda: read(HEAD, seed=-1))


def test_a_grid_takes_the_levels_that_are_nearest_to_a_number_of_runs(read):
    two = 'plant_sim.body_mass: {grid: [0.6, 0.8, 11]}\n  plant_sim.gravity: {list: [9.7, 9.8]}\n'
    head = GRID + '{grid: [0.0, 0.2, 5]}\n'
    fixed = head + 'parameters: {gyro_driver: {seed: 3}}\n'
    for text, runs, shape, found in (
        (head, 7, [7], 7),
        (head, 4, [4], 4),
        (head, 1, [2], 2),
        (head, 20, [5], 20),
        (head, 52_003, [5], 52_005),
        (fixed, 20, [20], 20),  # it has no repeats
        (head + '  ' + two, 110, [5, 11, 2], 110),
        (head + '  ' + two, 50, [3, 8, 2], 48),
        (GRID + '{list: [0.0, 0.1, 0.2]}\n', 7, [3], 6),
    ):
        study = read(text, runs=runs)
        assert (grid_shape(study.variables), study.runs) == (shape, found), (text, runs)
        for variable, same in zip(study.variables, read(text).variables, strict=True):
            assert variable.distribution.ends == same.distribution.ends
    assert read(head, runs=5).variables == read(head).variables


def test_a_seed_that_is_fixed_or_varied_is_not_drawn(read):
    fixed = (
        'parameters: {gyro_driver: {seed: 3}}\nvary: {plant_sim.backlash: {uniform: [0, 0.1]}}\n'
    )
    varied = 'vary: {sonar_driver.seed: {uniform: [1, 1000]}}\n'
    assert not read(HEAD + fixed).draws_seeds
    assert not read(HEAD + varied).draws_seeds


def test_files_are_relative_to_the_study(tmp_path):
    (tmp_path / 'own').mkdir()
    (tmp_path / 'own' / 'case.yaml').write_text('purpose: x\nduration: 5\n')
    path = tmp_path / 'mine.yaml'
    path.write_text('purpose: x\nscenario: own/case.yaml\nruns: 3\n')
    study = read_study(str(path))
    assert study.spec.scenario.name == 'case'
    assert study.spec.plant.duration == 5.0
    assert study.metrics == ('peak_pitch_deg',)


MISTAKES = [
    ('', None, 'the study is not a mapping'),
    ('scenario: push\n', 1, 'purpose is missing'),
    ('purpose: x\n', 1, 'scenario is missing'),
    ('purpose: x\nscenario: push\n', 1, 'runs is missing'),
    ('purpose: x\nscenario: shove\nruns: 1\n', 2, "unknown scenario 'shove'; shipped: autonomous"),
    ('purpose: x\nscenario: ./none.yaml\nruns: 1\n', 2, 'No such file'),
    ('purpose: x\nscenario: [[push]]\nruns: 1\n', 2, 'is not a line of text'),
    ('purpose: x\nscenario: []\nruns: 1\n', 2, 'is not a line of text'),
    ('purpose: x\nscenario: push\ncontroller: [3]\nruns: 1\n', 3, 'is not a line of text'),
    (HEAD + 'faults:\n- {component: gyro_x}\n', 5, 'a fault needs a type'),
    (HEAD + 'faults:\n- {component: gyro_x, type: weak}\n', 5, 'only motor can have this'),
    (HEAD + 'faults:\n- {component: gyro_x, type: stuck, time: 99}\n', 5, 'begins after the end'),
    (HEAD + 'goal: 1\n', 4, "unknown key 'goal'; known: controller, "),
    (HEAD + 'runs: 5\n', 4, "duplicate key 'runs'"),
    (HEAD + 'profile: real\n', 4, "unknown profile 'real'"),
    (HEAD + 'profile: null\n', 4, 'profile: None is not a line of text'),
    (HEAD + 'controller: best\n', 4, 'best'),
    (HEAD + 'seed: -1\n', 4, 'seed: -1 is not a whole number, 0 …'),
    (HEAD + 'seed: true\n', 4, 'seed: True is not a whole number, 0 …'),
    (HEAD + 'sampling: guess\n', 4, "'guess' is not one of random, latin_hypercube, sobol, halton"),
    (HEAD + 'repeats: 5\n', 4, 'repeats is only for `sampling: grid`'),
    ('purpose: x\nscenario: push\nruns: 0\n', 3, 'runs: 0 is not a whole number, 1 …'),
    ('purpose: x\nscenario: push\nruns: 1.5\n', 3, 'runs: 1.5 is not a whole number, 1 …'),
    ('purpose: x\nscenario: push\nruns: 10000000000\n', 3, 'is not a whole number, 1 …'),
    (HEAD + 'parameters:\n  plant_sim: {mass: 1}\n', 5, "no parameter 'mass'"),
    (HEAD + 'parameters:\n  plant_sim: {body_mass: -1}\n', 5, '-1 is not within'),
    (HEAD + 'parameters:\n  plant_sim: {scenario: push}\n', 5, 'cannot set the parameter scenario'),
    (HEAD + 'parameters:\n  plant_sim: {lockstep: false}\n', 4, 'lockstep: false requires nodes'),
    (HEAD + 'parameters:\n  controller: {user.x: 1}\n', 4, "no parameter 'user.x'"),
    (HEAD + 'parameters:\n  plant_sim: {trajectory_file: x}\n', 4, 'cannot be set'),
    (HEAD + 'parameters: {plant_sim: {duration: 10}}\n', 2, 'give `expectations` in place of'),
    # What varies
    (VARY + 'plant_sim.mass: {uniform: [0, 1]}\n', 5, "plant_sim has no parameter 'mass'"),
    (VARY + 'plant.body_mass: {uniform: [0, 1]}\n', 5, 'not a parameter of one of plant_sim'),
    (VARY + 'viewer.port: {uniform: [0, 1]}\n', 5, 'not a parameter of one of plant_sim'),
    (VARY + '5: {uniform: [0, 1]}\n', 5, '5: not a parameter of one of plant_sim'),
    (VARY + 'plant_sim.timeout: {uniform: [1, 2]}\n', 5, 'the motion of a run does not depend on'),
    (VARY + 'controller.sound_freq: {uniform: [40, 50]}\n', 5, 'does not depend on it'),
    (VARY + 'plant_sim.scenario: {list: [push]}\n', 5, 'must be the same for all runs'),
    (VARY + 'plant_sim.map: {list: [track, corridor]}\n', 5, 'must be the same for all runs'),
    (VARY + 'controller.implementation: {list: [c]}\n', 5, 'must be the same for all runs'),
    (VARY + 'plant_sim.trajectory_file: {list: [c]}\n', 5, 'must be the same for all runs'),
    (VARY + 'controller.k_f: {list: [1]}\n', 5, 'its elements can: controller.k_f.1 … 4'),
    (VARY + 'controller.k_f.5: {uniform: [0, 1]}\n', 5, 'its elements are 1 … 4'),
    (VARY + 'controller.user.x: {uniform: [0, 1]}\n', 5, "document's controller has no such"),
    (VARY + 'plant_sim.body_mass: [0, 1]\n', 5, 'is not a mapping'),
    (VARY + 'plant_sim.body_mass: {}\n', 5, 'needs exactly one of uniform, log_uniform, normal'),
    (VARY + 'plant_sim.body_mass: {uniform: [1, 2], list: [1]}\n', 5, 'needs exactly one of'),
    (VARY + 'plant_sim.body_mass: {gauss: [1, 2]}\n', 5, "unknown key 'gauss'"),
    (VARY + 'plant_sim.body_mass:\n    uniform: 1\n', 6, 'uniform is not a pair [lowest, highest]'),
    (VARY + 'plant_sim.body_mass: {uniform: [1, 1]}\n', 5, 'the range 1 … 1 is empty'),
    (VARY + 'plant_sim.body_mass: {uniform: [2, 1]}\n', 5, 'the range 2 … 1 is empty'),
    (VARY + 'plant_sim.body_mass: {uniform: [0, 1]}\n', 5, '0 is not within 1e-06 … 100 kg'),
    (VARY + 'plant_sim.body_mass: {uniform: [1, 101]}\n', 5, '101 is not within 1e-06 … 100 kg'),
    (VARY + 'plant_sim.body_mass: {uniform: [1, x]}\n', 5, "'x' is not a number"),
    (VARY + 'plant_sim.body_mass: {uniform: [1, .nan]}\n', 5, 'nan is not within'),
    (VARY + 'plant_sim.body_mass: {uniform: [1, 2], min: 1}\n', 5, 'min is only for normal'),
    (VARY + 'plant_sim.backlash: {log_uniform: [0, 0.1]}\n', 5, 'log_uniform needs ends above 0'),
    (VARY + 'plant_sim.body_mass: {normal: [1]}\n', 5, 'is not a pair [mean, standard deviation]'),
    (VARY + 'plant_sim.body_mass: {normal: [1, 0]}\n', 5, 'standard deviation is not above 0'),
    (VARY + 'plant_sim.body_mass: {normal: [1, 1], min: 2}\n', 5, 'mean 1 is not within 2 … 100'),
    (VARY + 'plant_sim.body_mass: {normal: [1, 1], max: 200}\n', 5, '200 is not within'),
    (VARY + 'plant_sim.body_mass: {normal: [1, 1], min: 3, max: 2}\n', 5, '3 … 2 is empty'),
    (VARY + 'push.1.direction: {normal: [0, 10]}\n', 5, 'has no bounds: normal needs min and max'),
    (VARY + 'plant_sim.body_mass: {list: []}\n', 5, 'the list is empty'),
    (VARY + 'plant_sim.body_mass:\n    list:\n    - 1\n    - 1.0\n', 8, '1.0 is doubled'),
    (VARY + 'plant_sim.plant_model: {list: [flat]}\n', 5, "'flat' is not one of linear, nonlinear"),
    (VARY + 'plant_sim.plant_model: {uniform: [1, 2]}\n', 5, 'can only vary by list'),
    (VARY + 'controller.ts2_period: {uniform: [4, 20]}\n', 5, 'can only vary by list'),
    (VARY + 'plant_sim.actuator_delay: {uniform: [0, 1.5]}\n', 5, '1.5 is not a whole number'),
    (VARY + 'plant_sim.body_mass: {grid: [1, 2, 3]}\n', 5, 'grid needs `sampling: grid`'),
    (VARY + 'sonar_driver.cone_rays: {uniform: [1, 9]}\n', 5, 'needs a list of odd numbers'),
    (VARY + 'sonar_driver.cone_rays: {list: [1, 4]}\n', 5, 'needs a list of odd numbers'),
    (VARY + 'plant_sim.duration: {uniform: [0, 9]}\n', 5, 'must last at least 0.004 s'),
    (
        VARY + 'plant_sim.seed: {uniform: [0, 9]}\n  gyro_driver.seed: {uniform: [0, 9]}\n',
        6,
        'gyro_driver.seed is the same parameter as plant_sim.seed',
    ),
    (
        VARY + 'controller.ball_radius: {uniform: [0.02, 0.03]}\n'
        '  plant_sim.ball_radius: {uniform: [0.02, 0.03]}\n',
        6,
        'is the same parameter as controller.ball_radius',
    ),
    (
        HEAD + 'parameters: {controller: {ball_radius: 0.03}}\n'
        'vary:\n  plant_sim.ball_radius: {uniform: [0.02, 0.03]}\n',
        6,
        'plant_sim.ball_radius is also fixed by parameters',
    ),
    (
        HEAD + 'parameters: {controller: {k_f: [0, 0, 0, 0]}}\n'
        'vary:\n  controller.k_f.1: {uniform: [0, 1]}\n',
        6,
        'controller.k_f.1 is also fixed by parameters',
    ),
    (HEAD + 'parameters: {plant_sim: {seed: 1}}\n', 1, 'nothing varies: plant_sim.seed is fixed'),
    (
        HEAD + 'controller: pid\nparameters: {controller: {implementation: lqg}}\n',
        4,
        'controller.implementation is also set by parameters',
    ),
    # Grids
    (GRID + '{uniform: [0, 0.1]}\n', 5, 'sampling grid needs grid or list'),
    (GRID + '{grid: [0, 0.1]}\n', 5, 'is not a list [first, last, number of levels]'),
    (GRID + '{grid: [0, 0.1, 1]}\n', 5, '1 is not a whole number of levels'),
    (GRID + '{grid: [0, 0.1, 1000000000]}\n', 5, 'number of levels, 2 … 100000'),
    (GRID + '{grid: [0, 0.1, 2.5]}\n', 5, '2.5 is not a whole number of levels'),
    (GRID + '{grid: [0, 0.6, 3]}\n', 5, '0.6 is not within 0 … 0.5 rad'),
    (GRID + '{grid: [0, 5.0e-324, 9]}\n', 5, 'too close'),
    (GRID + '{grid: [0, 0.1, 3]}\nruns: 6\n', 6, 'has 3 points: give repeats instead of runs'),
    (GRID + '{grid: [0, 0.1, 3]}\nrepeats: 0\n', 6, 'repeats: 0 is not a whole number'),
    (
        GRID + '{grid: [0, 0.1, 3]}\nrepeats: 2\nparameters: {plant_sim: {seed: 1}}\n',
        6,
        'repeats would be equal: plant_sim.seed is given',
    ),
    (GRID + '{grid: [0, 0.1, 10001]}\nrepeats: 1000000\n', 4, 'are more than 1000000000'),
    (
        GRID + '{list: [0]}\n  plant_sim.actuator_delay: {grid: [0, 10, 4]}\n',
        6,
        'the level 3.33333 is not a whole number',
    ),
    (
        (
            'purpose: x\nscenario: push\nruns: 1000000000\nsampling: latin_hypercube\n'
            'vary: {plant_sim.backlash: {uniform: [0, 0.1]}}\n'
        ),
        4,
        'a Latin hypercube has at most',
    ),
    # Gains for each robot
    (HEAD + 'redesign: best\n', 4, "redesign: 'best' is not one of lqr, dlqr"),
    (HEAD + 'redesign: place\n', 4, "redesign: 'place' is not one of lqr, dlqr"),
    (HEAD + 'redesign: true\n', 4, 'redesign: True is not one of lqr, dlqr'),
    (HEAD + 'redesign: [lqr]\n', 4, "redesign: ['lqr'] is not one of lqr, dlqr"),
    (HEAD + 'redesign: {method: [lqr]}\n', 4, "redesign: ['lqr'] is not one of lqr, dlqr"),
    (HEAD + 'redesign: {r: 1}\n', 4, 'redesign: None is not one of lqr, dlqr'),
    (HEAD + 'redesign: {method: lqr, delay: 8}\n', 4, "unknown key 'delay'; known: method, q, r"),
    (HEAD + 'redesign: {method: dlqr, delay: 101}\n', 4, 'delay: 101 is not within 0 … 100 ms'),
    (HEAD + 'redesign: {method: lqr, r: 0}\n', 4, 'r: 0 is not within 1e-20 … 1e20'),
    (HEAD + 'redesign: {method: lqr, q: [1, 2]}\n', 4, 'q: 5 numbers are needed, not 2'),
    (HEAD + 'redesign: {method: lqr, q: [1, 2, 3, 4, -1]}\n', 4, '-1 is not 0 or within 1e-20'),
    (HEAD + 'redesign: {method: lqr, q: 1}\n', 4, 'is not a list'),
    (HEAD + 'controller: lqg\nredesign: lqr\n', 5, "redesign: lqg is not the document's program"),
    (
        HEAD + 'parameters: {controller: {k_f: [0, 0, 0, 0]}}\nredesign: lqr\n',
        5,
        'controller.k_f is designed for each robot: omit it',
    ),
    (
        HEAD + 'redesign: lqr\nvary:\n  controller.k_i: {uniform: [-1, 0]}\n',
        4,
        'controller.k_i is designed for each robot: omit it',
    ),
    # Pushes and sticks
    (VARY + 'push.5.force: {uniform: [0, 1]}\n', 5, "no push '5'; its pushes are 1 … 4"),
    (VARY + 'push.first.force: {uniform: [0, 1]}\n', 5, "no push 'first'"),
    (VARY + 'push.1.mass: {uniform: [0, 1]}\n', 5, "push.1 has no 'mass'; it has force, direction"),
    (VARY + 'push: {uniform: [0, 1]}\n', 5, "no push ''"),
    (VARY + 'push.1.force: {uniform: [0, 1001]}\n', 5, '1001 is not within 0 … 1000 N'),
    (VARY + 'push.1.duration: {uniform: [0, 1]}\n', 5, 'a push must last longer than 0 s'),
    (VARY + 'push.1.time: {uniform: [0, 22]}\n', 4, 'a push begins after the end of the run'),
    (VARY + 'push.1.direction: {list: [left]}\n', 5, "'left' is not a number"),
    (VARY + 'stick.vertical.ahead.value: {list: [1]}\n', 5, "no segment 'ahead' on the vertical"),
    (STICK + 'vary:\n  stick.left.ahead.value: {list: [1]}\n', 5, "'left' is not one of vertical"),
    (STICK + 'vary:\n  stick.vertical.forward.end: {list: [1]}\n', 5, "has no 'end'; it has value"),
    (STICK + 'vary:\n  stick.vertical.forward.value: {list: [101]}\n', 5, 'not within -100 … 100'),
    (STICK + 'vary:\n  stick.vertical.forward.to: {uniform: [1, 3]}\n', 4, 'time goes back from 2'),
    (
        STICK + 'vary:\n  stick.vertical.forward.to: {uniform: [5, 21]}\n',
        4,
        "'forward' lasts until",
    ),
    (STICK + 'vary:\n  stick.vertical.backward.from: {uniform: [5, 9]}\n', 4, "'backward' begins"),
    (
        (
            'purpose: x\nscenario: excitation\nruns: 1\nvary:\n'
            '  stick.vertical.forward.value: {list: [1]}\n'
        ),
        5,
        "12 segments of the vertical stick are called 'forward'",
    ),
    # Metrics and expectations
    (
        HEAD + 'metrics: [peak_pitch]\n',
        4,
        "unknown metric 'peak_pitch'; did you mean peak_pitch_deg",
    ),
    (HEAD + 'metrics:\n- peak_pitch_deg\n- 5\n', 6, "unknown metric '5'"),
    (HEAD + 'metrics:\n- peak_pitch_deg\n- peak_pitch_deg\n', 6, 'is doubled'),
    (HEAD + 'metrics: []\n', 4, 'the list is empty'),
    (HEAD + 'metrics: peak_pitch_deg\n', 4, 'is not a list'),
    (HEAD + 'metrics: [wall_clearance_m]\n', 4, 'needs a map'),
    (HEAD + 'expectations:\n  peak: {max: 1}\n', 5, "unknown metric 'peak'"),
    (HEAD + 'expectations:\n  peak_pitch_deg: {max: 1, to: 30}\n', 5, 'within the run, 0 … 22 s'),
    (
        VARY + 'plant_sim.duration: {uniform: [18, 30]}\n'
        'expectations:\n  peak_pitch_deg: {max: 1, to: 20}\n',
        7,
        'within the run, 0 … 18 s',
    ),
]


def test_mistakes_are_reported_in_one_line_with_file_and_line(read):
    for text, line, told in MISTAKES:
        message = refusal(BallbotError, read, text)
        assert (f'mine.yaml:{line}: ' if line else 'mine.yaml: ') in message, (text, message)
        assert told in message, (text, message)


def test_the_error_for_an_unknown_study_lists_the_shipped_ones():
    assert 'shipped: basin, clock, delay_and_gain' in refusal(StudyError, read_study, 'nothing')
    assert 'No such file' in refusal(BallbotError, read_study, './none.yaml')


def test_a_segment_with_points_cannot_vary(tmp_path):
    (tmp_path / 'case.yaml').write_text(
        'purpose: x\nduration: 5\nsticks: {vertical: [{name: ramp.1, points: [[1, 0], [2, 50]]}]}\n'
    )
    path = tmp_path / 'mine.yaml'
    path.write_text(
        'purpose: x\nscenario: case.yaml\nruns: 3\n'
        'vary: {stick.vertical.ramp.1.value: {uniform: [0, 1]}}\n'
    )
    assert 'the segment has points' in refusal(StudyError, read_study, str(path))


def test_parameters_of_the_users_controller_can_vary(read):
    study = read(HEAD + 'controller: pid\nvary: {controller.user.pitch_p: {uniform: [20, 30]}}\n')
    assert study.variables[0].parameter.name == 'controller.user.pitch_p'
    doubled = HEAD + 'controller: pid\nparameters: {controller: {user.pitch_p: 20}}\n'
    vary = 'vary: {controller.user.pitch_p: {uniform: [20, 30]}}\n'
    assert 'is also fixed by parameters' in refusal(BallbotError, read, doubled + vary)
    vary = 'vary: {controller.user.pitch: {uniform: [20, 30]}}\n'
    assert 'did you mean' in refusal(BallbotError, read, HEAD + 'controller: pid\n' + vary)


def test_what_gains_are_designed_from_can_vary_unless_they_are_set(read):
    vary = 'controller: lqg\nvary: {controller.model.body_mass: {uniform: [0.6, 0.8]}}\n'
    assert read(HEAD + vary).variables[0].name == 'controller.model.body_mass'
    gains = 'parameters: {controller: {user.feedback: [1.0, 2.0, 3.0, 4.0, 5.0]}}\n'
    told = 'mine.yaml:6: controller.model.body_mass cannot vary: controller.user.feedback is set'
    assert told in refusal(BallbotError, read, HEAD + gains + vary)
    gains = 'vary: {controller.user.feedback: {uniform: [0.0, 1.0]}}\n'
    assert 'a list of numbers' in refusal(BallbotError, read, HEAD + 'controller: lqg\n' + gains)


def test_what_has_no_effect_is_a_parameter_and_no_constant_of_the_law():
    known = {name for cls in ROBOT_CLASSES for name in cls().values()}
    assert known >= WITHOUT_EFFECT
    sound_and_log = {name for name in ProgramConstants.__annotations__ if name in WITHOUT_EFFECT}
    assert sound_and_log == {
        'lsb', 'sound_freq', 'sound_dur', 'sound_volume', 'log_content',
    }  # fmt: skip
    assert 'duration' in PlantParameters().values()


WORDS = (
    'purpose: x\n', 'scenario: push\n', 'runs: 3\n', 'plant_sim.backlash: ', 'push.1.force: ',
    'stick.', 'uniform: ', 'normal: ', 'list: ', 'grid: ', 'min: ', '0.1',
)  # fmt: skip


@given(yaml_texts(*(f'{key}: ' for key in sorted(STUDY_KEYS)), *WORDS))
def test_any_text_is_read_or_refused_in_one_line(read, text):
    assert is_read_or_refused_in_one_line(read, text)


@given(yaml_texts(*WORDS))
def test_any_variation_is_read_or_refused_in_one_line(read, text):
    assert is_read_or_refused_in_one_line(read, VARY + text)
