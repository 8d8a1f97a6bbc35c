"""The summary of a run, as JSON and in the diagnostics."""

import math
from dataclasses import replace

from ballbot_ros.lockstep.lockstep import RunIdentity
from ballbot_ros.lockstep.participants import Membership, Participant
from ballbot_ros.lockstep.run_actions import Outcome, ParameterChange, PublishStatus, RunSummary
from ballbot_ros.recording.messages.run_reports import run_status, summary_json, summary_words
from ballbot_ros.robot.plant.ground_truth import Push

START_NS = 1_000_000_000
MEMBER = Membership(
    Participant('gyro_driver', '/robot/gyro_driver', 'here', 7, 'a', 'ours 1', 'ff' * 32),
    START_NS + 500_000_000,
    is_successor=True,
)
SUMMARY = RunSummary(
    outcome=Outcome.FAILED,
    reason='broken',
    ticks=3,
    duty_sha256='ab',
    real_time_factor=2.0,
    late_ticks=4,
    resends=5,
    round_trips_s=(0.001, 0.002, 0.003),
    start_ns=START_NS,
    members=(MEMBER,),
    external_pushes=(Push(START_NS + 250_000_000, START_NS + 350_000_000, (0.0, 2.0)),),
    parameter_changes=(ParameterChange(0.5, 'controller', 'k_f', (1.0, math.nan)),),
)


def test_the_json_keeps_its_keys():
    summary = summary_json(SUMMARY)
    assert summary.pop('participants')[0]['since_s'] == 0.5
    assert summary.pop('external_pushes') == [
        {'start_s': 0.25, 'end_s': 0.35, 'force_n': [0.0, 2.0], 'torque_n_m': [0.0, 0.0]}
    ]
    assert summary.pop('parameter_changes') == [
        {'time_s': 0.5, 'tick': 125, 'node': 'controller', 'parameter': 'k_f', 'value': '1, nan'}
    ]
    assert summary.pop('round_trip_ms') == {'p50': 2.0, 'p99': 2.98, 'max': 3.0}
    assert summary == {
        'outcome': 'failed',
        'reason': 'broken',
        'ticks': 3,
        'duty_sha256': 'ab',
        'real_time_factor': 2.0,
        'late_ticks': 4,
        'resends': 5,
    }


def test_the_diagnostics_have_round_trips_in_one_line():
    words = summary_words(SUMMARY)
    assert words.pop('round trip p50 / p99 / max [ms]') == '2.00 / 2.98 / 3.00'
    assert list(words) == ['outcome', 'reason', 'duty_sha256', 'real_time_factor']


def test_round_trips_that_were_not_measured_are_none():
    summary = replace(SUMMARY, round_trips_s=())
    assert summary_json(summary)['round_trip_ms'] is None
    assert not any('round trip' in word for word in summary_words(summary))


def test_the_status_of_a_run_has_a_result_only_at_its_end():
    action = PublishStatus(RunIdentity('1 a', START_NS), True, ('gyro',), (MEMBER,))
    begun = run_status(action)
    assert (begun.run, begun.is_lockstep, begun.periodic_topics) == ('1 a', True, ('gyro',))
    assert begun.participants['gyro_driver'].startswith('/robot/gyro_driver (process 7 on here), ')
    assert begun.result == {}
    ended = run_status(
        PublishStatus(RunIdentity('1 a', START_NS), True, ('gyro',), (MEMBER,), SUMMARY)
    )
    assert ended.result == {
        'outcome': 'failed', 'reason': 'broken', 'ticks': '3', 'duty_sha256': 'ab',
    }  # fmt: skip
