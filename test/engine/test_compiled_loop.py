"""The compiled runs are the ordinary ones, to the last bit."""

import hashlib
import json
import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('numba')

from drawn_runs import drawn_run

from ballbot_ros.controllers.document.program import INITIAL_STATE, TASK_NUMBERS
from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.compilation import compiled_and_kept
from ballbot_ros.engine.compiled_loop import CompiledLoop, are_timed, events_of, floor_of, rings_of
from ballbot_ros.engine.golden import load_golden
from ballbot_ros.engine.rows import RobotRows, program_rows, rows_of
from ballbot_ros.engine.run import new_log, new_robots, simulate_runs, tick_type
from ballbot_ros.engine.scenario.reader import load_scenario, scenario_names
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.engine.scenario.task_timing import DUTY_AGE_US, LOST
from ballbot_ros.engine.trajectory import TrajectoryLog
from ballbot_ros.parameters import (
    CONTROLLER,
    DEVICES,
    PLANT,
    ControllerParameters,
    GyroParameters,
    ParameterSet,
    PlantParameters,
)
from ballbot_ros.parameters.timing import SECOND_NS, TICK_NS
from ballbot_ros.robot.world.world import World

ROOT = Path(__file__).resolve().parents[2]
RANDOM_RUNS = 300
CORE_TYPES = ('Nehalem', 'Sandybridge', 'Haswell', 'SkylakeX')


def simulate(parameters, scenario, simulate_many=None):
    """Return the log and the end of a run by the compiled function, or another one."""
    rows = RobotRows(parameters, {}, 1)
    plant = parameters.of(PlantParameters)
    ticks = round(plant.duration * SECOND_NS) // TICK_NS
    log = new_log(1, ticks, is_timed=are_timed(rows), has_others=True)
    ends = new_robots(1, rows_of([INITIAL_STATE]))
    tables = [rows[cls] for cls in (PlantParameters, *DEVICES, ControllerParameters)]
    tables.append(program_rows(rows[ControllerParameters]))
    events, nothing = events_of([scenario]), np.zeros((1, 0), tick_type(ends.dtype['program']))
    if simulate_many:  # plain Python reads the names of a row in a record array only
        tables = [each.view(np.recarray) for each in tables]
        ends = ends.view(np.recarray)
    run = simulate_many or compiled_and_kept(simulate_runs)
    rings = rings_of(rows, len(TASK_NUMBERS))
    run(*tables, floor_of(World.of(plant)), events, rings, log, nothing, ends, ticks)
    return log, ends[0]


def assert_equal_runs(parameters, scenario, simulate_many=None):
    """Compare each tick's motion, duties and timing, and the final state, bit for bit."""
    log, end = simulate(parameters, scenario, simulate_many)
    loop = ClosedLoop(parameters, scenario)
    ordinary, others = TrajectoryLog(parameters.of(ControllerParameters)), []
    for tick in loop.ticks(parameters.of(PlantParameters).duration):
        ordinary.add(tick.truth, *tick.outputs.duty, tick.outputs)
        others.append((*tick.truth.psi_rate, *tick.inputs.gyro, *tick.inputs.revolutions))
    assert end['ticks'] == ordinary.ticks
    expected = ordinary.trajectory()
    assert log.others[0, : ordinary.ticks].tobytes() == np.array(others, float).tobytes()
    for name in ('position', 'psi', 'duty', 'timing'):
        found = getattr(log, name)[0, : ordinary.ticks]
        assert found.tobytes() == getattr(expected, name).tobytes(), name
    assert_equal_states(end['plant'], loop.plant.state)
    assert_equal_states(end['program'], loop.program.state)


def assert_equal_states(row, state):
    assert row.dtype.names == state._fields
    for name, value in state._asdict().items():
        assert row[name].tobytes() == np.array(value, row.dtype[name].base).tobytes(), name


@pytest.fixture(autouse=True)
def _quiet():
    """Parameters over their full ranges sometimes overflow."""
    with warnings.catch_warnings(), np.errstate(all='ignore'):
        warnings.simplefilter('ignore')
        yield


@pytest.mark.parametrize('name', scenario_names())
def test_every_shipped_scenario(name):
    scenario = load_scenario(name)
    assert_equal_runs(scenario.parameters, scenario)


@pytest.mark.parametrize('part', range(5))
def test_random_runs_over_the_bounds_of_all_parameters(part):
    count = RANDOM_RUNS // 5
    for seed in range(part * count, (part + 1) * count):
        try:
            assert_equal_runs(*drawn_run(seed))
        except AssertionError as error:
            raise AssertionError(f'run {seed} differs') from error


def test_random_runs_move_fall_hit_walls_and_use_all_devices():
    """The comparison is worth something only if much happens in the runs."""
    seen = dict.fromkeys(
        ('fallen', 'stopped', 'contact', 'moving', 'pushed', 'delayed', 'link', 'kernel', 'aged'), 0
    )
    for seed in range(200):
        parameters, scenario = drawn_run(seed)
        log, end = simulate(parameters, scenario)
        seen['fallen'] += end['plant']['is_fallen']
        seen['stopped'] += end['plant']['is_stopped']
        seen['contact'] += end['plant']['in_contact']
        seen['moving'] += not end['plant']['is_fallen'] and bool(log.duty.any())
        seen['pushed'] += bool(scenario.pushes)
        seen['aged'] += bool((log.timing[:, :, DUTY_AGE_US] > 0).any())
        seen['delayed'] += parameters.of(GyroParameters).delay > 0
        for name in ('link', 'kernel'):
            seen[name] += getattr(parameters.of(PlantParameters), name)
    assert min(seen.values()) >= 5, seen
    assert all(
        30 <= seen[name] <= 170 for name in ('fallen', 'moving', 'pushed', 'delayed', 'link')
    ), seen


def test_jobs_that_are_late_and_lost():
    lost = 0
    for seed in range(12):
        parameters = ParameterSet()
        for name, value in {
            'kernel': True, 'kernel_defect': seed % 3 == 0, 'link': seed % 2 == 0, 'seed': seed,
            'control_instructions': 58_000 + 1000 * seed, 'time_variation': 0.5, 'time_start': 100,
            'bus_cycles': 30.0 * (seed % 3),
        }.items():  # fmt: skip
            parameters.set(CONTROLLER, name, value)
        for name, value in {'duration': 1.0, 'hold_time': 0.1, 'start_pitch_x': 0.02}.items():
            parameters.set(PLANT, name, value)
        assert_equal_runs(parameters, Scenario())
        log, _ = simulate(parameters, Scenario())
        lost += log.timing[:, :, LOST].any()
    assert lost > 5


@pytest.mark.parametrize('seed', [0, 1, 5, 14])
def test_the_same_function_in_plain_python(seed):
    assert_equal_runs(*drawn_run(seed, duration=0.2), simulate_runs)


def test_a_loop_goes_on_where_compiled_code_has_left_it():
    """Compiled and interpreted ticks, in any order, are those of the interpreter alone."""
    for seed in range(40):
        parameters, scenario = drawn_run(seed)
        one, other = ClosedLoop(parameters, scenario), ClosedLoop(parameters, scenario)
        fast = CompiledLoop(one, one.program, parameters, scenario)
        ticks = round(parameters.of(PlantParameters).duration * SECOND_NS) // TICK_NS
        parts = [0, 1, 3, ticks // 3]
        duties = [pair for part in parts for pair in fast.advance(part).duty.tolist()]
        duties += [
            list(one.tick().outputs.duty) for _ in range(ticks // 3) if not one.plant.stopped
        ]
        for duty in duties:
            assert list(other.tick().outputs.duty) == duty
        assert one.program.state == other.program.state
        assert one.plant.truth() == other.plant.truth()
        assert one.plant.newest_hit == other.plant.newest_hit


HASHES = """
import hashlib, json, sys
sys.path.insert(0, 'test/engine')
from test_compiled_loop import scenario_hashes
print(json.dumps(scenario_hashes()))
"""


def scenario_hashes():
    """Return the hashes of the shipped scenarios' duties by compiled runs."""
    hashes = {}
    for name in scenario_names():
        scenario = load_scenario(name)
        log, end = simulate(scenario.parameters, scenario)
        hashes[name] = hashlib.sha256(log.duty[0, : end['ticks']]).hexdigest()
    return hashes


def hashes_with(**settings):
    done = subprocess.run(
        [sys.executable, '-c', HASHES],
        env={**os.environ, 'PYTHONPATH': f'{ROOT}:{ROOT / "test"}', **settings},
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return json.loads(done.stdout)


@pytest.mark.parametrize('core_type', CORE_TYPES)
def test_any_kernel_of_openblas(core_type):
    assert hashes_with(OPENBLAS_CORETYPE=core_type) == load_golden().scenarios


@pytest.mark.slow
def test_code_for_any_processor(tmp_path):
    """Without the vector and fused instructions of this processor the code is another one."""
    found = hashes_with(NUMBA_CPU_NAME='generic', XDG_CACHE_HOME=str(tmp_path))
    assert found == load_golden().scenarios
