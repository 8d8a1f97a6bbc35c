"""The tasks of a controller on the brick, and how long its jobs take on a machine."""

import random
from itertools import cycle

import pytest
from laws import refusal

from ballbot_ros.controllers.codegen.implementation import compose_controller
from ballbot_ros.engine import brick_schedule
from ballbot_ros.engine.brick_schedule import (
    MEASURED_TICKS,
    measured_time,
    schedule_of,
    warnings_of,
)
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, ParameterError, ParameterSet
from ballbot_ros.robot.brick.kernel import TICK_US

TWO_TASKS = """\
from ballbot_ros.controllers import Controller, task


class Mine(Controller):
    @task(period_ms=4, priority=2)
    def fast(self, readings):
        return 0, 0

    @task(period_ms=20, priority=1)
    def slow(self, readings):
        pass


class Slow(Controller):
    @task(period_ms=20, priority=3)
    def slow(self, readings):
        return 0, 0
"""


def composed(**values):
    """Return parameters of the controller with the kernel, and its class if it has one."""
    parameters = ParameterSet()
    for name, value in {'kernel': True, **values}.items():
        parameters.set(CONTROLLER, name, value)
    return parameters, compose_controller(parameters)


def schedule(**values):
    parameters, loaded = composed(**values)
    settings = parameters.of(ControllerParameters)
    tasks, simulated_ms = schedule_of(settings, loaded)
    return settings, tasks, simulated_ms


def test_the_tasks_of_the_document_take_their_longest_paths():
    _, tasks, simulated_ms = schedule(bus_cycles=0.0, cycles_per_instruction=1.0)
    clock_mhz = 48.055
    assert [(task.name, task.period_ms, task.time_us) for task in tasks] == [
        ('task_init', 0, 7),
        ('task_ts1', 4, round((5734 + 623) / clock_mhz + 20.0 + 0.5)),
        ('task_ts2', 20, 1),
        ('task_ts3', 100, round((432 + 13) / clock_mhz + 1000.0 + 0.5)),
        ('task_lcd', 500, 96),
    ]
    assert tasks[1].share == pytest.approx(tasks[1].time_us / 4000)
    assert all(task.is_exact and task.worst_us == task.simulated_us for task in tasks)
    assert simulated_ms == 20_000


def test_the_bus_lengthens_times_but_not_shares_and_the_variation_both():
    (_, plain, _), (_, with_bus, _), (_, varied, _) = (
        schedule(bus_cycles=0.0), schedule(bus_cycles=600.0), schedule(time_variation=1.0)
    )  # fmt: skip
    assert with_bus[1].time_us > 1.5 * plain[1].time_us
    assert with_bus[1].share == pytest.approx(plain[1].share, rel=0.01)
    assert varied[1].share == pytest.approx(2.0 * plain[1].share, rel=0.01)


def test_a_simulation_has_a_hyperperiod(tmp_path):
    (tmp_path / 'mine.py').write_text(
        TWO_TASKS.replace('=20, priority=1', '=40004, priority=1'), encoding='utf-8'
    )
    _, tasks, simulated_ms = schedule(implementation=f'{tmp_path}/mine.py:Mine')
    assert [task.period_ms for task in tasks] == [4, 40_004]
    assert simulated_ms == 40_004


def test_the_idle_task_is_no_task_of_the_brick(tmp_path):
    (tmp_path / 'mine.py').write_text(TWO_TASKS, encoding='utf-8')
    _, tasks, _ = schedule(implementation=f'{tmp_path}/mine.py:Slow')
    assert [task.name for task in tasks] == ['slow']


@pytest.mark.parametrize(
    ('values', 'parameter'),
    [
        ({'implementation': 'pid', 'tick_time': 0.0}, 'controller.tick_time'),
        ({'obstacle_instructions': 0}, 'controller: time of task_ts2'),
    ],
)
def test_a_task_without_a_time_is_refused(values, parameter):
    parameters, loaded = composed(**values)
    settings = parameters.of(ControllerParameters)
    assert refusal(ParameterError, schedule_of, settings, loaded).startswith(f'{parameter}: 0 µs')


@pytest.mark.parametrize(
    ('tick_time', 'phase', 'late_ms'),
    [(900, -1, []), (1100, -1, [2]), (1100, 0, []), (1100, 1, [2]), (2200, -1, [2, 2]),
     (3200, -1, [2, 4])],
)  # fmt: skip
def test_a_duty_that_misses_the_link_is_told(tick_time, phase, late_ms):
    settings, tasks, _ = schedule(
        implementation='pid', tick_time=float(tick_time), link_phase=phase, bus_cycles=0.0
    )
    lines = [*warnings_of(settings, tasks)]
    assert len(lines) == len(late_ms)
    for line, each in zip(lines, late_ms, strict=True):
        assert f'set its duty {tasks[0].worst_us} µs after' in line
        assert line.endswith(f'leaves {each} ms late')


def test_tasks_that_may_lose_alarms_are_told():
    settings, tasks, _ = schedule(
        control_instructions=70_000, bus_cycles=0.0, time_variation=0.6, log_count=255
    )
    ts1, ts2 = tasks[1], tasks[2]
    assert ts1.worst_us > 4 * TICK_US
    assert (ts2.worst_us, ts2.simulated_us is not None) == (None, True)
    lines = [*warnings_of(settings, tasks)]
    assert f'task_ts1 may end {ts1.worst_us} µs after its alarm, beyond its 4 ms: ' in lines[0]
    assert lines[1].startswith('task_ts2 may end any time after its alarm, beyond its 20 ms')


def ticking(durations_us):
    """Return a clock between whose readings these times pass, and none between them."""
    now = 0
    for duration_us in durations_us:
        yield now
        now += 1000 * duration_us
        yield now


def test_the_slowest_hundredth_of_the_jobs_does_not_count(monkeypatch):
    durations = [*range(1, MEASURED_TICKS + 1)]
    random.Random(1).shuffle(durations)
    clock = ticking(durations)
    monkeypatch.setattr(brick_schedule, 'process_time_ns', lambda: next(clock))
    parameters, loaded = composed(implementation='pid')
    assert measured_time(parameters, loaded) == 0.99 * MEASURED_TICKS + 1


def test_the_slowest_task_counts(monkeypatch, tmp_path):
    (tmp_path / 'mine.py').write_text(TWO_TASKS, encoding='utf-8')
    # In the first of five ticks, the slow task follows the fast one.
    clock = ticking(cycle([3, 70, 3, 3, 3, 3]))
    monkeypatch.setattr(brick_schedule, 'process_time_ns', lambda: next(clock))
    parameters, loaded = composed(implementation=f'{tmp_path}/mine.py:Mine', kernel=False)
    assert measured_time(parameters, loaded) == 70.0
