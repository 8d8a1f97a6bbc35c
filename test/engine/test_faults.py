"""Every pair of component and type: it changes what its component does, or is refused."""

import numpy as np
import parts
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot_ros.controllers.codegen.implementation import compose_controller, implementation_for
from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.compiled_loop import CompiledLoop
from ballbot_ros.engine.devices import ALL_DEVICES, numbers_of
from ballbot_ros.engine.scenario.scenario import Scenario, Segment, StickSignal
from ballbot_ros.engine.trajectory import TrajectoryLog
from ballbot_ros.parameters import (
    CONTROLLER,
    DEVICES,
    GAMEPAD,
    GYRO,
    PLANT,
    ControllerParameters,
    ParameterError,
    ParameterSet,
)
from ballbot_ros.parameters.timing import FIRST_TICK_NS, SLOW_PERIOD_NS, TICK_NS
from ballbot_ros.robot.brick.fault_effects import (
    GYRO_X,
    SONAR,
    after_faults,
    fault_row,
    packet_time,
    program_changes,
)
from ballbot_ros.robot.brick.faults import (
    COMPONENTS,
    EFFECTS,
    TYPES,
    Fault,
    fault_texts,
    faults_of,
    kind_of_component,
    parse_faults,
)
from ballbot_ros.robot.random_numbers import noise_key

ONSET = 1.5
"""In control, after the calibration."""

STICKS = Scenario(
    vertical=StickSignal((Segment('away', ((0.0, 0.0), (9.0, 99.0))),)),
    horizontal=StickSignal((Segment('right', ((0.0, 0.0), (9.0, 50.0))),)),
)
TIMED = {(PLANT, 'kernel'): True}
KEY = noise_key(1)


def parameters_with(faults, values=()):
    parameters = ParameterSet()
    for node, name in values:
        parameters.set(node, name, values[node, name])
    for node, text in fault_texts(faults).items():
        parameters.set(node, 'faults', text)
    parameters.set(PLANT, 'start_pitch_x', 0.03)
    parameters.set(PLANT, 'start_pitch_y', 0.02)
    parameters.set(PLANT, 'map', 'corridor')
    return parameters


def loop_with(faults, values=()):
    parameters = parameters_with(faults, values)
    loaded = compose_controller(parameters)
    program = implementation_for(parameters.of(ControllerParameters), loaded).make()
    return ClosedLoop(parameters, STICKS, program=program), parameters


def ticks_with(faults, values=(), duration=2.0):
    loop, _ = loop_with(faults, values)
    return list(loop.ticks(duration))


HEALTHY = {}


def healthy(values=()):
    key = tuple(values)
    if key not in HEALTHY:
        HEALTHY[key] = ticks_with((), values)
    return HEALTHY[key]


def observed(tick, component):
    """Return what a component's faults change in a tick."""
    inputs, outputs = tick.inputs, tick.outputs
    return {
        'gyro_x': lambda: inputs.gyro[0],
        'gyro_y': lambda: inputs.gyro[1],
        'encoder_x': lambda: inputs.revolutions[0],
        'encoder_y': lambda: inputs.revolutions[1],
        'sonar': lambda: inputs.sonar_cm,
        'motor_x': lambda: tick.truth.motor_torque[0],
        'motor_y': lambda: tick.truth.motor_torque[1],
        'battery': lambda: tick.truth.battery_voltage,
        'gamepad': lambda: inputs.sticks,
        'brick': lambda: outputs.duty,
    }.get(component, lambda: outputs.jobs)()


VALUES = {'task': TIMED}
PAIRS = [(component, kind) for component in COMPONENTS for kind in TYPES]
POSSIBLE = [(c, t) for c, t in PAIRS if t in EFFECTS[kind_of_component(c)]]


@pytest.mark.parametrize(('component', 'kind'), POSSIBLE)
def test_a_fault_changes_what_its_component_does_from_its_onset_on(component, kind):
    values = dict(VALUES.get(kind_of_component(component), {}))
    if component == 'tick':
        values[CONTROLLER, 'implementation'] = 'pid'
    at = 0.0 if component == 'task_init' else ONSET
    before, after = healthy(values), ticks_with([Fault(component, kind, at)], values)
    expected = [observed(tick, component) for tick in before]
    found = [observed(tick, component) for tick in after]
    onset = round(at * 250)
    assert found[:onset] == expected[:onset]
    assert found[onset:] != expected[onset:]


def test_every_other_pair_is_refused_with_what_the_component_has():
    refused = [pair for pair in PAIRS if pair not in POSSIBLE]
    assert len(POSSIBLE) + len(refused) == len(COMPONENTS) * len(TYPES)
    for component, kind in refused:
        with pytest.raises(ParameterError) as caught:
            Fault(component, kind)
        kinds = ', '.join(each for each in EFFECTS if kind in EFFECTS[each])
        has = ', '.join(EFFECTS[kind_of_component(component)])
        expected = f'{component} {kind}: only {kinds} can have this; {component} has {has}'
        assert str(caught.value) == expected


ALL_KINDS = [
    Fault('gyro_x', 'wrong', 1.1, 0.05, 4.0),
    Fault('gyro_y', 'stuck', 1.2, 0.03),
    Fault('gyro_x', 'slow', 1.2, 0.2, 8),
    Fault('gyro_y', 'delayed', 1.25, 0.1, 3),
    Fault('encoder_x', 'garbage', 1.3, 0.008),
    Fault('encoder_x', 'intermittent', 1.4, 0.3),
    Fault('encoder_y', 'off', 1.4, 0.004),
    Fault('sonar', 'stuck', 1.0, 0.5),
    Fault('sonar', 'delayed', 1.0, 0.5),
    Fault('motor_x', 'weak', 1.3, 0.5, 0.7),
    Fault('motor_y', 'stuck', 1.41, 0.02),
    Fault('motor_x', 'reversed', 1.5, 0.008),
    Fault('battery', 'sag', 1.2, 0.5),
    Fault('gamepad', 'delayed', 1.0, 0.4, 50),
    Fault('gamepad', 'intermittent', 1.5, 0.5),
    Fault('brick', 'restart', 1.602, 0.013),
    Fault('battery', 'brown-out', 3.001, 0.05),
]


@pytest.mark.parametrize('case', ['untimed', 'timed', 'law', 'timed law'])
def test_compiled_code_in_pieces_makes_the_same_ticks(case):
    faults, values = list(ALL_KINDS), {}
    if case.startswith('timed'):
        values |= TIMED
        values[PLANT, 'link'] = True
        task = 'tick' if case.endswith('law') else 'task_ts1'
        faults.append(Fault(task, 'slow', 1.2, 1.0, 700))
    if case.endswith('law'):
        values[CONTROLLER, 'implementation'] = 'pid'
    expected = ticks_with(faults, values, 4.0)
    loop, parameters = loop_with(faults, values)
    fast = CompiledLoop(loop, loop.program, parameters, STICKS)
    duties, delays, inputs, timing = [], [], [], []
    for ticks in (303, 1, 47, 50, 100, 251, 248):
        log, columns = fast.trace(ticks)
        duties += log.duty.tolist()
        delays += columns.delay_ns.tolist()
        timing.append(log.timing)
        inputs += np.stack([columns.inputs.gyro_y, columns.inputs.revolution_x], 1).tolist()
    assert duties == [list(tick.outputs.duty) for tick in expected]
    ordinary = TrajectoryLog(parameters.of(ControllerParameters))
    for tick in expected:
        ordinary.add(tick.truth, *tick.outputs.duty, tick.outputs)
    if case.startswith('timed'):
        assert np.concatenate(timing).tobytes() == ordinary.trajectory().timing.tobytes()
    assert delays == [tick.outputs.delay_ns for tick in expected]
    assert inputs == [[tick.inputs.gyro[1], tick.inputs.revolutions[0]] for tick in expected]
    if not case.endswith('law'):  # whose program does not follow
        loop.program.copy()
        after = [tick.outputs.duty for tick in loop.ticks(0.1)]
        whole = ticks_with(faults, values, 4.1)
        assert after == [tick.outputs.duty for tick in whole[1000:]]


def test_a_state_saved_in_the_middle_of_a_fault_goes_on_alike():
    faults = [Fault('gyro_x', 'stuck', 1.2, 0.2), Fault('motor_y', 'stuck', 1.2, 0.1)]
    faults.append(Fault('brick', 'restart', 1.3, 0.1))
    loop, _ = loop_with(faults)
    list(loop.ticks(1.25))
    state, tasks, program = loop.plant.save_state(), loop.tasks.copy(), loop.program.copy()
    expected = [tick.outputs.duty for tick in loop.ticks(0.5)]
    loop.plant.restore_state(state)
    loop.tasks, loop.program = tasks, program
    assert [tick.outputs.duty for tick in loop.ticks(0.5)] == expected


@pytest.mark.parametrize('device', ALL_DEVICES)
def test_drivers_read_what_the_closed_loop_samples(device):
    faults = [each for each in ALL_KINDS if each.component[:4] in ('gyro', 'enco', 'sona')]
    parameters = parameters_with(faults)
    expected = ticks_with(faults)
    node = parameters.of(device.parameters)
    row = fault_row(faults_of(node), FIRST_TICK_NS)
    read, sampled = device.reader(node, row), parts.sampled(device, node)
    for tick in expected:
        if tick.truth.stamp_ns % device.period_ns == 0:
            found = read(sampled(tick.truth), tick.truth.stamp_ns)
            assert found == getattr(tick.inputs, device.field)
    assert device.longest_delay(node) == {'gyro': 3, 'revolutions': 0}.get(device.field, 50)


def readings_of(text, value=600, component=GYRO_X, count=2000, period_ns=TICK_NS, key=KEY):
    row = fault_row(parse_faults(text), FIRST_TICK_NS)
    stamps = range(FIRST_TICK_NS, FIRST_TICK_NS + count * period_ns, period_ns)
    values = value if callable(value) else lambda number: value
    return [
        after_faults(row, component, values(number), stamp, period_ns, key)
        for number, stamp in enumerate(stamps)
    ]


@given(st.sampled_from([each for each in TYPES[:7] if each != 'delayed']), st.integers(0, 99))
def test_outside_its_interval_a_reading_is_the_healthy_one(kind, seed):
    found = readings_of(f'gyro_x {kind} time=0.1 duration=0.2', lambda n: n % 1024, count=100)
    expected = [number % 1024 for number in range(100)]
    assert found[:25] == expected[:25]
    assert found[75:] == expected[75:]
    assert all(0 <= each <= 1023 for each in found)


def test_garbage_is_uniform_within_the_range_of_the_device_and_depends_on_the_seed():
    found = readings_of('gyro_x garbage', count=20_000)
    counts = np.bincount(np.array(found) // 128, minlength=8)
    assert (min(found), max(found)) == (0, 1023)
    assert np.all(np.abs(counts - 2500) < 5 * 50)
    assert found == readings_of('gyro_x garbage', count=20_000)
    assert found != readings_of('gyro_x garbage', count=20_000, key=noise_key(2))


def test_stuck_slow_intermittent_and_wrong_readings():
    held = readings_of('gyro_x stuck time=0.02 duration=0.02', lambda n: n, count=12)
    assert held == [0, 1, 2, 3, 4, 4, 4, 4, 4, 4, 10, 11]
    assert readings_of('gyro_x stuck', lambda n: n, count=4) == [0, 0, 0, 0]
    slow = readings_of('gyro_x slow time=0.004 amount=10', lambda n: n, count=9)
    assert slow == [0, 1, 1, 1, 4, 4, 6, 6, 6]
    lost = np.array(readings_of('gyro_x intermittent', count=20_000)).reshape(-1, 25)
    assert np.all((lost == 0) | (lost == 600))
    assert np.all(lost == lost[:, :1])
    assert 0.4 < np.mean(lost == 0) < 0.6
    wrong = 'sonar wrong amount=-50.5'
    assert readings_of(wrong, 100, SONAR, 1) == [50]
    assert readings_of(wrong, 255, SONAR, 1) == [255], 'no echo stays none'
    assert readings_of(wrong, 20, SONAR, 1) == [0]
    both = 'gyro_x wrong amount=10; gyro_x stuck time=0.008; gyro_x wrong amount=5'
    assert readings_of(both, lambda n: n, count=5) == [15, 16, 16, 16, 16]


@pytest.mark.parametrize('kind', ['off', 'delayed', 'intermittent'])
def test_the_time_of_the_newest_packet_never_goes_back(kind):
    row = fault_row(parse_faults(f'gamepad {kind} time=0.09 duration=0.5'), FIRST_TICK_NS)
    stamps = range(FIRST_TICK_NS, FIRST_TICK_NS + 60 * SLOW_PERIOD_NS, SLOW_PERIOD_NS)
    times = [packet_time(row, stamp, KEY) for stamp in stamps]
    assert times == sorted(times)
    assert all(time <= stamp for time, stamp in zip(times, stamps, strict=True))
    assert times[:5] == list(stamps[:5])
    assert times[30:] == list(stamps[30:])
    assert times != list(stamps)


def test_a_program_stops_and_starts_at_ticks():
    text = 'brick restart time=0.002; brick restart time=0.1 duration=0.01'
    row = fault_row(parse_faults(text), FIRST_TICK_NS)
    tick = FIRST_TICK_NS + TICK_NS
    at = FIRST_TICK_NS + 100_000_000
    assert program_changes(row, FIRST_TICK_NS) == {tick: True, at: False, at + 3 * TICK_NS: True}
    assert program_changes(fault_row((), 0), 0) == {}


@pytest.mark.parametrize(
    'text', ['', 'gyro_x stuck time=3 duration=2; gyro_y off time=8', 'sonar wrong amount=-5.5']
)
def test_a_text_comes_back(text):
    assert '; '.join(map(str, parse_faults(text))) == text


FORM = 'is not COMPONENT TYPE [time=S] [duration=S] [amount=A]'


@pytest.mark.parametrize(
    ('node', 'text', 'problem'),
    [
        (GYRO, 'gyro_x', f"'gyro_x' {FORM}"),
        (GYRO, 'gyro_x off;', f"'' {FORM}"),
        (GYRO, 'gyro_x off at=3', f"'gyro_x off at=3' {FORM}"),
        (GYRO, 'gyro_x off time=3 time=4', f"'gyro_x off time=3 time=4' {FORM}"),
        (GYRO, 'gyro_x off time=soon', f"'gyro_x off time=soon' {FORM}"),
        (GYRO, 'gyro_x off time=-1', 'gyro_x off: time: -1.0 is not within 0 … 1e+06 s'),
        (GYRO, 'gyro_x off time=nan', 'gyro_x off: time: nan is not within 0 … 1e+06 s'),
        (GYRO, 'gyro_x off duration=0', 'gyro_x off: must last longer than 0 s'),
        (GYRO, 'gyro_x off amount=1', 'gyro_x off: has no amount'),
        (GYRO, 'gyro_x delayed amount=2.5', 'gyro_x delayed: amount: 2.5 is not a whole number'),
        (GYRO, 'gyro_x delayed amount=101', 'gyro_x delayed: amount: 101 is not within 1 … 100 ms'),
        (GYRO, 'sonar off', 'sonar off: belongs to sonar_driver.faults'),
        (GYRO, 'brick restart', 'brick restart: belongs to plant_sim.faults'),
        (PLANT, 'task_ts1 slow', 'task_ts1 slow: requires kernel: true, since jobs take no time w'),
        (GAMEPAD, 'gamepad stuck', 'gamepad stuck: only gyro, encoder, sonar, motor can have this'),
    ],
)
def test_a_mistake_is_told_on_one_line(node, text, problem):
    parameters = ParameterSet()
    parameters.set(node, 'faults', text)
    with pytest.raises(ParameterError) as caught:
        faults_of(parameters.of_node(node))
    assert str(caught.value).startswith(f'{node}.faults: {problem}')
    assert len(str(caught.value).splitlines()) == 1


def test_unknown_words_are_refused_with_a_hint():
    for text, hint in (('gyro off', 'gyro_x'), ('sonar stuk', 'stuck')):
        with pytest.raises(ParameterError, match=f'did you mean.*{hint}'):
            parse_faults(text)


def test_faults_need_what_they_act_on():
    parameters = parameters_with([Fault('tick', 'slow')], TIMED)
    with pytest.raises(ParameterError, match='the controller has no such task; it has task_init'):
        compose_controller(parameters)
    parameters = parameters_with([Fault('brick', 'restart')], {(PLANT, 'lockstep'): False})
    with pytest.raises(ParameterError, match='brick restart: requires lockstep: true'):
        faults_of(parameters.of(ControllerParameters))


def test_the_parameters_of_devices_keep_their_faults():
    parameters = parameters_with([Fault('gyro_x', 'off')])
    assert [numbers_of(parameters.of(each)).faults for each in DEVICES] == ['gyro_x off', '', '']
