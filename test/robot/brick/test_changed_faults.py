"""Faults that are given during a run: what becomes of their text, and the same bits."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot_ros.parameters import (
    CONTROLLER,
    DRIVER_PERIODS_NS,
    GYRO,
    PLANT,
    ParameterError,
    ParameterSet,
)
from ballbot_ros.parameters.timing import FIRST_TICK_NS, TICK_NS
from ballbot_ros.robot.brick.fault_effects import (
    SLOW,
    active_amount,
    after_faults,
    change_faults,
    fault_row,
    packet_time,
    voltage_drop,
)
from ballbot_ros.robot.brick.faults import (
    COMPONENTS,
    EFFECTS,
    Fault,
    faults_from,
    kind_of_component,
    parse_faults,
    performed_faults,
    performer_of,
)
from ballbot_ros.robot.random_numbers import noise_key

KEY = noise_key(1)
NOW = 3.204


def parameters(node, text=''):
    values = ParameterSet()
    if node in (PLANT, CONTROLLER):
        values.set(PLANT, 'kernel', True)
    return values.of_node(node).with_values({'faults': text})


@pytest.mark.parametrize(
    ('before', 'given', 'after'),
    [
        ('', '', ''),
        ('', 'gyro_x off', 'gyro_x off time=3.204'),
        ('', 'gyro_x off time=0 duration=2', 'gyro_x off time=3.204 duration=2'),
        ('', 'gyro_x off time=3.204; gyro_y off time=9',
         'gyro_x off time=3.204; gyro_y off time=9'),
        ('gyro_x off', 'gyro_x off; gyro_y off', 'gyro_x off; gyro_y off time=3.204'),
        ('gyro_x off', 'gyro_y off; gyro_x off', 'gyro_x off; gyro_y off time=3.204'),
        ('gyro_x off time=1 duration=2', 'gyro_y off',
         'gyro_x off time=1 duration=2; gyro_y off time=3.204'),
        ('gyro_x off time=1', '', 'gyro_x off time=1 duration=2.204'),
        ('gyro_x off', '', 'gyro_x off duration=3.204'),
        ('gyro_x off time=3.204', '', ''),
        ('gyro_x off time=8; gyro_y off time=9', 'gyro_y off time=9', 'gyro_y off time=9'),
        ('gyro_x stuck time=3 duration=2', 'gyro_x stuck',
         'gyro_x stuck time=3 duration=0.204; gyro_x stuck time=3.204'),
        ('gyro_x delayed', 'gyro_x delayed; gyro_x off', 'gyro_x delayed; gyro_x off time=3.204'),
    ],
)  # fmt: skip
def test_a_text_becomes_that_of_the_whole_run(before, given, after):
    assert faults_from(NOW, given, parameters(GYRO, before)) == after
    assert faults_from(NOW, after, parameters(GYRO, after)) == after


def test_plant_and_controller_keep_what_the_other_one_carries_out():
    both = 'task_ts1 slow time=1; motor_x off time=1; brick restart time=1'
    plant = faults_from(NOW, 'motor_y off', parameters(PLANT, both))
    tasks = faults_from(NOW, 'task_ts2 slow', parameters(CONTROLLER, both))
    assert plant == (
        'task_ts1 slow time=1; motor_x off time=1 duration=2.204; brick restart time=1; '
        'motor_y off time=3.204'
    )
    assert tasks == (
        'task_ts1 slow time=1 duration=2.204; motor_x off time=1; brick restart time=1; '
        'task_ts2 slow time=3.204'
    )
    assert performed_faults({PLANT: plant, CONTROLLER: tasks}) == (
        'motor_x off time=1 duration=2.204; brick restart time=1; motor_y off time=3.204; '
        'task_ts1 slow time=1 duration=2.204; task_ts2 slow time=3.204'
    )


FIXED = 'must be known at the start: make a branch with it'


@pytest.mark.parametrize(
    ('node', 'before', 'text', 'problem'),
    [
        (GYRO, '', 'gyro_x', "'gyro_x' is not COMPONENT TYPE [time=S] [duration=S] [amount=A]"),
        (GYRO, '', 'gyro_x weak', 'gyro_x weak: only motor can have this; gyro_x has off, stuck'),
        (GYRO, '', 'sonar off', 'sonar off: belongs to sonar_driver.faults'),
        (GYRO, '', 'gyro_x off time=3.2', 'gyro_x off time=3.2: can begin only from 3.204 s on'),
        (GYRO, 'gyro_x off time=1', 'gyro_x off time=1 duration=9',
         'gyro_x off time=1 duration=9: can begin only from 3.204 s on'),
        (GYRO, '', 'gyro_x delayed', f'gyro_x delayed time=3.204: {FIXED}'),
        (GYRO, 'gyro_x delayed', '', f'gyro_x delayed: {FIXED}'),
        (PLANT, '', 'brick restart', f'brick restart time=3.204: {FIXED}'),
        (PLANT, '', 'battery brown-out', f'battery brown-out time=3.204: {FIXED}'),
        (PLANT, '', 'task_ts1 slow', 'task_ts1 slow time=3.204: belongs to controller.faults'),
        (CONTROLLER, '', 'motor_x off', 'motor_x off time=3.204: belongs to plant_sim.faults'),
    ],
)  # fmt: skip
def test_what_could_not_be_repeated_is_refused(node, before, text, problem):
    with pytest.raises(ParameterError) as caught:
        faults_from(NOW, text, parameters(node, before))
    assert str(caught.value).startswith(f'{node}.faults: {problem}')
    assert len(str(caught.value).splitlines()) == 1


def is_possible(component, kind):
    sensor = kind_of_component(component) in ('gyro', 'encoder', 'sonar')
    return kind not in ('restart', 'brown-out') and not (sensor and kind == 'delayed')


POSSIBLE = [
    (component, kind)
    for component in COMPONENTS
    for kind in EFFECTS[kind_of_component(component)]
    if is_possible(component, kind)
]


def simulated(row, component, stamp_ns, period_ns, memory):
    """Return what a component does at a stamp."""
    number = stamp_ns // period_ns
    if component == 'battery':
        return voltage_drop(row, stamp_ns), voltage_drop(row, stamp_ns + TICK_NS)
    if component == 'gamepad':
        memory[stamp_ns] = number
        newest = packet_time(row, stamp_ns, KEY)
        return next((memory[each] for each in sorted(memory, reverse=True) if each <= newest), None)
    at = COMPONENTS.index(component)
    if kind_of_component(component) == 'task':
        return active_amount(row, at, SLOW, stamp_ns)
    return after_faults(row, at, number * 7919 % 200, stamp_ns, period_ns, KEY)


TIMES = st.sampled_from([0.0, 0.04, 0.2, 0.2013, 0.3, 0.41])
DURATIONS = st.sampled_from([None, 0.01, 0.05, 0.2])


@st.composite
def lives(draw):
    """A component, its faults at the start, and other ones by the number of the next sample."""
    component, _ = draw(st.sampled_from(POSSIBLE))
    kinds = st.sampled_from([kind for each, kind in POSSIBLE if each == component])
    faults = st.builds(lambda kind, *when: Fault(component, kind, *when), kinds, TIMES, DURATIONS)
    start = draw(st.lists(faults, max_size=3))
    numbers = draw(st.lists(st.integers(0, 100), max_size=4, unique=True))
    keep = st.lists(st.booleans(), min_size=12, max_size=12)
    return component, start, {each: draw(st.tuples(keep, faults)) for each in sorted(numbers)}


@given(lives())
def test_a_run_that_has_the_last_text_from_its_start_is_the_same(life):
    component, start, changes = life
    node = performer_of(component)
    period_ns, base = DRIVER_PERIODS_NS.get(node, TICK_NS), '; '.join(map(str, start))
    stamps = range(FIRST_TICK_NS, FIRST_TICK_NS + 110 * period_ns, period_ns)
    now, row = parameters(node, base), fault_row(start, FIRST_TICK_NS)
    found, memory = [], {}
    for number, stamp_ns in enumerate(stamps):
        if number in changes:
            keep, new = changes[number]
            given = [
                each
                for each, is_kept in zip(parse_faults(now.faults), keep, strict=False)
                if is_kept
            ]
            earliest = (number + 1) * period_ns / 1e9
            if not 0.0 < new.time < earliest:
                given.append(new)
            text = faults_from(earliest, '; '.join(map(str, given)), now)
            now = now.with_values({'faults': text})
            change_faults(row, now, FIRST_TICK_NS)
        found.append(simulated(row, component, stamp_ns, period_ns, memory))
    row, memory = fault_row(parse_faults(now.faults), FIRST_TICK_NS), {}
    expected = [simulated(row, component, each, period_ns, memory) for each in stamps]
    assert found == expected
