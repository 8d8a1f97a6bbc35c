"""The parameter table and its checks."""

import math
from dataclasses import dataclass, fields
from typing import get_args

import laws
import pytest
from hypothesis import strategies as st
from laws import given, is_read_or_refused_in_one_line
from parts import physical

from ballbot_ros.errors import BallbotError
from ballbot_ros.parameters import (
    ALL_NODES,
    BRICK_LINK,
    CONTROLLER,
    GAMEPAD,
    GYRO,
    PLANT,
    RECORDER,
    SONAR,
    TABLE,
    VIEWER,
    VISUALIZER,
    GyroParameters,
    ParameterError,
    ParameterSet,
    PlantParameters,
    SonarParameters,
    Subset,
    parameters_of,
)
from ballbot_ros.parameters.controller import Period
from ballbot_ros.parameters.timing import BATTERY_PERIOD_NS, MILLISECOND_NS, TICK_NS
from ballbot_ros.robot.plant.model import PhysicalParameters

# Values from the document and the author's other robot (sections 3.1, 6 and 7).
REFERENCE = {
    PLANT: {
        'gravity': 9.81, 'ball_mass': 0.013, 'ball_radius': 0.026, 'wheel_mass': 0.015,
        'wheel_radius': 0.021, 'wheel_width': 0.022, 'body_mass': 0.682, 'body_width': 0.135,
        'body_depth': 0.135, 'body_height': 0.17, 'motor_inertia': 1e-5,
        'motor_resistance': 6.69, 'back_emf_constant': 0.468, 'torque_constant': 0.317,
        'motor_friction': 0.0022, 'ball_friction': 0.0, 'voltage_slope': 0.001089,
        'voltage_offset': -0.625, 'battery_voltage': 8.0, 'hold_time': 1.0, 'timeout': 2.0,
        'startup_timeout': 30.0, 'plant_model': 'linear', 'lockstep': True,
    },
    GYRO: {'zero_rate_offset_x': 600.0, 'zero_rate_offset_y': 600.0, 'rate_limit': 360.0},
    CONTROLLER: {
        'a_b': 0.8, 'a_d': 0.8, 'a_gc': 0.8, 'a_r': 0.996, 'a_gd': 0.999, 'pwm_gain': 1.0,
        'pwm_offset': 0.0, 'time_start': 1000, 'time_auto': 5000, 'gp_max': 100,
        'sound_freq': 440, 'sound_dur': 500, 'sound_volume': 70, 'log_count': 25,
        'lsb': 2.0**-10, 'dst_thr': 30, 'time_stop': 500, 'mode': 'remote',
    },
}  # fmt: skip

NUMERIC = [row for row in TABLE if row.bounds]


def refusal(row, value):
    """Return the error for `value`, which must be one line."""
    line = laws.refusal(ParameterError, row.check, value, 'file.yaml:7: node.')
    assert line.startswith(f'file.yaml:7: node.{row.name}: ')
    return line


def example(row, number):
    return (number,) * len(row.default) if isinstance(row.default, tuple) else number


def test_every_parameter_is_described():
    for row in TABLE:
        assert row.description.strip(), row
        assert '\n' not in row.description, row
        assert row.source.strip(), row
        assert set(row.nodes) <= set(ALL_NODES), row
        assert row.nodes, row


@pytest.mark.parametrize(
    ('value', 'what'),
    [(1, 'text'), (None, 'text'), (['a'], 'text'), ('a\udcff', 'UTF-8'), ('a\0b', 'UTF-8')],
)
def test_text_that_ros_can_not_carry_is_refused(value, what):
    line = refusal(parameters_of(RECORDER)['output'], value)
    assert line.endswith(f'{value!r} is not {what}')


def test_every_number_has_a_unit_and_bounds_and_nothing_else_has():
    for row in TABLE:
        is_number = not isinstance(row.default, bool | str)
        assert bool(row.unit) == bool(row.bounds) == is_number, row
        assert not row.bounds or len(row.bounds) == 2, row
        assert not row.choices or row.default in row.choices, row


def test_every_default_is_allowed_and_of_its_own_type():
    for row in TABLE:
        checked = row.check(row.default, '')
        assert checked == row.default, row
        assert type(checked) is type(row.default), row


def test_the_bounds_belong_to_the_range_and_what_is_beyond_does_not():
    for row in NUMERIC:
        low, high = row.bounds
        assert low < high, row
        for bound in (low, high):
            row.check(example(row, bound), '')
        scale = 1 if isinstance(row.default, int) else max(1.0, abs(low), abs(high)) * 1e-6
        for beyond in (low - scale, high + scale):
            assert repr(beyond) in refusal(row, example(row, beyond))


def test_a_value_that_is_not_a_number_is_refused():
    for row in NUMERIC:
        for value in (math.nan, math.inf, -math.inf, '1', None, True, [], {}):
            refusal(row, value)
            refusal(row, example(row, value))


def test_the_error_for_a_refused_number_has_its_unit():
    for row in NUMERIC:
        if row.unit != '1':
            assert row.unit in refusal(row, example(row, row.bounds[1] * 2 + 1))


@pytest.mark.parametrize('value', ['', 'Linear', 'line', 1, None, ['linear']])
def test_text_must_be_one_of_the_choices(value):
    row = parameters_of(PLANT)['plant_model']
    line = refusal(row, value)
    if isinstance(value, str):
        assert line.endswith('is not one of linear, nonlinear')


@pytest.mark.parametrize('value', [0, 1, 'true', None, 1.0])
def test_a_switch_is_true_or_false(value):
    assert 'is not true or false' in refusal(parameters_of(PLANT)['lockstep'], value)


def test_a_whole_number_may_be_written_with_a_point_but_not_with_a_fraction():
    row = parameters_of(CONTROLLER)['time_start']
    checked = row.check(2000.0, '')
    assert checked == 2000
    assert type(checked) is int
    assert 'is not a whole number' in refusal(row, 2000.5)


def test_a_number_may_be_written_without_a_point():
    checked = parameters_of(PLANT)['gravity'].check(10, '')
    assert checked == 10.0
    assert type(checked) is float


@pytest.mark.parametrize('value', [[1.0] * 3, [1.0] * 5, 1.0, [], 'abcd', {1, 2, 3, 4}])
def test_a_list_must_have_its_length(value):
    assert 'is not a list of 4 numbers' in refusal(parameters_of(CONTROLLER)['k_f'], value)


@pytest.mark.parametrize('value', [10**400, -(10**400)], ids=['large', 'small'])
@pytest.mark.parametrize('name', ['k_i', 'time_start', 'mode', 'rejoin'])
def test_a_number_beyond_the_range_of_floats_is_refused(name, value):
    refusal(parameters_of(CONTROLLER)[name], value)


@pytest.mark.parametrize('node', REFERENCE)
def test_the_defaults_are_the_documents(node):
    values = ParameterSet().of_node(node)
    assert {name: getattr(values, name) for name in REFERENCE[node]} == REFERENCE[node]


def test_a_name_occurs_once_in_a_node():
    for node in ALL_NODES:
        names = [row.name for row in TABLE if node in row.nodes]
        assert len(names) == len(set(names))
        assert list(parameters_of(node)) == names


def test_the_ideal_profile_has_no_noise():
    assert ParameterSet().of(GyroParameters).noise == ParameterSet().of(GyroParameters).drift == 0.0
    assert ParameterSet().of(SonarParameters).dropout_probability == 0.0


def test_unset_parameters_have_their_defaults():
    for node in ALL_NODES:
        expected = {name: row.default for name, row in parameters_of(node).items()}
        assert ParameterSet().of_node(node).values() == expected
    assert list(ParameterSet()) == []


def test_iteration_yields_the_set_parameters():
    parameters = ParameterSet()
    parameters.set(PLANT, 'gravity', 1.62)
    parameters.set(CONTROLLER, 'k_f', [-1, -2, -3, -4])
    assert sorted(parameters) == [
        (CONTROLLER, 'k_f', (-1.0, -2.0, -3.0, -4.0)),
        (PLANT, 'gravity', 1.62),
    ]
    assert parameters.of(PlantParameters).gravity == 1.62


@pytest.mark.parametrize(
    ('node', 'name', 'value', 'sharers'),
    [
        (GYRO, 'seed', 9, (PLANT, GYRO, 'encoder_driver', SONAR, CONTROLLER, GAMEPAD)),
        (GAMEPAD, 'scenario', 'x', (PLANT, GAMEPAD)),
        (
            CONTROLLER,
            'ball_radius',
            0.03,
            (PLANT, CONTROLLER, GAMEPAD, VIEWER, VISUALIZER, BRICK_LINK),
        ),
        (GAMEPAD, 'gp_max', 50, (CONTROLLER, GAMEPAD, BRICK_LINK)),
        ('/**', 'lockstep', False, (PLANT, CONTROLLER, GAMEPAD)),
        ('/**', 'gravity', 1.0, (PLANT,)),
    ],
)
def test_nodes_that_share_a_parameter_never_disagree(node, name, value, sharers):
    parameters = ParameterSet()
    parameters.set(node, name, value)
    assert {n: v for n, _, v in parameters} == dict.fromkeys(sharers, value)


def test_a_later_value_replaces_an_earlier_one():
    base, more = ParameterSet(), ParameterSet()
    base.set(PLANT, 'gravity', 1.0)
    base.set(PLANT, 'dead_zone', 2.0)
    more.set(PLANT, 'gravity', 3.0)
    base.update(more)
    assert sorted(base) == [(PLANT, 'dead_zone', 2.0), (PLANT, 'gravity', 3.0)]


@pytest.mark.parametrize(
    ('node', 'name', 'told'),
    [
        ('plant', 'gravity', "unknown node 'plant' (did you mean plant_sim?); known: plant_sim, "),
        ('', 'gravity', "unknown node ''"),
        (PLANT, 'grafity', "plant_sim has no parameter 'grafity'"),
        (PLANT, 'noise', "plant_sim has no parameter 'noise'"),
        (RECORDER, '', "recorder has no parameter ''"),
        ('/**', 'grafity', "no node has a parameter 'grafity'"),
        (PLANT, 'two\nlines', r"no parameter 'two\nlines'"),
        ('two\nlines', 'gravity', r"unknown node 'two\nlines'"),
    ],
)
def test_unknown_names_are_refused_in_one_line(node, name, told):
    text = laws.refusal(ParameterError, ParameterSet().set, node, name, 1.0, 'file.yaml:3')
    assert text.startswith('file.yaml:3: ')
    assert told in text


def test_a_refused_value_changes_nothing():
    parameters = ParameterSet()
    with pytest.raises(BallbotError):
        parameters.set(PLANT, 'gravity', -1.0)
    assert list(parameters) == []


anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
)


@given(st.sampled_from(TABLE), anything)
def test_any_value_is_converted_or_refused(row, value):
    def check():
        checked = row.check(value, '')
        assert type(checked) is type(row.default)
        assert row.check(checked, '') == checked

    assert is_read_or_refused_in_one_line(check)


def test_a_subset_takes_the_parameters_that_its_fields_name():
    @dataclass
    class Two(Subset):
        gravity: float
        dead_zone: float

    assert Two.from_parameters(ParameterSet().of(PlantParameters)) == Two(9.81, 0.0)
    assert {field.name for field in fields(PhysicalParameters)} <= set(parameters_of(PLANT))
    assert physical(gravity=1.0).gravity == 1.0


def test_task_periods_are_the_whole_ticks_that_divide_the_grid_of_runs():
    grid_ms, tick_ms = BATTERY_PERIOD_NS // MILLISECOND_NS, TICK_NS // MILLISECOND_NS
    allowed = range(tick_ms, grid_ms + 1, tick_ms)
    assert get_args(Period) == tuple(period for period in allowed if grid_ms % period == 0)
