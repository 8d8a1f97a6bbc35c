"""The timing of ticks, from known jobs."""

import numpy as np
import pytest
from parts import make_loop, run_loop, values_of

from ballbot_ros.analysis.metrics import judge, measure, measure_one
from ballbot_ros.engine.scenario.metrics import OF_TASKS
from ballbot_ros.engine.scenario.scenario import Expectation, Measure
from ballbot_ros.engine.scenario.task_timing import DUTY_AGE_US, LOST, RESPONSE_US, SHARE, job_row
from ballbot_ros.engine.scenario.task_timing import task_timing as timing_of
from ballbot_ros.engine.trajectory import TrajectoryLog, load_trajectory, save_trajectory
from ballbot_ros.parameters import CONTROLLER, PLANT
from ballbot_ros.robot.brick.kernel import Job

FIRST = 1_000_000
TIMED = {'kernel': True, 'interrupt_time': 0.0, 'link_time': 0.0, 'bus_cycles': 0.0}
"""The processor has time for nothing but jobs."""


def timing(jobs, duties, delays_us, **values):
    """Return the timing of ticks with jobs of task, release, start, end; times from the first."""
    rows = [
        job_row(Job(name, *(FIRST + each for each in times[:3]), *times[3:]))
        for name, *times in jobs
    ]
    stamps_ns = 1000 * (FIRST + 4000 * np.arange(len(duties)))
    duty = np.array(duties, np.int8)[:, np.newaxis] * [1, -1]
    jobs = np.array(rows, np.int64).reshape(-1, 6)
    settings = values_of(CONTROLLER, **{**TIMED, **values})
    return timing_of(settings, jobs, stamps_ns, duty, 1000 * np.array(delays_us))


def test_a_job_counts_in_the_tick_in_which_it_ends():
    found = timing(
        [
            ('task_init', 0, 0, 0),
            ('task_ts1', 0, 100, 1100, 200),
            ('task_lcd', 0, 1100, 4000, 900),
            ('task_ts1', 4000, 4100, 8000),
            ('task_ts1', 8000, 8000, 8500),
            ('tick', 8500, 8600, 8700),
            ('task_ts1', 12_000, 12_000, 16_300),
        ],
        [0] * 5,
        [0] * 5,
    )
    assert found[:, RESPONSE_US].tolist() == [1100, 4000, 500, -1, 4300]
    expected = np.array([800 + 2000, 3900, 600, 0, 4300]) / 4000
    assert found[:, SHARE] == pytest.approx(expected)
    assert not found[:, LOST].any()


def test_in_a_controller_with_own_tasks_all_but_the_idle_one_set_the_duty():
    own = [('fast', 0, 10, 60), ('slow', 0, 60, 300), ('idle', 4000, 4000, 4900)]
    assert timing(own, [0] * 2, [0] * 2)[:, RESPONSE_US].tolist() == [300, -1]


def test_lost_alarms_of_all_tasks_count():
    lost = [(name, at, at, at, 0, True) for name, at in
            (('task_ts1', 4000), ('task_ts3', 4000), ('task_ts1', 8000))]  # fmt: skip
    found = timing([('task_ts1', 0, 10, 60), *lost], [0] * 3, [0] * 3)
    assert found[:, LOST].tolist() == [0, 2, 1]
    assert found[:, RESPONSE_US].tolist() == [60, -1, -1]


def test_a_new_duty_is_as_old_as_the_tick_in_which_its_job_started():
    jobs = [
        ('task_ts1', 0, 100, 1000),  # no other duty than before the run
        ('task_ts1', 4000, 4100, 5000),  # a new one, which waits for the link
        ('task_ts1', 12_000, 12_100, 13_000),  # a new one
        ('task_ts1', 12_900, 13_000, 13_500),  # which the last job of the tick confirms
        ('task_ts1', 16_000, 16_500, 20_500),  # a new one, from the tick before
    ]
    found = timing(jobs, [0, 30, 30, 40, 40, -10], [0, 2236, 0, 1500, 0, 1236])
    assert found[:, DUTY_AGE_US].tolist() == [-1, 2236, -1, 1500, -1, 4000 + 1236]


def test_interrupts_and_bus_take_their_share():
    parameters = {'bus_cycles': 200.0, 'interrupt_time': 10.0}
    found = timing([('task_ts1', 0, 100, 1100)], [0, 0], [0, 0], **parameters)
    bus = 0.0384 * 200.0 / 48.055
    # An interrupt of 10 µs takes 11.9 µs next to the bus, in whole ones 12.
    assert found[:, SHARE] == pytest.approx([bus + (1.0 - bus) * each for each in (0.262, 0.012)])


def test_jobs_of_missing_ticks_are_left_out():
    jobs = np.array([job_row(Job('task_ts1', *[FIRST + at] * 3)) for at in (0, 4000, 8000, 90_000)])
    stamps_ns = 1000 * np.array([FIRST, FIRST + 8000])
    duty, delays = np.zeros((2, 2)), np.zeros(2, np.int64)
    found = timing_of(values_of(CONTROLLER, kernel=True), jobs, stamps_ns, duty, delays)
    assert found[:, RESPONSE_US].tolist() == [0, 0]


@pytest.mark.parametrize('values', [{'kernel': False}, {'lockstep': False}])
def test_without_times_there_are_no_rows(values):
    assert timing([], [0, 0], [0, 0], **values).shape == (0, 4)


def run_of(settings, duration=2.0):
    loop = make_loop({f'plant_sim.{name}': value for name, value in settings.items()})
    log = TrajectoryLog(values_of(CONTROLLER, **settings))
    for tick in run_loop(loop, duration):
        log.add(tick.truth, *tick.outputs.duty, tick.outputs)
    return log.trajectory()


PUSHED = {'kernel': True, 'link': True, 'link_phase': 1}


def test_the_metrics_of_a_run():
    plant = values_of(PLANT)
    measured = measure(run_of(PUSHED), plant)
    # 12 µs of interrupt, then 5734 instructions of 2 cycles, and 623 of a log packet with its call.
    mhz = 48.055 - 0.0384 * 200.0
    packet_ms = (2 * (5734 + 623) + 20.0 * 48.055) / mhz / 1000
    assert measured['response_time_ms'] == pytest.approx(packet_ms + 0.012, abs=0.02)
    assert measured['lost_jobs'] == 0.0
    assert 0.2 < measured['utilisation'] < 0.4
    assert all(np.isnan(measure(run_of({}), plant)[name]) for name in OF_TASKS)
    link_only = measure(run_of({'link': True}), plant)
    assert (link_only['response_time_ms'], link_only['utilisation']) == (0.0, 0.0)


def test_expectations_hold_fail_and_lack_a_value():
    plant, run = values_of(PLANT), run_of(PUSHED)
    bounds = [Expectation('response_time_ms', maximum=0.4), Expectation('lost_jobs', maximum=0.0),
              Expectation('utilisation', 0.1, 0.5, start=1.5),
              Expectation('response_time_ms', maximum=0.1)]  # fmt: skip
    assert [each.holds for each in judge(bounds, run, plant)] == [True, True, True, False]
    for each in judge(bounds, run_of({}), plant):
        assert not each.holds
        assert ' without a value instead of ' in str(each)
    # In this window no job ends.
    assert np.isnan(measure_one(Measure('response_time_ms', 9.0), run, plant))


def test_a_file_keeps_the_timing(tmp_path):
    run = run_of(PUSHED, 0.1)
    save_trajectory(tmp_path / 'run.npz', run, {})
    assert load_trajectory(tmp_path / 'run.npz')[0].timing.tobytes() == run.timing.tobytes()
