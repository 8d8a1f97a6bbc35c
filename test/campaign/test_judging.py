"""The judgement of a trial: each broken guarantee alone is noticed."""

from dataclasses import replace
from signal import Signals

import pytest

from ballbot_ros.recording.messages.topics import CLOCK, GYRO_IMU
from campaign.environments import ENVIRONMENTS, UnusualEnvironment
from campaign.remains import Remains
from campaign.run import RunEnd, ticks_of
from campaign.signals import (
    LOSS_TICKS,
    SHORT_S,
    CommandSignal,
    Helper,
    HelperMoment,
    HelperSignal,
    Moment,
    NodeSignal,
)
from campaign.site import End
from campaign.strangers import OPEN_TOPICS, Content, Nonsense, Stranger

DUTIES = [(float(tick % 7), 1.0) for tick in range(900)]
SHA = 'a' * 64
ENDED = End(status=1, took_s=4.0, survivors=())
FAILED = RunEnd(
    ENDED,
    'gyro_driver was killed by SIGKILL',
    {'outcome': 'failed', 'reason': 'gyro_driver silent for 2 s', 'ticks': 500},
    Remains(finished=True, truths=501, duties=tuple(DUTIES[:500]), motors_off=True),
)
COMPLETED = RunEnd(
    ENDED._replace(status=0),
    '',
    {'outcome': 'passed', 'reason': '', 'ticks': 500, 'duty_sha256': SHA},
    Remains(finished=True, truths=501, duties=tuple(DUTIES[:500])),
)


def in_mid_run(victim='gyro_driver', number=Signals.SIGKILL):
    return NodeSignal(victim, number, Moment.MIDDLE, 0.5)


def judge(run, attempt=None):
    return (attempt or in_mid_run()).judge(run, DUTIES, SHA)


def with_result(run, **changes):
    return replace(run, result={**run.result, **changes})


def with_remains(run, **changes):
    return replace(run, remains=replace(run.remains, **changes))


def test_a_run_that_failed_as_expected_passes():
    assert judge(FAILED) == []


BROKEN = [
    (replace(FAILED, end=ENDED._replace(status=None)), 'still running 15 s after'),
    (replace(FAILED, end=ENDED._replace(survivors=('controller',))), 'left processes behind'),
    (replace(FAILED, end=ENDED._replace(status=0)), 'outcome failed, status 0'),
    (replace(FAILED, end=ENDED._replace(status=-11), result={}), 'outcome none, status -11'),
    (replace(FAILED, text='error: disk: full', result={}), "gyro_driver: 'error: disk: full'"),
    (replace(FAILED, text='Traceback (most recent call last):'), "printed 'Traceback"),
    (replace(FAILED, text='controller was killed by SIGSEGV'),
     "printed 'was killed by SIGSEGV'"),
    (with_result(FAILED, outcome='stopped'), 'outcome stopped, status 1'),
    (with_result(FAILED, reason='controller silent for 2 s'), 'does not name gyro_driver'),
    (replace(FAILED, remains=None), 'no recording, although the run had 500 ticks'),
    (with_remains(FAILED, problem='cut off'), 'cannot be read: cut off'),
    (with_remains(FAILED, finished=False), 'not finished'),
    (with_remains(FAILED, missing='3 of /gyro'), 'is incomplete: 3 of /gyro'),
    (with_remains(FAILED, strange=2), '2 recorded duties do not belong to the next tick'),
    (with_remains(FAILED, duties=tuple(DUTIES[:499])), 'recorded 499 duties of 500'),
    (with_remains(FAILED, motors_off=False), 'the last recorded duty is (2.0, 1.0)'),
    (with_remains(FAILED, duties=((5.0, 5.0), *DUTIES[1:500], (0.0, 0.0))), 'from tick 0 on'),
]  # fmt: skip


def test_every_broken_guarantee_is_a_complaint():
    for run, failure in BROKEN:
        failures = judge(run)
        assert any(failure in each for each in failures), (failure, failures)


def test_a_run_may_complete_despite_the_fault_only_near_its_end():
    near_the_end = NodeSignal('gyro_driver', Signals.SIGKILL, Moment.END, 1.4)
    assert judge(COMPLETED, near_the_end) == []
    assert judge(with_remains(COMPLETED, motors_off=True), near_the_end) == [
        'completed, but with the motors off'
    ]
    assert judge(COMPLETED) != []
    assert judge(with_result(COMPLETED, duty_sha256='b' * 64), near_the_end) == [
        'the duties differ from those of an undisturbed run'
    ]
    short = with_remains(COMPLETED, duties=tuple(DUTIES[:490]))
    assert 'recorded 490 duties of 500' in judge(short, near_the_end)
    assert 'recorded 0 duties of 500' in judge(replace(COMPLETED, remains=None), near_the_end)


def test_a_lost_recorder_may_cost_a_second():
    lost = with_result(FAILED, reason='recorder silent for 2 s', ticks=700)
    lost = with_remains(lost, finished=False, duties=tuple(DUTIES[: 700 - LOSS_TICKS]))
    assert judge(lost, in_mid_run('recorder')) == []
    more = with_remains(lost, duties=tuple(DUTIES[: 699 - LOSS_TICKS]))
    assert judge(more, in_mid_run('recorder')) == ['recorded 399 duties of 700']
    never_begun = with_result(replace(lost, remains=None), ticks=0)
    assert judge(never_begun, in_mid_run('recorder')) == []


@pytest.mark.parametrize(
    ('number', 'status', 'holds'),
    [
        (Signals.SIGINT, 130, True), (Signals.SIGTERM, 143, True), (Signals.SIGTERM, -15, True),
        (Signals.SIGKILL, -9, True), (Signals.SIGINT, 1, False), (Signals.SIGTERM, 130, False),
    ],
)  # fmt: skip
def test_the_exit_status_is_that_of_the_signal(number, status, holds):
    attempt = CommandSignal(number, Moment.MIDDLE, 0.1)
    stopped = replace(FAILED, end=ENDED._replace(status=status), result={'outcome': 'stopped'})
    failures = attempt.judge(stopped, DUTIES, SHA)
    assert (failures == []) == holds, failures


def test_nodes_may_outlive_a_killed_command_for_a_while_only():
    attempt = CommandSignal(Signals.SIGKILL, Moment.MIDDLE, 0.1)
    end = End(status=-9, took_s=1.0, survivors=('plant_sim',))
    killed = RunEnd(end, '', {}, with_remains(FAILED, finished=False).remains)
    assert attempt.judge(killed, DUTIES, SHA) == []
    driving = with_remains(killed, motors_off=False)
    assert attempt.judge(driving, DUTIES, SHA) == [
        'the last recorded duty is (2.0, 1.0): the motors are not off'
    ]
    later = replace(killed, end=end._replace(took_s=99.0))
    assert attempt.judge(later, DUTIES, SHA) == [
        'nodes still alive 15 s after the command was killed'
    ]


def test_a_run_that_the_plant_completed_need_not_end_with_the_motors_off():
    attempt = CommandSignal(Signals.SIGINT, Moment.END, 1.9)
    stopped = replace(COMPLETED, end=ENDED._replace(status=130), result={'outcome': 'stopped'})
    for ticks, holds in ((ticks_of(SHORT_S), True), (ticks_of(SHORT_S) - 1, False)):
        run = with_remains(stopped, duties=tuple(DUTIES[:ticks]))
        assert (attempt.judge(run, DUTIES, SHA) == []) == holds


def test_an_earlier_clock_counts_as_another_plant():
    refused = replace(FAILED, end=ENDED._replace(status=2), remains=None)
    refused = with_result(
        refused, reason='another plant publishes /clock in this ROS domain', ticks=0
    )
    for topic, holds in ((CLOCK, True), (GYRO_IMU, False)):
        attempt = Stranger([Nonsense(topic, Content.NAN, 0.02)], 0.1, in_the_loop=True)
        assert (attempt.judge(refused, DUTIES, SHA) == []) == holds


def test_nonsense_may_end_a_run_only_in_the_loop():
    sends = [Nonsense(OPEN_TOPICS[0], Content.NAN, 0.02)]
    named = with_result(FAILED, reason="/stranger publishes on 'gyro', but takes no part")
    for run, in_the_loop, holds in (
        (COMPLETED, True, True), (COMPLETED, False, True), (named, True, True),
        (named, False, False), (FAILED, True, False),
    ):  # fmt: skip
        failures = Stranger(sends, 0.1, in_the_loop).judge(run, DUTIES, SHA)
        assert (failures == []) == holds, failures


def test_a_run_whose_fork_server_ends_fails_and_names_it():
    attempt = HelperSignal(Helper.FORK_SERVER, Signals.SIGKILL, HelperMoment.MIDDLE, 0.5)
    named = with_result(FAILED, reason='fork_server (process 7) was killed by SIGKILL')
    assert judge(named, attempt) == []
    assert judge(FAILED, attempt)
    early = replace(FAILED, end=ENDED._replace(status=2), text=named.reason, result={})
    assert judge(early, attempt) == []
    assert judge(replace(early, text=''), attempt)


def test_a_run_whose_end_guard_ends_completes():
    attempt = HelperSignal(Helper.END_GUARD, Signals.SIGTERM, HelperMoment.MIDDLE, 0.5)
    assert judge(COMPLETED, attempt) == []
    assert judge(FAILED, attempt)


@pytest.mark.parametrize('environment', ENVIRONMENTS, ids=lambda each: each.name)
def test_a_run_in_an_unusual_environment_completes_or_is_refused_in_a_line(environment):
    refused = replace(
        FAILED, end=ENDED._replace(status=2), text=f'error: {environment.refusal}', result={}
    )
    attempt = UnusualEnvironment(environment)
    complete = attempt.judge(COMPLETED, SHA, DUTIES[:500]) == []
    assert complete == (not environment.refusal)
    assert (attempt.judge(refused, SHA, DUTIES) == []) == bool(environment.refusal)
    if not complete:
        assert attempt.judge(replace(refused, text=2 * f'{refused.text}\n'), SHA, DUTIES)
