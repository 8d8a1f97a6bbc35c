"""Runs of a brick whose tasks take time, and whose readings and duties pass the link."""

import random
from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest
from laws import refusal
from parts import make_loop, run_loop

from ballbot_ros.controllers.codegen.application import program_sha256
from ballbot_ros.controllers.codegen.implementation import compose_controller, implementation_for
from ballbot_ros.controllers.codegen.toolchain import HOST, missing_tool
from ballbot_ros.controllers.design.loop_analysis import brick_dead_time
from ballbot_ros.controllers.design.sampled_loop import LoopDelays
from ballbot_ros.controllers.document.program import ControlProgram
from ballbot_ros.engine.brick_tasks import BrickTasks
from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.compiled_loop import CompiledLoop
from ballbot_ros.engine.golden import duty_sha256
from ballbot_ros.engine.rows import RobotRows
from ballbot_ros.engine.scenario.reader import load_scenario, scenario_names
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.engine.trajectory import TrajectoryLog
from ballbot_ros.errors import StudyError
from ballbot_ros.files import share_directory
from ballbot_ros.lab.studies.programs import check_loads
from ballbot_ros.parameters import (
    ControllerParameters,
    GyroParameters,
    ParameterError,
    ParameterSet,
)
from ballbot_ros.parameters.brick_time import TaskCosts
from ballbot_ros.parameters.files import read_parameter_file
from ballbot_ros.parameters.timing import FIRST_TICK_NS, MILLISECOND_NS, TICK_NS
from ballbot_ros.robot.brick.brick import DeviceInputs
from ballbot_ros.robot.brick.link import analog_age, link_of
from ballbot_ros.robot.brick.schedule import TaskTiming

TIMED = {'plant_sim.kernel': True, 'plant_sim.link': True}
NO_TIMES = {
    f'controller.{each.name}': type(each.default)(0)
    for each in fields(TaskCosts)
    if each.name.endswith(('_instructions', '_time')) or each.name == 'bus_cycles'
}


def parameters_with(values):
    parameters = ParameterSet()
    for target, value in values.items():
        parameters.set(*target.split('.'), value)
    return parameters


@pytest.mark.parametrize('name', scenario_names())
def test_a_kernel_without_times_changes_no_duty(name):
    hashes = []
    for values in ({'plant_sim.kernel': False}, {'plant_sim.kernel': True, **NO_TIMES}):
        scenario = load_scenario(name)
        for target, value in values.items():
            scenario.parameters.set(*target.split('.'), value)
        hashes.append(duty_sha256(scenario))
    assert hashes[0] == hashes[1]


def jobs_of(ticks):
    return [job for tick in ticks for job in tick.outputs.jobs]


def test_a_tick_has_a_job_of_each_task_that_is_due():
    ticks = run_loop(make_loop(TIMED), 2.0)
    by_task = {}
    for job in jobs_of(ticks):
        by_task.setdefault(job.task, []).append(job)
    counts = {name: len(jobs) for name, jobs in by_task.items()}
    assert counts == {
        'task_init': 1, 'task_ts1': 500, 'task_ts2': 100, 'task_ts3': 20, 'task_lcd': 4,
    }  # fmt: skip
    for tick in ticks:
        now_us = tick.truth.stamp_ns // 1000
        ends = [job.end for job in tick.outputs.jobs]
        assert ends == sorted(ends)
        for job in tick.outputs.jobs:
            assert job.release == now_us < job.start <= job.end < now_us + 4000
    # Calibration is much shorter than control, and a log packet takes time.
    lengths = [job.end - job.start for job in by_task['task_ts1']]
    calibration, control = lengths[1:251], lengths[252:]
    assert max(calibration) * 5 < min(control)
    assert len({*control}) == 2
    assert set(np.diff(np.flatnonzero(np.diff(control) > 0))) == {25}


def test_a_duty_acts_after_the_job_and_the_link():
    leaning = {'plant_sim.start_pitch_x': 0.02}
    for phase, expected_ms in ((0, 2), (1, 1)):
        loop = make_loop({**TIMED, **leaning, 'plant_sim.link_phase': phase})
        ticks = run_loop(loop, 1.6)
        delays = {tick.outputs.delay_ns for tick in ticks[260:] if tick.outputs.delay_ns}
        # 6 µs in the interrupt, 230 µs on the wire.
        assert delays == {expected_ms * MILLISECOND_NS + 236_000}, phase
    ticks = run_loop(make_loop({**leaning, 'plant_sim.kernel': True}), 1.6)
    late = 0
    for tick in ticks[260:]:
        end_us = next(job.end for job in tick.outputs.jobs if job.task == 'task_ts1')
        assert tick.outputs.delay_ns in (0, 1000 * end_us - tick.truth.stamp_ns)
        late += tick.outputs.delay_ns > 0
    assert late > 100


def test_a_job_that_is_not_finished_leaves_the_duty_unchanged():
    slow = {**TIMED, 'controller.control_instructions': 76_000, 'controller.bus_cycles': 0.0,
            'controller.time_variation': 0.4, 'plant_sim.start_pitch_x': 0.01}  # fmt: skip
    ticks = run_loop(make_loop(slow), 3.0)
    lost = late = 0
    for before, tick in pairwise(ticks[260:]):
        jobs = [job for job in tick.outputs.jobs if job.task == 'task_ts1']
        lost += sum(job.is_lost for job in jobs)
        if all(job.is_lost for job in jobs):
            late += 1
            assert tick.outputs.duty == before.outputs.duty
    assert lost > 30
    assert late > 30
    assert len({tick.outputs.duty for tick in ticks}) > 20


def test_the_sonar_is_read_when_its_bus_is_free():
    """A reading takes 4.2 ms: each 4 ms task_ts2 gets a new one at every second tick only."""
    read = {}
    for name, others in (('ideal', {}), ('timed', {'plant_sim.kernel': True})):
        settings = parameters_with({'controller.ts2_period': 4, **others}).of(ControllerParameters)
        program, tasks = ControlProgram(settings), BrickTasks(settings)
        read[name] = []
        for tick in range(40):
            inputs = DeviceInputs((600, 600), (0, 0), sonar_cm=100 + tick, battery_mv=8000)
            tasks.tick(program, FIRST_TICK_NS + tick * TICK_NS, inputs)
            read[name].append(program.state.sonar_cm)
    assert read['ideal'] == [0, *range(100, 139)]
    assert read['timed'] == [0, 0, *np.repeat(range(100, 138, 2), 2).tolist()]


@pytest.mark.skipif(bool(missing_tool(HOST)), reason='no C compiler')
def test_the_c_program_has_the_same_times_and_duties():
    settings = {**TIMED, 'controller.ts2_period': 4, 'controller.tone_gain': 3,
                'controller.mode': 'autonomous', 'controller.time_auto': 1200,
                'controller.time_variation': 0.3, 'plant_sim.map': 'track',
                'plant_sim.start_position_x': 0.2}  # fmt: skip
    runs = []
    for implementation in ('python', 'c'):
        loop = make_loop({**settings, 'controller.implementation': implementation})
        ticks = run_loop(loop, 2.4)
        runs.append([(tick.outputs.duty, tick.outputs.delay_ns, tick.outputs.jobs)
                     for tick in ticks])  # fmt: skip
    assert runs[0] == runs[1]


def test_laws_are_compiled_with_their_times():
    draw = random.Random(7)
    for tick_us in (600.0, 3500.0):
        parameters = parameters_with({
            **TIMED, 'controller.implementation': 'pid', 'controller.tick_time': tick_us,
            'controller.time_variation': 0.2, 'controller.bus_cycles': 0.0,
            'plant_sim.start_pitch_x': 0.02, 'plant_sim.seed': draw.randrange(100),
        })  # fmt: skip
        loaded = compose_controller(parameters)
        loops = []
        for _ in range(2):
            made = implementation_for(parameters.of(ControllerParameters), loaded).make()
            loops.append(ClosedLoop(parameters, Scenario(), program=made))
        fast = CompiledLoop(loops[0], loops[0].program, parameters, Scenario())
        log = fast.advance(500)
        ticks = run_loop(loops[1], 2.0)
        assert log.duty.tolist() == [list(tick.outputs.duty) for tick in ticks]
        ordinary = TrajectoryLog(parameters.of(ControllerParameters))
        for tick in ticks:
            ordinary.add(tick.truth, *tick.outputs.duty, tick.outputs)
        assert log.timing.tobytes() == ordinary.trajectory().timing.tobytes()
        assert len({tick.outputs.duty for tick in ticks}) > 5
        is_lost = any(job.is_lost for job in jobs_of(ticks))
        assert is_lost == (tick_us > 3000.0)


@pytest.mark.parametrize('seconds', [0.0, 1.3])
def test_a_copy_goes_on_by_itself(seconds):
    """Also if another one makes ticks between its own, while jobs last longer than one."""
    slow = {'controller.control_instructions': 50_000, 'controller.time_variation': 1.0}
    loop = make_loop({**TIMED, **slow, 'plant_sim.start_pitch_x': 0.02})
    run_loop(loop, seconds)
    twin, third = (loop.copy(loop.program.copy(), Scenario()) for _ in range(2))
    expected = [tick.outputs for tick in run_loop(loop, 2.0)]
    pairs = [(twin.tick().outputs, third.tick().outputs) for _ in expected]
    assert pairs == [(each, each) for each in expected]


def test_a_free_running_controller_has_the_time_that_it_takes():
    parameters = parameters_with({**TIMED, 'controller.lockstep': False})
    loop = make_loop({})
    tasks = BrickTasks(parameters.of(ControllerParameters))
    outputs = tasks.tick(loop.program, FIRST_TICK_NS + TICK_NS, loop.sample())
    assert (outputs.delay_ns, outputs.jobs) == (0, [])


@pytest.mark.parametrize(
    ('values', 'problem'),
    [
        (
            {'processor_clock': 9.0},
            'at 9 MHz the interrupts need 91% of the processor and the tasks 32%, together more',
        ),
        ({'link_time': 11.0}, 'controller.link_time: longer than interrupt_time'),
        (
            {'implementation': 'pid', 'tick_time': 3900.0},
            'at 48.055 MHz the interrupts need 17% of the processor and the tasks 98%, together',
        ),
    ],
)
def test_an_overloaded_brick_is_refused(values, problem):
    parameters = parameters_with(
        {'plant_sim.kernel': True, **{f'controller.{name}': each for name, each in values.items()}}
    )
    assert problem in refusal(ParameterError, compose_controller, parameters)


def test_the_overloaded_run_of_a_study_is_named():
    parameters = parameters_with({'plant_sim.kernel': True})
    for own_tasks in ((), (TaskTiming('tick', 1, 4),)):
        rows = RobotRows(parameters, {'controller.processor_clock': np.array([48.0, 9.0, 7.0])}, 3)
        problem = refusal(StudyError, check_loads, rows[ControllerParameters], 40, own_tasks)
        assert problem.startswith('controller: at 9 MHz the interrupts need 91%')
        assert problem.endswith(' (run 41)')
        check_loads(rows[ControllerParameters][:1], 40, own_tasks)


@pytest.mark.parametrize('phase', [0, 1])
@pytest.mark.parametrize('settings', [{'plant_sim.kernel': True}, {'plant_sim.link': True}, TIMED])
def test_the_design_counts_with_the_mean_delays_of_a_run(settings, phase):
    settings = {**settings, 'plant_sim.link_phase': phase, 'controller.time_variation': 0.3,
                'controller.log_count': 255, 'plant_sim.start_pitch_x': 0.02}  # fmt: skip
    parameters = parameters_with(settings)
    ticks = run_loop(make_loop(settings), 3.0)[300:]
    # A duty that stays the same is not sent again.
    delays_ms = [tick.outputs.delay_ns * 1e-6 for tick in ticks if tick.outputs.delay_ns]
    link = link_of(parameters.of(GyroParameters))
    ages_ms = [analog_age(link, tick.truth.stamp_ns) * 1e-6 for tick in ticks]
    expected = LoopDelays.of(parameters)
    assert len(delays_ms) > 200
    assert np.mean(delays_ms) == pytest.approx(expected.actuator, abs=0.003)
    assert (np.mean(ages_ms) if link.is_on else 0.0) == pytest.approx(expected.gyro, abs=0.02)


def test_gains_of_the_document_do_not_bear_a_brick_and_the_quiet_ones_do():
    borne, needed = brick_dead_time(ParameterSet())
    assert borne == pytest.approx(3.458, abs=1e-3)
    assert needed == pytest.approx(1.0 + 1.55 + 2.236, abs=1e-3)
    quiet = read_parameter_file(share_directory() / 'config' / 'gains' / 'quiet.yaml')
    assert brick_dead_time(quiet)[0] > 5.0 * needed


def test_times_of_another_program_are_refused():
    own = program_sha256()[:16]
    compose_controller(parameters_with({'controller.times_of': own}))
    parameters = parameters_with({'controller.times_of': 'abcdef'})
    assert refusal(ParameterError, compose_controller, parameters) == (
        f'controller.times_of: abcdef is another program than the document, which is {own}'
    )
    parameters = parameters_with({'controller.times_of': own, 'controller.implementation': 'pid'})
    assert f'{own} is another program than ballbot_ros/controllers/pid.py' in refusal(
        ParameterError, compose_controller, parameters
    )
