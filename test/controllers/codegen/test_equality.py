"""The compiled program equals the Python one, bit for bit, on this machine and on ARM."""

import json
from collections import Counter
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import get_args

import numpy as np
import parts
import pytest
from generated import Built, branch_counts, need, random_values
from parts import AT_REST, values_of

from ballbot_ros.controllers.codegen.folder_check import ProgramInput, compare, random_steps
from ballbot_ros.controllers.codegen.toolchain import TARGETS
from ballbot_ros.controllers.document.program import (
    VOLTAGE_OFFSET,
    VOLTAGE_SLOPE,
    ControlMode,
    ControlProgram,
)
from ballbot_ros.engine.golden import duty_sha256, load_golden
from ballbot_ros.engine.scenario.reader import load_scenario, scenario_names
from ballbot_ros.engine.scenario_steps import scenario_steps
from ballbot_ros.parameters import (
    CONTROLLER,
    PLANT,
    ControllerParameters,
    PlantParameters,
    parameters_of,
)
from ballbot_ros.parameters.nodes import LogContent
from ballbot_ros.robot.brick.brick import Brick, DeviceInputs
from ballbot_ros.run.machine_checks import GOLDEN_SCENARIOS

GOLDEN = sorted((Path(__file__).parents[2] / 'controllers' / 'golden').glob('*.npz'))
RANDOM_SETS, SEQUENCES = 10, 100
RESTARTS = 10
TICKS = 50
LENGTHS = range(1, 2 * TICKS, 11)
"""Of sequences that follow each other [ticks]: a program is restarted in any state."""


@pytest.fixture(scope='module')
def built(tmp_path_factory):
    """Build the application for a target, or return an earlier build with these parameters."""
    known = {}

    def make(target, *, flags=(), values=None, **changes):
        need(target)
        values = values or values_of(CONTROLLER, **changes)
        key = target, flags, values
        if key not in known:
            known[key] = Built(values, target, tmp_path_factory.mktemp(target), flags)
        return known[key]

    return make


def golden_values_and_steps(path):
    with np.load(path, allow_pickle=False) as file:
        data = {name: file[name].tolist() for name in file.files}
    given = json.loads(str(data['parameters']))
    given['wheel_radius'], given['ball_radius'] = given.pop('Rw'), given.pop('Rs')
    known = parameters_of(CONTROLLER)
    values = {name: value for name, value in given.items() if name in known}
    steps = [
        ProgramInput(
            4 * n,
            data['in_systick_ms'][n],
            DeviceInputs(
                (data['in_gyro_x'][n], data['in_gyro_y'][n]),
                (data['in_rev_x'][n], data['in_rev_y'][n]),
                data['in_sonar_cm'][n],
                data['in_battery_mv'][n],
                tuple(data['in_bt_packet'][n]) if data['in_bt_present'][n] else None,
            ),
        )
        for n in range(len(data['in_systick_ms']))
    ]
    return values, steps


def steps_of(ticks, systick_ms=1000, **inputs):
    return [
        ProgramInput(4 * n, systick_ms + 4 * n, AT_REST._replace(**inputs)) for n in range(ticks)
    ]


def assert_equal(made, steps):
    comparison = compare(made.parameters, made.program(), steps)
    assert not comparison.difference, comparison.difference
    return comparison.ticks


@lru_cache(maxsize=1)  # the tests of both targets follow each other
def scenario_and_steps(name):
    scenario = load_scenario(name)
    return scenario, list(scenario_steps(scenario.parameters, scenario))


@pytest.mark.parametrize('target', TARGETS)
@pytest.mark.parametrize('name', scenario_names())
def test_every_shipped_scenario(built, target, name):
    scenario, steps = scenario_and_steps(name)
    made = built(target, values=scenario.parameters.of(ControllerParameters))
    seconds = scenario.parameters.of(PlantParameters).duration
    assert assert_equal(made, steps) == round(seconds * 250)


@pytest.mark.parametrize('target', TARGETS)
@pytest.mark.parametrize('path', GOLDEN, ids=lambda path: path.stem)
def test_the_golden_inputs(built, target, path):
    values, steps = golden_values_and_steps(path)
    # The golden values, floats and integers, must have the types in the parameter table.
    made = built(target, values=values_of(CONTROLLER, **values))
    assert assert_equal(made, steps) == len(steps)


def restarted_steps(seed, ticks):
    """Yield the inputs of a run; the first tick has a packet, since none waits after a start."""
    for step in random_steps(seed, ticks, out_of_range=seed % 2 == 1):
        sticks = step.inputs.sticks or (0, 0) if step.elapsed_ms == 0 else step.inputs.sticks
        yield step._replace(inputs=step.inputs._replace(sticks=sticks))


@pytest.mark.parametrize('target', TARGETS)
@pytest.mark.parametrize('parameters', range(RANDOM_SETS))
def test_a_thousand_random_sequences(built, parameters, target):
    """A new process runs ten of them, of various lengths: a restart is a new start."""
    made = built(target, values=random_values(parameters))
    for first in range(0, SEQUENCES, RESTARTS):
        program = made.program()
        for seed in range(first, first + RESTARTS):
            ticks = LENGTHS[(seed + first // RESTARTS) % len(LENGTHS)]
            if seed == first:
                wild = bool(first // RESTARTS % 2)
                steps = random_steps(SEQUENCES * parameters + seed, ticks, out_of_range=wild)
            else:
                steps = restarted_steps(SEQUENCES * parameters + seed, ticks)
                program.brick = Brick()
            comparison = compare(made.parameters, program, steps)
            assert not comparison.difference, (seed, comparison.difference)


@pytest.mark.parametrize('target', TARGETS)
@pytest.mark.parametrize('disturbance', [{'gyro': (900, 300)}, {'revolutions': (40, -90)}])
def test_after_stop_and_run_the_motors_rest_until_the_gyros_are_calibrated(
    built, target, disturbance
):
    made = built(target, time_stop=100)
    program = made.program()
    for step in [*steps_of(300), *steps_of(600, **disturbance)[300:]]:
        parts.tick(program, *step)
    assert program.control_mode == (
        ControlMode.STOP if 'gyro' in disturbance else ControlMode.CONTROL
    )
    again = [parts.tick(program, *step).duty for step in steps_of(500, systick_ms=60_000)]
    assert set(again) == {(0, 0)}
    assert program.control_mode == ControlMode.CONTROL


def test_with_fused_multiply_add_in_the_processor(built):
    if ' fma ' not in Path('/proc/cpuinfo').read_text():
        pytest.skip('this processor has no FMA')
    for level in ('-O2', '-O3'):
        made = built('c', flags=(level, '-mfma'))
        for seed in range(20):
            assert_equal(made, random_steps(seed, 300, out_of_range=seed % 2 == 1))


def test_fused_operations_would_be_noticed(built):
    """The comparison can fail: if the compiler may fuse operations, the states differ."""
    if ' fma ' not in Path('/proc/cpuinfo').read_text():
        pytest.skip('this processor has no FMA')
    made = built('c', flags=('-O2', '-mfma', '-ffp-contract=fast'))
    comparison = compare(made.parameters, made.program(), random_steps(0, 300, out_of_range=False))
    assert comparison.difference


def battery_filter_for_no_voltage():
    """Return the a_b for which 573 and then 574 mV average to a motor voltage of exactly zero."""
    coefficient = np.float32(574) - VOLTAGE_OFFSET / VOLTAGE_SLOPE
    for _ in range(2000):
        average = (np.float32(1) - coefficient) * np.float32(574) + coefficient * np.float32(573)
        if VOLTAGE_SLOPE * average - VOLTAGE_OFFSET == 0:
            return float(coefficient)
        step = np.float32(1 if VOLTAGE_SLOPE * average > VOLTAGE_OFFSET else 0)
        coefficient = np.nextafter(coefficient, step)
    raise AssertionError('no such coefficient')


def no_voltage_steps(revolution):
    still = AT_REST._replace(gyro=(0, 0), revolutions=(revolution, -revolution))
    return [
        ProgramInput(4 * n, 4 * n, still._replace(battery_mv=574 if n == 25 else 573))
        for n in range(30)
    ]


@pytest.mark.parametrize('target', TARGETS)
@pytest.mark.parametrize(
    ('pwm_gain', 'revolution', 'duty'), [(1.0, 0, 0), (0.0, 50, 0), (1.0, 50, 100)]
)
@pytest.mark.filterwarnings('ignore:divide by zero', 'ignore:invalid value')
def test_zero_voltage_gives_a_finite_duty(built, target, pwm_gain, revolution, duty):
    made = built(target, a_b=battery_filter_for_no_voltage(), pwm_gain=pwm_gain, time_start=100)
    steps = no_voltage_steps(revolution)
    assert_equal(made, steps)
    program = ControlProgram(made.parameters)
    duties = [parts.tick(program, *step).duty for step in steps]
    assert VOLTAGE_SLOPE * program.state.battery - VOLTAGE_OFFSET == 0
    assert duties[27] == (duty, -duty)


@pytest.mark.parametrize('target', TARGETS)
def test_the_log_counter_wraps(built, target):
    made = built(target, time_start=0, log_count=255)
    program = ControlProgram(made.parameters)
    steps = steps_of(600)
    logged = [step.elapsed_ms for step in steps if parts.tick(program, *step).log]
    assert logged == [4, 4 + 4 * 255, 4 + 8 * 255]
    assert_equal(made, steps)


@pytest.mark.parametrize('target', TARGETS)
@pytest.mark.parametrize('content', get_args(LogContent))
def test_each_content_of_the_log_is_the_same(built, target, content):
    """Also beyond the range of the gyros, where 16 bits with a sign are too few."""
    made = built(target, time_start=0, time_stop=2**32 - 1, log_count=1, log_content=content)
    steps = list(random_steps(5, 300, out_of_range=True))
    program = ControlProgram(made.parameters)
    packets = [each for step in steps for each in parts.tick(program, *step).log]
    assert len(packets) == 299
    assert any(each.data1 for each in packets) == (content != 'pitch')
    assert (max(each.adc3 for each in packets) == 32767) == (content == 'duties_and_gyros')
    assert_equal(made, steps)
    # So that the comparison shows what is logged.
    others = [each for each in get_args(LogContent) if each != content]
    for other in others:
        values = replace(made.parameters, log_content=other)
        assert 'log' in compare(values, made.program(), steps).difference


@pytest.mark.parametrize('target', TARGETS)
@pytest.mark.parametrize('before_wrap_ms', [4, 96, 300, 1000])
def test_the_system_time_wraps(built, target, before_wrap_ms):
    made = built(target, time_start=100, time_auto=400, mode='autonomous', sonar_hold=60)
    start = 2**32 - before_wrap_ms
    steps = [
        ProgramInput(4 * n, (start + 4 * n) % 2**32,
             AT_REST._replace(sonar_cm=20 if n % 25 == 0 else 255))
        for n in range(400)
    ]  # fmt: skip
    assert_equal(made, steps)


@pytest.mark.parametrize('target', TARGETS)
def test_duty_and_logged_pitch_saturate(built, target):
    made = built(target, time_start=0, time_stop=2**32 - 1, lsb=1e-9)
    for sign in (1, -1):
        turning = steps_of(60, gyro=(600 + 300 * sign, 600 - 300 * sign))
        steps = [*steps_of(1), *turning[1:]]
        program = ControlProgram(made.parameters)
        outputs = [parts.tick(program, *step) for step in steps]
        assert outputs[-1].duty == (100 * sign, -100 * sign)
        packet = [packet for output in outputs for packet in output.log][-1]
        assert {packet.adc1, packet.adc2} == {32767, -32768}
        assert_equal(made, steps)


@pytest.mark.parametrize('target', TARGETS)
@pytest.mark.parametrize(
    'changed', [{'k_i': -0.05}, {'a_d': 0.5}, {'ts2_period': 4, 'ts3_period': 20}],
    ids=['gain', 'filter', 'periods'],
)  # fmt: skip
def test_a_changed_parameter_changes_both(built, target, changed):
    steps = list(random_steps(1, 300, out_of_range=False))
    made = built(target, **changed)
    assert_equal(made, steps)
    comparison = compare(values_of(CONTROLLER), made.program(), steps)
    assert comparison.difference
    assert 'in C and' in comparison.difference


@pytest.mark.parametrize('target', TARGETS)
@pytest.mark.parametrize('name', GOLDEN_SCENARIOS)
def test_the_duties_of_the_closed_loop_are_the_golden_ones(target, name):
    """In a loop, which two scenarios show; the program's own equality is that of all, above."""
    need(target)
    scenario = load_scenario(name)
    if target == 'arm':
        scenario.parameters.set(PLANT, 'duration', 5.0)
        expected = duty_sha256(scenario)
    else:
        expected = load_golden().scenarios[name]
    scenario.parameters.set(CONTROLLER, 'implementation', target)
    assert duty_sha256(scenario) == expected


def test_the_inputs_reach_the_branches_of_the_generated_c(built, capsys):
    reached = Counter()
    sets = [random_values(parameters) for parameters in range(RANDOM_SETS)]
    sets.append(values_of(CONTROLLER, a_b=battery_filter_for_no_voltage(), time_start=100))
    for values in sets:
        made = built('c', flags=('--coverage', '-O0'), values=values)
        sequences = [
            random_steps(seed, 2 * TICKS, out_of_range=seed % 2 == 1) for seed in range(10)
        ]
        for steps in (*sequences, no_voltage_steps(0)):
            program = made.program()
            for step in steps:
                parts.tick(program, *step)
            del program  # the counts are written at the end of the process
        for source in ('ballbot_controller.c', 'ballbot_app.c'):
            reached.update(branch_counts(made, source))
    taken = sum(count > 0 for count in reached.values())
    with capsys.disabled():
        print(f'\nbranches of the generated C reached: {taken} of {len(reached)}', flush=True)
    assert taken == len(reached), [key for key, count in reached.items() if not count]
