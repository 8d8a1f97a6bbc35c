"""The files of tunings: what they say, and the errors in them."""

import numpy as np
import pytest
from laws import given, is_read_or_refused_in_one_line, refusal, yaml_texts

from ballbot_ros.errors import BallbotError, StudyError
from ballbot_ros.lab.search.candidates import share_of, values_of
from ballbot_ros.lab.search.objective import Limit
from ballbot_ros.lab.search.optimiser import Method
from ballbot_ros.lab.search.tuning import TuningReader, read_tuning, tuning_names
from ballbot_ros.lab.studies.variables import Levels, LogUniform, Uniform, WholeNumbers
from ballbot_ros.parameters import ControllerParameters

HEAD = 'purpose: x\nscenario: push\nruns: 4\n'
TUNE = 'tune:\n  python:\n    controller.k_f.2: {uniform: [-3.0, -1.0]}\n'
SUM = 'objective:\n  sum:\n    peak_pitch_deg: 1.0\n'
OF = HEAD + 'tune:\n  python:\n    '
FOR = HEAD + TUNE + 'objective:\n  '
FULL = HEAD + TUNE + SUM
UPRIGHT = 'properties:\n  upright: "always: abs(pitch_x_deg) < 5"\n'


@pytest.fixture(scope='module')
def read(tmp_path_factory):
    path = tmp_path_factory.mktemp('tunings') / 'mine.yaml'

    def read_text(text, **options):
        path.write_bytes(text.encode(errors='replace'))
        return read_tuning(str(path), **options)

    return read_text


def start_of(tuning):
    """The values at the start of a search."""
    return [each.tolist()[0] for each in values_of(tuning.tuned, tuning.start[None]).values()]


def test_a_tuning_has_everything_that_its_file_says(read):
    tuning = read(
        HEAD + UPRIGHT + 'vary:\n  plant_sim.body_mass: {uniform: [0.6, 0.8]}\nseed: 7\n'
        'metrics: [settling_time_s]\n'
        'tune:\n  python:\n    controller.k_f.2: {uniform: [-3.0, -1.0], start: -2.0}\n'
        '    controller.a_d: {log_uniform: [0.1, 0.9]}\n'
        '    controller.log_count: {uniform: [1, 50]}\n'
        '    controller.mode: {list: [remote, autonomous]}\n'
        '  lqg:\n    controller.k_f.1: {uniform: [-1.0, 0.0]}\n'
        'objective:\n  over: 0.95\n  sum: {peak_pitch_deg: 2, upright: 0.5}\n'
        'limits:\n  duty_rms_percent: {max: 50}\n  dead_time_margin_ms: {min: 5.0}\n'
        'candidates: 100\npopulation: 12\nunseen: 50\n'
    )
    assert (tuning.name, tuning.controller, tuning.method) == ('mine', 'python', Method.CMA)
    assert (tuning.candidates, tuning.population, tuning.unseen) == (100, 12, 50)
    assert tuning.generations == 9
    (study,) = tuning.studies
    assert (study.runs, study.seed) == (4, 7)
    assert study.metrics == ('settling_time_s', 'peak_pitch_deg', 'duty_rms_percent')
    assert [each.name for each in study.variables] == ['plant_sim.body_mass']
    kinds = [type(each.distribution) for each in tuning.tuned]
    assert kinds == [Uniform, LogUniform, WholeNumbers, Levels]
    nominal = study.spec.parameters.of(ControllerParameters)
    in_force = [-2.0, nominal.a_d, nominal.log_count, nominal.mode]
    assert start_of(tuning) == [
        pytest.approx(in_force[0]),
        pytest.approx(nominal.a_d),
        *in_force[2:],
    ]
    assert tuning.objective.weights == {'peak_pitch_deg': 2.0, 'upright': 0.5}
    assert tuning.objective.share == 0.95
    assert tuning.objective.limits == (
        Limit('duty_rms_percent', maximum=50.0),
        Limit('dead_time_margin_ms', minimum=5.0),
    )


def test_the_defaults(read):
    tuning = read(FULL)
    assert (tuning.candidates, tuning.population, tuning.unseen) == (1000, 4, 1000)
    assert (tuning.objective.over, tuning.objective.limits) == ('mean', ())
    nominal = tuning.studies[0].spec.parameters.of(ControllerParameters)
    assert start_of(tuning) == [pytest.approx(nominal.k_f[1])]
    assert tuning.studies[0].metrics == ('peak_pitch_deg',)


def test_options_take_the_place_of_the_files_values(read, tmp_path):
    text = FULL.replace(SUM, '  lqg:\n    controller.k_f.2: {uniform: [-3.0, -1.0]}\n' + SUM)
    options = {'candidates': 8, 'seed': 3, 'controller': 'lqg', 'method': Method.RANDOM}
    tuning = read(text, **options)
    assert (tuning.candidates, tuning.studies[0].seed, tuning.controller) == (8, 3, 'lqg')
    assert tuning.method is Method.RANDOM
    path = tmp_path / 'other.yaml'
    path.write_text('/**/controller:\n  ros__parameters: {k_f: [0.0, -2.5, 0.0, 0.0]}\n')
    assert start_of(read(FULL, parameter_file=path)) == [pytest.approx(-2.5)]


def test_several_scenarios_have_common_measures(read):
    text = FULL.replace('scenario: push', 'scenario: [stationary, push]')
    assert [each.spec.scenario.name for each in read(text).studies] == ['stationary', 'push']
    only = 'peak_pitch_deg[3,7]'
    known = read(FULL.replace('peak_pitch_deg', only)).objective.weights
    assert list(known) == [only]
    message = refusal(BallbotError, read, text.replace('peak_pitch_deg', only))
    assert f'unknown measure {only!r}' in message
    twice = text.replace('[stationary, push]', '[push, push]')
    assert 'mine.yaml:2: two scenarios have the same name: push' in refusal(
        BallbotError, read, twice
    )


def test_the_shipped_tunings_can_be_read():
    for name in tuning_names():
        tuning = read_tuning(name)
        assert tuning.name == name
        assert tuning.studies[0].purpose


@pytest.mark.parametrize(
    'distribution',
    [
        Uniform(-3.0, 5.0), LogUniform(1e-3, 1e3), Levels((3, 1, 2)), Levels(('a', 'b')),
        WholeNumbers(1, 9, Uniform(0.5, 9.5)), Levels((True,)),
    ],
)  # fmt: skip
def test_the_share_of_a_value_has_this_value(distribution):
    values = distribution.values(np.linspace(0.0, 1.0, 50, endpoint=False)).tolist()
    for value in (*values, *distribution.ends):
        share = share_of(distribution, value)
        assert 0.0 <= share < 1.0
        (found,) = distribution.values(np.array([share])).tolist()
        assert found == (pytest.approx(value) if isinstance(value, float) else value)


def test_a_search_can_begin_at_exactly_zero():
    assert share_of(Uniform(0.0, 8.0), 0.0) == 0.0


MISTAKES = [
    ('', None, 'the tuning is not a mapping'),
    (HEAD, 1, 'tune is missing'),
    (HEAD + TUNE, 1, 'objective is missing'),
    (TUNE + SUM, 1, 'purpose is missing'),
    (FULL + 'goal: 1\n', 10, "unknown key 'goal'; known: candidates, "),
    (FULL + 'controller: python\n', 10, "unknown key 'controller'"),
    (FULL + '5: 1\n', 10, 'unknown key 5'),
    (FULL.replace('push', 'shove'), 2, "unknown scenario 'shove'"),
    (FULL.replace('scenario: push', 'scenario: []'), 2, 'is not a line of text'),
    # What is tuned
    (HEAD + 'tune:\n' + SUM, 4, "'tune' is not a mapping"),
    (HEAD + 'tune: {}\n' + SUM, 4, 'nothing is tuned: needs a controller'),
    (HEAD + 'tune:\n  5: {}\n' + SUM, 5, '5 is no name of a controller'),
    (HEAD + 'tune:\n  python: {}\n  null: {}\n' + SUM, 6, 'None is no name of a controller'),
    (HEAD + 'tune:\n  python:\n' + SUM, 5, "'python' is not a mapping"),
    (HEAD + 'tune:\n  python: {}\n' + SUM, 5, 'nothing of python is tuned'),
    (HEAD + 'tune:\n  lqgg: {}\n' + SUM, 4, "no controller 'lqgg' (did you mean lqg?)"),
    (OF + '5: {uniform: [0, 1]}\n' + SUM, 6, '5: not a parameter of one of'),
    (OF + 'controller.k_g.2: {uniform: [0, 1]}\n' + SUM, 6, "no parameter 'k_g.2'"),
    (OF + 'controller.k_f: {uniform: [0, 1]}\n' + SUM, 6, 'its elements can: controller.k_f.1'),
    (OF + 'controller.sound_freq: {uniform: [40, 50]}\n' + SUM, 6, 'does not depend on it'),
    (OF + 'controller.user.x: {uniform: [0, 1]}\n' + SUM, 6, 'no such'),
    (OF + 'plant_sim.body_mass: {uniform: [0.6, 0.8]}\n' + SUM, 6, 'only parameters of controller'),
    (OF + 'push.1.force: {uniform: [0, 1]}\n' + SUM, 6, 'only parameters of controller'),
    (OF + 'controller.k_f.2: 3\n' + SUM, 6, 'is not a mapping'),
    (OF + 'controller.k_f.2: {start: -2}\n' + SUM, 6, 'needs exactly one of uniform, log_uniform'),
    (OF + 'controller.k_f.2: {grid: [-3, -1, 3]}\n' + SUM, 6, 'grid is only for studies'),
    (OF + 'controller.k_f.2: {log_uniform: [-3, -1]}\n' + SUM, 6, 'needs ends above 0'),
    (OF + 'controller.k_f.2: {uniform: [-1e300, 0]}\n' + SUM, 6, 'not within'),
    (OF + 'controller.k_f.2: {uniform: [-1.0e+300, 0]}\n' + SUM, 6, 'not within'),
    (
        OF + 'controller.k_f.2:\n      uniform: [-3, -1]\n      start: -4\n' + SUM,
        6,
        'controller.k_f.2: the start -4 is not within -3 … -1',
    ),
    (
        OF + 'controller.k_f.2: {uniform: [1, 2]}\n' + SUM,
        6,
        'the start, by default the value in force, -1.56981 is not within 1 … 2',
    ),
    (OF + 'controller.k_f.2: {list: [-3, -1], start: -2}\n' + SUM, 6, '-2 is not one of -3.0, -1'),
    (OF + 'controller.mode: {list: [autonomous]}\n' + SUM, 6, 'remote is not one of autonomous'),
    (
        OF + 'controller.k_f.2:\n      uniform: [-3, -1]\n      start: null\n' + SUM,
        8,
        'None is not a number',
    ),
    (
        OF + 'controller.k_f.2: {uniform: [-3, -1], start: .nan}\n' + SUM,
        6,
        'nan is not within',
    ),
    (
        OF
        + 'controller.ball_radius: {uniform: [0.02, 0.03]}\n'
        + SUM
        + 'vary:\n  plant_sim.ball_radius: {uniform: [0.02, 0.03]}\n',
        6,
        'controller.ball_radius varies already',
    ),
    # For what
    (HEAD + TUNE + 'objective:\n', 7, "'objective' is not a mapping"),
    (HEAD + TUNE + 'objective: {}\n', 7, 'needs sum, measures with their weights'),
    (FOR + 'goal: 1\n', 8, "unknown key 'goal'; known: over, sum"),
    (FOR + 'sum: {}\n', 8, 'sum: has no measures'),
    (FOR + 'sum: [peak_pitch_deg]\n', 8, "'sum' is not a mapping"),
    (
        FOR + 'sum: {peak_pitch: 1}\n',
        8,
        "unknown measure 'peak_pitch'; did you mean peak_pitch_deg",
    ),
    (FOR + 'sum: {5: 1}\n', 8, "unknown measure '5'"),
    (FOR + 'sum: {uprite: 1}\n' + UPRIGHT, 8, "unknown measure 'uprite'; did you mean upright?"),
    (FOR + 'sum: {peak_pitch_deg: 0}\n', 8, 'the weight is not above 0'),
    (FOR + 'sum: {peak_pitch_deg: -1}\n', 8, 'the weight is not above 0'),
    (FOR + 'sum: {peak_pitch_deg: 1.0e+308}\n', 8, '1e+09 at most'),
    (FOR + 'sum: {peak_pitch_deg: .nan}\n', 8, 'nan is not finite'),
    (FOR + 'sum: {peak_pitch_deg: much}\n', 8, "'much' is not a number"),
    (FOR + 'sum: {wall_clearance_m: 1}\n', 7, 'wall_clearance_m needs a map'),
    *(
        (FOR + f'over: {over}\n  sum: {{peak_pitch_deg: 1}}\n', 8, 'neither mean, worst nor a')
        for over in ('best', 'null', '[mean]', '{}', 'true', '0.0', '1.0', '1', '.nan', '-0.5')
    ),
    (FULL + 'limits: 5\n', 10, "'limits' is not a mapping"),
    (FULL + 'limits:\n  peak: {max: 1}\n', 11, "unknown measure 'peak'"),
    (FULL + 'limits:\n  duty_rms_percent: {}\n', 11, 'needs either min or max'),
    (FULL + 'limits:\n  duty_rms_percent: {min: 1, max: 2}\n', 11, 'needs either min or max'),
    (FULL + 'limits:\n  duty_rms_percent: {most: 2}\n', 11, "unknown key 'most'; known: max, min"),
    (FULL + 'limits:\n  duty_rms_percent: {max: .inf}\n', 11, 'inf is not finite'),
    # Numbers
    *(
        (FULL + f'{key}: {value}\n', 10, f'{key}: {shown} is not a whole number, {least} … ')
        for key, least in (('candidates', 1), ('population', 2), ('unseen', 1))
        for value, shown in (('0', '0'), ('1.5', '1.5'), ('null', 'None'), ('10000000', '10000000'))
    ),
    (FULL.replace('runs: 4', 'runs: 100000000'), 3, 'of a generation, population times runs'),
    (FULL.replace('runs: 4', 'runs: 1000001'), 3, 'those of all candidates more than'),
    # What is the studies'
    (FULL + 'metrics: []\n', 10, 'metrics: the list is empty'),
    (FULL + 'metrics: null\n', 10, "'metrics' is not a list"),
    (FULL + 'metrics:\n- [peak_pitch_deg]\n', 11, 'unknown metric'),
    (FULL + 'metrics:\n- peak_pitch_deg\n- peak_pitch_deg\n', 12, 'is doubled'),
    (
        FULL.replace('runs: 4\n', 'sampling: grid\n')
        + 'vary: {plant_sim.backlash: {grid: [0, 0.1, 3]}}\n',
        3,
        'a grid has no robots that were not seen',
    ),
]


def test_mistakes_are_reported_in_one_line_with_file_and_line(read):
    for text, line, told in MISTAKES:
        message = refusal(BallbotError, read, text)
        assert (f'mine.yaml:{line}: ' if line else 'mine.yaml: ') in message, (text, message)
        assert told in message, (text, message)


def test_options_that_are_not_possible_are_refused(read):
    for options, told in (
        ({'candidates': 10**30}, '--candidates 1'),
        ({'seed': 2**63}, '--seed 9223372036854775808: not within'),
        ({'controller': 'pid'}, 'mine.yaml tunes python'),
    ):
        assert told in refusal(BallbotError, lambda o=options: read(FULL, **o))


def test_the_error_for_an_unknown_tuning_lists_the_shipped_ones(tmp_path):
    assert '(did you mean quiet?); shipped: fast, quiet' in refusal(
        StudyError, read_tuning, 'quite'
    )
    assert 'No such file' in refusal(BallbotError, read_tuning, './none.yaml')
    assert 'Is a directory' in refusal(BallbotError, read_tuning, f'{tmp_path}/')


WORDS = (
    'purpose: x\n', 'scenario: push\n', 'runs: 3\n', 'python: ', 'controller.k_f.2: ', 'uniform: ',
    'log_uniform: ', 'list: ', 'start: ', 'sum: ', 'over: ', 'peak_pitch_deg: ', 'max: ', '0.1',
    'dead_time_margin_ms: ', 'worst', 'upright: ',
)  # fmt: skip


@given(yaml_texts(*(f'{key}: ' for key in sorted(TuningReader.keys)), *WORDS))
def test_any_text_is_read_or_refused_in_one_line(read, text):
    assert is_read_or_refused_in_one_line(read, text)


@given(yaml_texts(*WORDS))
def test_any_section_is_read_or_refused_in_one_line(read, text):
    for before in (OF, FOR, FULL + 'limits:\n  ', HEAD + SUM + 'tune:\n  ', FULL + 'metrics: '):
        rest = SUM if before == OF else ''
        assert is_read_or_refused_in_one_line(read, f'{before}{text}\n{rest}')


def test_the_dead_time_margin_limits_only_the_program_whose_loop_is_analysed(read):
    text = FULL + 'limits:\n  dead_time_margin_ms: {min: 5.0}\n'
    assert read(text).objective.limits == (Limit('dead_time_margin_ms', minimum=5.0),)
    pid = 'tune:\n  pid:\n    controller.user.pitch_p: {uniform: [1.0, 50.0]}\n'
    assert read(text.replace(TUNE, pid)).objective.limits == ()
