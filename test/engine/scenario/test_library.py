"""Reading scenario files."""

import math

import pytest
from hypothesis import strategies as st
from laws import given, is_read_or_refused_in_one_line, refusal, yaml_texts

from ballbot_ros.engine.scenario.reader import load_profile, load_scenario, scenario_names
from ballbot_ros.engine.scenario.scenario import Expectation, ScheduledPush
from ballbot_ros.errors import BallbotError, ScenarioError
from ballbot_ros.parameters import (
    GYRO,
    PLANT,
    SONAR,
    ControllerParameters,
    GyroParameters,
    PlantParameters,
    SonarParameters,
)

HEAD = 'purpose: a test\nduration: 5\n'
STICK = HEAD + 'sticks:\n  vertical:\n'
LATER = '    - {name: b, from: 2, value: 1}\n'
PUSH = HEAD + 'pushes:\n  - '
FAULT = HEAD + 'faults:\n  - '
FULL = """\
purpose: everything at once
duration: 12.5
seed: 7
profile: ideal
start: {pitch_x_deg: 4, pitch_y_deg: -2.0, pitch_rate_y_deg_per_s: 30,
        position_x: 0.5, position_y: -1}
plant_model: nonlinear
mode: autonomous
sticks:
  vertical:
    - {name: ahead, points: [[0, 0], [2, -100]]}
    - {name: back, from: 2, to: 4, value: 50}
  horizontal:
    - {name: right, from: 3.5, value: 20.0}
pushes:
  - {time: 2, duration: 0.1, force: 1.5, direction: forward}
  - {time: 4, duration: 0.2, force: 0.5, direction: left}
  - {time: 5, duration: 0.2, force: 2, direction: 30}
parameters:
  plant_sim: {gravity: 9.8}
  /**: {ball_radius: 0.03}
expectations:
  settling_time_s: {max: 3}
  final_position_x_m:
    - {min: 0.1, max: 2.0}
    - {max: 0.5, from: 2, to: 6}
"""


@pytest.fixture(scope='module')
def load(tmp_path_factory):
    """Load a scenario of the given text."""
    path = tmp_path_factory.mktemp('scenarios') / 'mine.yaml'

    def load_text(text):
        path.write_bytes(text.encode(errors='replace'))
        return load_scenario(str(path))

    return load_text


def test_a_scenario_sets_everything_that_it_names(load):
    scenario = load(FULL)
    assert (scenario.name, scenario.purpose) == ('mine', 'everything at once')
    assert scenario.text == FULL
    plant = scenario.parameters.of(PlantParameters)
    assert plant.duration == 12.5
    assert plant.start_pitch_x == math.radians(4.0)
    assert plant.start_pitch_y == math.radians(-2.0)
    assert plant.start_pitch_rate_y == math.radians(30.0)
    assert (plant.start_position_x, plant.start_position_y) == (0.5, -1.0)
    assert plant.plant_model == 'nonlinear'
    assert plant.ball_radius == 0.03
    assert scenario.parameters.of(ControllerParameters).ball_radius == 0.03
    for node in (GYRO, SONAR):
        assert scenario.parameters.of_node(node).seed == 7
    assert plant.gravity == 9.8
    assert scenario.parameters.of(ControllerParameters).mode == 'autonomous'
    assert [segment.name for segment in scenario.vertical.segments] == ['ahead', 'back']
    assert scenario.sticks_at(1.0) == (-50, 0)
    assert scenario.sticks_at(2.0) == (50, 0)
    assert scenario.sticks_at(3.5) == (50, 20)
    assert scenario.sticks_at(1e6) == (0, 20)
    forward, left, slanting = scenario.pushes
    assert forward == ScheduledPush(2.0, 0.1, force=1.5, direction='forward')
    assert left == ScheduledPush(4.0, 0.2, force=0.5, direction='left')
    assert slanting.components == pytest.approx((math.sqrt(3.0), -1.0))
    assert scenario.expectations == (
        Expectation('settling_time_s', maximum=3.0),
        Expectation('final_position_x_m', 0.1, 2.0),
        Expectation('final_position_x_m', None, 0.5, 2.0, 6.0),
    )


def test_purpose_and_duration_are_enough(load):
    scenario = load(HEAD)
    assert list(scenario.parameters) == [(PLANT, 'duration', 5.0)]
    assert scenario.profile == 'ideal'
    assert scenario.sticks_at(1.0) == (0, 0)
    assert scenario.pushes == scenario.expectations == ()


@pytest.mark.parametrize('name', scenario_names())
def test_shipped_scenarios_load_by_name(name):
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.purpose
    assert scenario.expectations


def test_the_documents_scenario_is_shipped():
    scenario = load_scenario('stationary')
    plant = scenario.parameters.of(PlantParameters)
    assert plant.start_pitch_x == math.radians(4.0)
    assert plant.start_pitch_y == 0.0
    assert plant.hold_time == 1.0


def test_the_ideal_profile_is_the_table():
    assert list(load_profile('ideal')) == []


def test_the_hardware_profile_has_all_the_faults_of_the_devices():
    hardware = load_profile('hardware')
    gyro, sonar = hardware.of(GyroParameters), hardware.of(SonarParameters)
    plant = hardware.of(PlantParameters)
    assert gyro.noise == 0.7
    # Limit the drift: a faster one makes the pitch estimate ramp until the robot stops itself.
    assert 0.0 < gyro.drift < 2.0
    assert sonar.noise_cm == 3.0
    assert sonar.dropout_probability == 0.15
    assert plant.dead_zone > 0.0
    assert plant.backlash == pytest.approx(math.radians(4.0), rel=0.1)
    assert plant.battery_model == 'draining'


@pytest.mark.parametrize('name', ['', 'nothing', 'Stationary', 'two\nlines', '..'])
def test_the_error_for_an_unknown_scenario_lists_the_known_ones(name):
    text = refusal(ScenarioError, load_scenario, name)
    assert repr(name) in text
    assert 'stationary' in text


@pytest.mark.parametrize('name', ['nothing.yaml', './nothing', 'a/b.yml', '/'])
def test_a_missing_file_is_named_by_its_path(name):
    with pytest.raises(BallbotError, match=r'^[^\n]+: [^\n]+$'):
        load_scenario(name)


@pytest.mark.parametrize('name', ['', 'real', 'two\nlines'])
def test_the_error_for_an_unknown_profile_lists_the_known_ones(name):
    assert 'ideal' in refusal(ScenarioError, load_profile, name)


OWN = """\
/**/gyro_driver: {ros__parameters: {noise: 0.5, drift: 0.25}}
/**/plant_sim: {ros__parameters: {plant_model: nonlinear, dead_zone: 3.0, start_pitch_x: 0.1}}
/**: {ros__parameters: {ball_radius: 0.03}}
"""


def test_a_profile_of_your_own_is_a_file_next_to_the_scenario(tmp_path, monkeypatch):
    """And the text of the scenario, which is recorded, needs no other file."""
    folder, elsewhere = tmp_path / 'mine', tmp_path / 'elsewhere'
    for each in (folder, elsewhere):
        each.mkdir()
    (folder / 'own.yaml').write_text(OWN)
    (folder / 'push.yaml').write_text(
        HEAD + 'profile: own.yaml\nplant_model: linear\nstart: {pitch_x_deg: 2}\n'
        'parameters: {gyro_driver: {drift: 0.0}, /**: {ball_radius: 0.027}}\n'
    )
    monkeypatch.chdir(elsewhere)
    scenario = load_scenario('../mine/push.yaml')
    plant, gyro = (scenario.parameters.of(cls) for cls in (PlantParameters, GyroParameters))
    assert (plant.dead_zone, gyro.noise) == (3.0, 0.5)
    assert (plant.plant_model, plant.start_pitch_x) == ('linear', math.radians(2.0))
    assert (gyro.drift, plant.ball_radius) == (0.0, 0.027)
    (elsewhere / 'push.yaml').write_text(scenario.text)
    again = load_scenario('./push.yaml')
    assert {*again.parameters} == {*scenario.parameters}
    assert again.text == scenario.text
    assert again.profile == scenario.profile == 'ideal'
    # A path that is given in place of it is one from the current folder, as always.
    given = load_scenario('./push.yaml', '../mine/own.yaml')
    assert given.parameters.of(GyroParameters).noise == 0.5
    assert refusal(BallbotError, load_scenario, './push.yaml', 'own.yaml').startswith('own.yaml: ')


MISTAKES = [
    ('', None, 'the scenario is not a mapping'),
    ('- a\n', 1, 'the scenario is not a mapping'),
    ('duration: 1\n', 1, 'purpose is missing'),
    ('purpose: x\n', 1, 'duration is missing'),
    ('purpose: x\nduration: 0\n', 2, 'longer than 0 s'),
    ('purpose: x\nduration: -1\n', 2, '-1 is not within'),
    ('purpose: x\nduration: long\n', 2, "'long' is not a number"),
    (HEAD + 'goal: 1\n', 3, "unknown key 'goal'; known: changes, "),
    (HEAD + 'seed: -1\n', 3, '-1 is not within'),
    (HEAD + 'seed: 1.5\n', 3, '1.5 is not a whole number'),
    (HEAD + 'profile: real\n', 3, "unknown profile 'real'"),
    (HEAD + 'profile: real.yaml\n', 3, 'real.yaml: No such file'),
    (HEAD + 'start: 4\n', 3, 'is not a mapping'),
    (
        HEAD + 'start:\n  pitch_x_deg: 90\n',
        4,
        "'pitch_x_deg': 90 is not within -85.9 … 85.9 deg",
    ),
    (HEAD + 'start:\n  pitch_deg: 4\n', 4, "unknown key 'pitch_deg'"),
    (
        HEAD + 'start:\n  pitch_rate_x_deg_per_s: 2000\n',
        4,
        "'pitch_rate_x_deg_per_s': 2000 is not within -1145.9 … 1145.9 deg/s",
    ),
    (HEAD + 'start:\n  pitch_x_deg: .nan\n', 4, 'nan is not finite'),
    (HEAD + 'start:\n  pitch_x_deg: x\n', 4, "'x' is not a number"),
    (HEAD + 'sticks:\n  left: []\n', 4, "unknown key 'left'"),
    (HEAD + 'sticks:\n  vertical: 1\n', 4, 'is not a list'),
    (HEAD + 'mode: manual\n', 3, "'manual' is not one of remote, autonomous"),
    (HEAD + 'plant_model: 1\n', 3, '1 is not text'),
    (STICK + '    - [0, 1]\n', 5, 'is not a mapping'),
    (STICK + '    - {from: 1, value: 1}\n', 5, 'a segment needs a name'),
    (STICK + '    - {name: "", from: 1, value: 1}\n', 5, 'a segment needs a name'),
    (STICK + '    - {name: a, to: 1, value: 1}\n', 5, "'a' needs 'from', or points"),
    (STICK + '    - {name: a, from: 1}\n', 5, "'a' needs 'value', or points"),
    (STICK + '    - {name: a, from: 1, at: 1}\n', 5, "unknown key 'at'"),
    (STICK + '    - {name: a, from: 1, points: []}\n', 5, 'points, or from, to and value'),
    (STICK + '    - {name: a, points: [[1, 1]]}\n', 5, 'needs at least two points'),
    (STICK + '    - {name: a, points: [[1, 1], [1, 2]]}\n', 5, 'has no duration'),
    (STICK + '    - {name: a, points: [[1, 1], [2]]}\n', 5, '[2] is not a pair'),
    (
        STICK + '    - name: a\n      points:\n      - [2, 1]\n      - [1, 1]\n',
        8,
        'back to 1 s',
    ),
    (STICK + '    - {name: a, from: 2, to: 1, value: 1}\n', 5, 'goes back from 2 to 1 s'),
    (STICK + '    - {name: a, from: 2, to: 2, value: 1}\n', 5, 'goes back from 2 to 2 s'),
    (STICK + '    - {name: a, from: -1, value: 1}\n', 5, '-1 s is not within 0'),
    (STICK + '    - {name: a, from: 0, value: 101}\n', 5, '101 is not within -100 … 100'),
    (STICK + '    - {name: a, points: [[0, 0], [1, -101]]}\n', 5, '-101 is not within'),
    (STICK + '    - {name: a, from: 0, value: .nan}\n', 5, 'nan is not finite'),
    (
        STICK + '    - {name: a, from: 1, to: 3, value: 1}\n    - {name: b, from: 2, value: 1}\n',
        6,
        "time goes back: 'b' begins at 2 s, 'a' lasts until 3 s",
    ),
    (
        STICK + '    - {name: a, from: 1, value: 1}\n' + LATER,
        6,
        "'a' lasts until the end",
    ),
    (HEAD + 'pushes: {time: 1}\n', 3, 'is not a list'),
    (PUSH + '{duration: 1, force: 1, direction: left}\n', 4, 'a push needs a time'),
    (FAULT + '{type: off}\n', 4, 'a fault needs a component'),
    (FAULT + '{component: sonar}\n', 4, 'a fault needs a type'),
    (FAULT + '{component: gyro, type: stuck}\n', 4, "'gyro' is not one of gyro_x, gyro_y"),
    (FAULT + '{component: gyro_x, type: weak}\n', 4, 'gyro_x weak: only motor can have this'),
    (FAULT + '{component: gyro_x, type: stuck, amount: 1}\n', 4, 'gyro_x stuck: has no amount'),
    (FAULT + '{component: gyro_x, type: stuck, time: -1}\n', 4, 'time: -1 is not within 0'),
    (FAULT + '{component: gyro_x, type: stuck, time: a}\n', 4, "time: 'a' is not a number"),
    (FAULT + '{component: gyro_x, type: stuck, time: 6}\n', 4, 'after the end'),
    (FAULT + '{component: gyro_x, type: stuck, end: 1}\n', 4, "unknown key 'end'"),
    (PUSH + '{time: 1, force: 1, direction: left}\n', 4, 'a push needs a duration'),
    (PUSH + '{time: 1, duration: 1, direction: left}\n', 4, 'a push needs a force'),
    (PUSH + '{time: 1, duration: 1, force: 1}\n', 4, 'a push needs a direction'),
    (PUSH + '{time: -1, duration: 1, force: 1, direction: 0}\n', 4, '-1 s is not within'),
    (PUSH + '{time: 1, duration: 1, force: -1, direction: 0}\n', 4, '-1 is not within 0'),
    (PUSH + '{time: 1, duration: 1, force: 1, direction: up}\n', 4, "'up' is neither one of"),
    (PUSH + '{time: 1, duration: 1, force_x: 1}\n', 4, "unknown key 'force_x'"),
    (PUSH + '{time: 1, duration: .inf, force: 1, direction: 0}\n', 4, 'inf is not finite'),
    (PUSH + '{time: 1.0e+300, duration: 1, force: 1, direction: 0}\n', 4, ''),
    (PUSH + '{time: 1, duration: 1, force: 1.0e+308, direction: 0}\n', 4, ''),
    (HEAD + 'parameters:\n  plant_sim: {grafity: 1}\n', 4, "no parameter 'grafity'"),
    (HEAD + 'parameters:\n  plant_sim:\n    gravity: -1\n', 5, '-1 is not within'),
    (HEAD + 'parameters:\n  plant: {gravity: 1}\n', 4, "unknown node 'plant'"),
    (HEAD + 'parameters:\n  plant_sim: 1\n', 4, 'is not a mapping'),
    (HEAD + 'parameters:\n  "two\\nlines": 1\n', 4, 'is not a mapping'),
    (HEAD + 'expectations:\n  peak: {max: 1}\n', 4, "unknown metric 'peak'; known: settling"),
    (HEAD + 'expectations:\n  peak_pitch_deg: {}\n', 4, 'neither min nor max'),
    (HEAD + 'map: nosuch\n', 3, "unknown map 'nosuch'; shipped: corridor, track"),
    (HEAD + 'map: 5\n', 3, '5 is not text'),
    (HEAD + 'map: ./nosuch.png\n', 3, 'No such file'),
    (HEAD + 'map: track\nstart: {position_x: 1.5}\n', 4, 'is off the map'),
    (HEAD + 'map: track\nstart: {position_x: 0.9}\n', 4, 'puts the body in a wall'),
    (HEAD + 'profile: null\n', 3, 'profile: None is not a line of text'),
    (
        HEAD + 'parameters:\n  plant_sim: {scenario: x}\n',
        4,
        'cannot set the parameter scenario',
    ),
    (STICK + '    - 5\n', 5, "'vertical' 1 is not a mapping"),
    (STICK + '    - {name: a, from: x, value: 1}\n', 5, "'from': 'x' is not a number"),
    (STICK + '    - {name: a, from: 6, value: 1}\n', 5, 'begins after the end of the run'),
    (PUSH + '{time: 6, duration: 1, force: 1, direction: 0}\n', 4, 'after the end'),
    (PUSH + '{time: 1, duration: 0, force: 1, direction: 0}\n', 4, 'longer than 0 s'),
    (
        HEAD + 'expectations:\n  peak_pitch_deg: {min: 2, max: 1}\n',
        4,
        'min 2 is more than max 1',
    ),
    (HEAD + 'expectations:\n  lost_jobs: {max: none}\n', 4, "'max': 'none' is not a number"),
    (HEAD + 'expectations:\n  peak_pitch_deg: []\n', 4, 'neither min nor max'),
    (HEAD + 'expectations:\n  peak_pitch_deg: {max: 1, to: 0.5}\n', 4, 'before the release'),
    (HEAD + 'expectations:\n  wall_clearance_m: {min: 1}\n', 4, 'needs a map'),
    (
        HEAD + 'expectations:\n  peak_pitch_deg: {max: 1, from: 3, to: 2}\n',
        4,
        'is empty or not within the run',
    ),
    (
        HEAD + 'expectations:\n  peak_pitch_deg: {max: 1, from: 5}\n',
        4,
        'within the run, 0 … 5 s',
    ),
    (HEAD + 'expectations:\n  peak_pitch_deg: {max: 1, to: 6}\n', 4, 'within the run, 0 … 5 s'),
    (HEAD + 'expectations:\n  peak_pitch_deg:\n  - {max: 1}\n  - 1\n', 6, 'not a mapping'),
    (HEAD + 'expectations:\n  peak_pitch_deg: {most: 1}\n', 4, "unknown key 'most'"),
    (HEAD + 'expectations:\n  peak_pitch_deg: {max: .nan}\n', 4, 'nan is not finite'),
    (HEAD + 'duration: 6\n', 3, "duplicate key 'duration'"),
    (HEAD + 'start: {\n', 4, 'not YAML'),
]


def test_mistakes_are_reported_in_one_line_with_file_and_line(load):
    for text, line, told in MISTAKES:
        message = refusal(BallbotError, load, text)
        assert message.startswith('/'), text
        assert (f'mine.yaml:{line}: ' if line else 'mine.yaml: ') in message, text
        assert told in message, text


@pytest.mark.parametrize('number', ['9' * 400, '0x' + 'f' * 400, '1.0e+999'])
@pytest.mark.parametrize(
    'key',
    [
        'start: {{position_x: {}}}',
        'sticks: {{vertical: [{{name: a, from: {}, value: 1}}]}}',
        'pushes: [{{time: 1, duration: {}, force: 1, direction: 0}}]',
        'expectations: {{peak_pitch_deg: {{max: {}}}}}',
    ],
)
def test_a_number_beyond_the_range_of_floats_is_refused(load, key, number):
    with pytest.raises(BallbotError, match=r'^[^\n]*mine\.yaml:3: [^\n]*$'):
        load(HEAD + key.format(number) + '\n')


@pytest.mark.parametrize('text', ['purpose:\nduration: 1\n', 'purpose: []\nduration: 1\n'])
def test_a_purpose_is_text(load, text):
    with pytest.raises(BallbotError, match=r'mine\.yaml:1: '):
        load(text)


WORDS = (
    'purpose: x\n', 'duration: 1\n', 'seed: ', 'start:', 'sticks:', 'pushes:', 'parameters:',
    'expectations:', 'vertical: ', 'time: ', 'name: a', 'from: ', 'points: ', 'max: ',
    'plant_sim: ', 'gravity: ',
)  # fmt: skip


@given(yaml_texts(*WORDS))
def test_any_text_is_read_or_refused_in_one_line(load, text):
    assert is_read_or_refused_in_one_line(load, text)


@given(st.text(st.characters(exclude_categories=('Cc', 'Cs')), max_size=300))
def test_any_name_is_found_or_refused_in_one_line(name):
    assert is_read_or_refused_in_one_line(load_scenario, name)
