"""Properties of single runs: the command, recordings, the library and the page agree."""

import json
import math

import numpy as np
import pytest
import yaml

import ballbot_ros as bb
from ballbot_ros.analysis.assessment import assess
from ballbot_ros.analysis.figure_parts import IntervalKind
from ballbot_ros.analysis.metrics import ExpectationVerdict, Verdict
from ballbot_ros.analysis.report import report_document
from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.cli.result import print_result, result_json
from ballbot_ros.run.execution import execute
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.spec import RunOptions, RunSpec
from ballbot_ros.viewer.overlay import MarkKind
from ballbot_ros.viewer.playback_run import run_marks

RECOVERS = (
    'after each push: eventually within 0.6 s: always for 0.5 s: '
    'abs(pitch_x_deg) < 1 deg and abs(pitch_y_deg) < 1 deg'
)
PROPERTIES = {
    'recovers': RECOVERS,
    'gentle start': 'until the first push: always: abs(duty_x_percent) < 60 percent',
    'upright': 'always: abs(pitch_x_deg) < 5 and abs(pitch_y_deg) < 5',
    'slow': 'always: abs(speed_x_m_per_s) < 0.3',
    'drives by itself': 'while autonomous: always: pitch_x_deg > 90',
}
RECORDED_ONLY = {'quiet gyro': 'always: abs(gyro_x_deg_per_s - 600) < 100'}
FAILING = {
    'still': 'always: abs(duty_x_percent) < 20',
    'long': 'after push 2: always for 30 s: pitch_x_deg < 90',
}
CONTENT = {
    'purpose': 'is pushed',
    'duration': 5.0,
    'pushes': [
        {'time': 2.0, 'duration': 0.1, 'force': 1.0, 'direction': 'forward'},
        {'time': 3.3, 'duration': 0.1, 'force': 0.5, 'direction': 'left'},
    ],
}


@pytest.fixture(scope='module')
def run_with(tmp_path_factory):
    def run(properties, **options):
        folder = tmp_path_factory.mktemp('run')
        path = folder / 'pushed.yaml'
        path.write_text(
            yaml.safe_dump({**CONTENT, 'properties': properties}, sort_keys=False), encoding='utf-8'
        )
        output = folder / 'output'
        spec = RunSpec.of_scenario(
            str(path), RunOptions(processes=Processes.NONE, output=output, **options)
        )
        return spec, execute(spec)

    return run


@pytest.fixture(scope='module')
def good(run_with):
    return run_with({**PROPERTIES, **RECORDED_ONLY})


@pytest.fixture(scope='module')
def bad(run_with):
    return run_with({**PROPERTIES, **RECORDED_ONLY, **FAILING}, record=False)


def of(result, name):
    (found,) = (each for each in result.properties if each.of.name == name)
    return found


def test_the_robustness_is_the_distance_from_violation(good):
    _, result = good
    trajectory = result.trajectory
    pitch, duty = np.degrees(trajectory.psi), trajectory.duty.astype(float)
    # A bound on the peak pitch is as far away as the metric says.
    peak = result.metrics['peak_pitch_deg']
    assert of(result, 'upright').robustness == pytest.approx(5.0 - peak, abs=1e-12)
    worst = int(np.argmax(np.abs(pitch).max(axis=1)))
    assert of(result, 'upright').moment == trajectory.time[worst]
    # Up to the push at 2 s, which is tick 500; the release is tick 250.
    assert of(result, 'gentle start').robustness == 60.0 - np.abs(duty[250:500, 0]).max()
    # The pushes end at 2.1 s and 3.4 s: ticks 525 and 850.
    upright = 1.0 - np.abs(pitch).max(axis=1)
    after = [
        max(upright[tick + k : tick + k + 126].min() for k in range(151)) for tick in (525, 850)
    ]
    assert of(result, 'recovers').robustness == min(after) > 0.0
    moment = round(of(result, 'recovers').moment / 0.004)
    assert upright[moment] == min(after)
    speed = np.diff(trajectory.position[:, 0]) / np.diff(trajectory.time)
    assert of(result, 'slow').robustness == 0.3 - np.abs(speed[249:]).max()


def test_what_has_no_time_holds_without_robustness(good):
    _, result = good
    vacuous = of(result, 'drives by itself')
    assert vacuous.robustness == math.inf
    assert vacuous.holds
    assert str(vacuous) == 'drives by itself no time to judge'
    assert vacuous.as_json()['robustness'] is vacuous.as_json()['moment_s'] is None


def test_properties_count_for_the_verdict(good, bad):
    spec, result = good
    assert (result.verdict, result.exit_status) == (Verdict.PASSED, 0)
    assert {each['holds'] for each in result_json(spec, result)['properties']} == {True}
    _, result = bad
    assert (result.verdict, result.exit_status) == (Verdict.NOT_MET, 1)
    still = of(result, 'still')
    assert result.reason == (
        'quiet gyro undecided: gyro_x_deg_per_s needs a recording, '
        f'still {still.robustness:.4g} % at {still.moment:.3f} s, '
        'long undecided: it looks 30 s ahead from 3.4 s, but that ends at 5 s'
    )


def test_the_command_shows_them(bad, capsys):
    print_result(*bad, as_json=False)
    table = capsys.readouterr().out
    for text in ('recovers', 'from violation at', 'no time to judge', 'undecided: it looks 30 s'):
        assert text in table
    print_result(*bad, as_json=True)
    shown = {each['name']: each for each in json.loads(capsys.readouterr().out)['properties']}
    assert list(shown) == [*PROPERTIES, *RECORDED_ONLY, *FAILING]
    still = shown['still']
    assert still['text'] == FAILING['still']
    assert (still['unit'], still['holds'], still['undecided']) == ('%', False, '')
    assert still['robustness'] < 0.0 < still['moment_s']
    assert shown['long']['robustness'] is None
    assert shown['quiet gyro']['undecided'] == 'gyro_x_deg_per_s needs a recording'


def test_a_recording_gives_the_same(good):
    _, result = good
    assessment = assess(read_run(result.recording))
    assert assessment.outcome is Verdict.PASSED
    for live, recorded in zip(result.properties, assessment.properties, strict=True):
        assert recorded.verdict is ExpectationVerdict.MET
        assert recorded.judgement.of == live.of
        # The recorded pitch is a quaternion.
        assert recorded.judgement.robustness == pytest.approx(live.robustness, abs=1e-9)
        assert recorded.judgement.moment == pytest.approx(live.moment, nan_ok=True)
    shown = assessment.as_json()['properties']
    assert [each['verdict'] for each in shown] == ['met'] * len(result.properties)
    (mark,) = (each for each in assessment.run.marked if each.name == 'recovers')
    assert (mark.start, mark.kind) == (of(result, 'recovers').moment, IntervalKind.PROPERTY)
    page = report_document(assessment)
    assert '<h2>Properties</h2>' in page
    assert 'abs(pitch_x_deg) &lt; 1 deg' in page
    marks = [each for each in run_marks(assessment.run) if each.kind is MarkKind.PROPERTY]
    assert any('recovers' in each.text for each in marks)


def test_the_library_shows_them(good):
    _, result = good
    run = bb.open(result.recording)
    assert [each.judgement.of.name for each in run.properties] == [*PROPERTIES, *RECORDED_ONLY]
    assert 'recovers' in run._repr_html_()


def test_pushes_from_outside_count(good):
    spec, result = good
    run = read_run(result.recording)
    assert [each.is_external for each in run.pushes] == [False, False]
    assert spec.scenario.events == {
        'push': [(each.start, pytest.approx(each.end)) for each in run.pushes],
        'fault': [],
    }
