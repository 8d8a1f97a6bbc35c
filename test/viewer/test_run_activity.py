"""What the overlay says about the run on a live page."""

from dataclasses import replace

import pytest

from ballbot_ros.analysis.metrics import Judgement
from ballbot_ros.engine.scenario.scenario import Expectation
from ballbot_ros.recording.messages.run_reports import PlantReport
from ballbot_ros.viewer.overlay import Banner, BannerKind, Timeline
from ballbot_ros.viewer.run_activity import (
    BACK,
    PAUSE,
    RATES,
    REPORT,
    RESET,
    STEP,
    RunActivity,
    Session,
    decode_session,
    encode_session,
)

STARTING = Session('square')
MET = Judgement(Expectation('wall_clearance_m', minimum=0.05), 0.0851)
MISSED = Judgement(Expectation('final_position_x_m', 1.1, 1.3, start=0.0, end=7.5), 0.3218)
UNKNOWN = Judgement(Expectation('settling_time_s', maximum=3.0), float('nan'))
FALLEN = 'out of control, the motors are off'
INFO, BUSY, GOOD, BAD = BannerKind


def ended(verdict, reason='', *judgements, recording=''):
    result = {
        'outcome': verdict,
        'reason': reason,
        'recording': recording,
        'expectations': [{**each.as_json(), 'holds': each.holds} for each in judgements],
    }
    session = decode_session(encode_session('square', result))
    return RunActivity(session=session, has_pose=True, has_lost_plant=True)


def running(session=None, **report):
    return RunActivity(session=session, has_pose=True, report=PlantReport('1 a', **report))


@pytest.mark.parametrize(
    ('activity', 'text', 'kind'),
    [
        (RunActivity(), 'waiting for a run …', BUSY),
        (RunActivity(session=STARTING), 'starting square …', BUSY),
        (RunActivity(session=STARTING, has_lost_plant=True), 'starting square …', BUSY),
        (RunActivity(report=PlantReport('1 a')), 'waiting for a run …', BUSY),
        (RunActivity(STARTING, report=PlantReport('1 a')), 'starting square …', BUSY),
        (RunActivity(report=PlantReport('1 a', outcome='failed')), 'run failed', BAD),
        (running(missing=('controller', 'recorder')), 'waiting for controller, recorder …', BUSY),
        (running(is_paused=True, awaits_start=True), 'the run is about to begin', BUSY),
        (running(is_paused=True), 'paused', INFO),
        (running(is_paused=True, problem='slow'), 'paused', INFO),
        (running(problem='waiting for the duty'), 'waiting for the duty', BAD),
        (running(STARTING, outcome='completed'), 'square has ended, judging …', BUSY),
        (running(outcome='completed'), 'run completed', GOOD),
        (running(outcome='stopped'), 'run stopped', INFO),
        (running(outcome='failed', problem='wall hit'), 'run failed', BAD),
        (replace(running(), is_out_of_control=True), FALLEN, BAD),
        (replace(running(is_paused=True), is_out_of_control=True), 'paused', INFO),
        (RunActivity(has_pose=True, is_out_of_control=True), FALLEN, BAD),
        (RunActivity(has_pose=True, has_lost_plant=True), 'the plant has ended', BAD),
        (ended('passed'), 'square: passed', GOOD),
        (ended('expectations not met'), 'square: expectations not met', BAD),
        (ended('failed', 'no map'), 'square: failed', BAD),
        (ended('stopped'), 'square: stopped', INFO),
    ],
)
def test_the_banner_says_what_the_run_is_doing(activity, text, kind):
    banner = activity.overlay.banner
    assert (banner.text, banner.kind) == (text, kind)


def test_a_run_that_just_runs_has_no_banner():
    assert running(STARTING).overlay.banner is None
    assert RunActivity(has_pose=True).overlay.banner is None, 'a player reports nothing'


def test_the_details_of_a_result_are_what_was_not_met():
    activity = ended('expectations not met', 'much', MET, MISSED, UNKNOWN, recording='/r/x.mcap')
    assert activity.overlay.banner == Banner(
        'square: expectations not met',
        BAD,
        (
            'final x from start 0.322 m, 0 s to 7.5 s: expected 1.1 … 1.3',
            'settling time –: expected ≤ 3',
        ),
        REPORT,
        'report',
    )
    details = ended('expectations not met', 'much', *[MISSED] * 9).overlay.banner.details
    assert len(details) == 5
    assert details[-1] == 'and 5 more'


def test_missed_properties_are_details_with_their_moments():
    properties = [
        {'name': 'stands', 'holds': False, 'moment_s': 3.216},
        {'name': 'stops', 'holds': False, 'moment_s': None},
        {'name': 'drives', 'holds': True, 'moment_s': 1.0},
        {'name': 'falls', 'holds': None, 'moment_s': 1.0},
    ]
    result = {'outcome': 'properties not met', 'reason': '', 'properties': properties}
    session = decode_session(encode_session('square', result))
    details = RunActivity(session=session, has_pose=True).overlay.banner.details
    assert details == ('stands: missed at 3.22 s', 'stops')


def test_a_run_that_passed_shows_a_few_metrics_of_the_whole_run():
    met = Judgement(Expectation('final_position_x_m', 0.3, end=7.5), 0.3218)
    details = ended('passed', '', met, *[MET] * 20).overlay.banner.details
    assert details == ('wall clearance 0.085 m',) * 4


def test_the_reason_of_a_failure_is_a_detail():
    for activity in (
        ended('failed', 'gyro silent'),
        ended('failed', 'gyro silent', MET),
        running(outcome='failed', problem='gyro silent'),
    ):
        assert activity.overlay.banner.details[0] == 'gyro silent', activity
        assert activity.overlay.banner.link == ''


def test_buttons_and_speed_show_what_is_in_effect():
    overlay = running(is_paused=True, pace=0.5).overlay
    assert [each.name for each in overlay.buttons if each.is_pressed] == [PAUSE]
    assert overlay.rate == '0.5×'
    assert overlay.rate in overlay.rates
    overlay = running(pace=0.3).overlay
    assert [each.name for each in overlay.buttons] == [PAUSE, STEP, RESET]
    assert overlay.timeline is None
    of_command = replace(running(STARTING), time=10.5).overlay
    assert [each.name for each in of_command.buttons] == [PAUSE, STEP, RESET, BACK]
    assert of_command.timeline == Timeline(20.0)
    assert not any(each.is_pressed for each in overlay.buttons)
    assert overlay.rate == '', 'none of the choices'
    assert running(pace=0.0).overlay.rate == 'max'
    assert RATES['0.1×'] == 0.1
    assert overlay.can_drive


def test_what_has_ended_can_not_be_controlled():
    for activity in (
        RunActivity(has_pose=True),
        running(outcome='completed'),
        RunActivity(has_pose=True, report=PlantReport('1 a'), has_lost_plant=True),
    ):
        overlay = activity.overlay
        assert (overlay.buttons, overlay.rates, overlay.can_drive) == ((), (), False), activity


def test_a_session_survives_its_encoding():
    assert decode_session(encode_session('square')) == STARTING
    content = {
        'outcome': 'failed', 'reason': 'much', 'recording': '/r/x.mcap', 'metrics': {'a': None},
        'expectations': [{**each.as_json(), 'holds': each.holds} for each in (MET, MISSED)],
    }  # fmt: skip
    session = decode_session(encode_session('square', content))
    assert (session.scenario, session.recording) == ('square', '/r/x.mcap')
    (detail,) = session.result.details
    assert detail.startswith('final x from start')
    unjudged = [{**MET.as_json(), 'holds': None}]
    content |= {'expectations': unjudged, 'recording': None}
    expected = Session('square', Banner('square: failed', BAD, ('much',), link_text='report'))
    assert decode_session(encode_session('square', content)) == expected
