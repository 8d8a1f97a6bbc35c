"""Simpler counterexamples: laws, whatever is violated."""

import math

import numpy as np
from hypothesis import strategies as st
from laws import given

from ballbot_ros.lab.search.shrinking import deviations, shrunk
from ballbot_ros.lab.studies.variables import Levels, Uniform, Variable, WholeNumbers, whole_numbers
from ballbot_ros.parameters import Parameter

VARIABLES = tuple(
    Variable(name, Parameter((), name, 0.0, ''), distribution)
    for name, distribution in {
        'force': Uniform(0.0, 6.0),
        'direction': Uniform(-180.0, 180.0),
        'delay': whole_numbers(Uniform(0.0, 8.0)),
        'model': Levels(('linear', 'nonlinear')),
        'level': Levels((3, 1, 10)),
        'switch': Levels((False, True)),
        'unknown': Uniform(0.0, 1.0),
    }.items()
)
NOMINAL = {
    'force': 1.0, 'direction': 0.0, 'delay': 2, 'model': 'linear', 'level': 1, 'switch': False,
    'unknown': None,
}  # fmt: skip
CASE = {
    'force': 5.43219, 'direction': -123.456, 'delay': 7, 'model': 'nonlinear', 'level': 10,
    'switch': True, 'unknown': 0.123456,
}  # fmt: skip


def shrink(violates, case=CASE):
    """Return the simpler case, and how many were tried."""
    tried = []

    def each(cases):
        tried.extend(cases)
        return [violates(one) for one in cases]

    return shrunk(dict(case), VARIABLES, NOMINAL, each), len(tried)


def test_what_does_not_matter_gets_its_nominal_value():
    case, _ = shrink(lambda case: case['force'] > 3.2 and case['model'] == 'nonlinear')
    assert deviations(case, VARIABLES, NOMINAL) == ('force', 'model', 'unknown')
    assert (case['force'], case['model']) == (4.0, 'nonlinear')
    case, _ = shrink(lambda case: True)
    # Without a nominal value, a value remains.
    assert case == {**NOMINAL, 'unknown': CASE['unknown']}


def test_values_are_as_near_as_a_few_steps_allow_and_round():
    for violates, name, value in (
        (lambda case: case['force'] > 2.04, 'force', 3.0),
        (lambda case: case['force'] > 5.4, 'force', 6.0),
        (lambda case: 5.41 < case['force'] < 5.45, 'force', 5.43),
        (lambda case: case['direction'] < -30, 'direction', -40.0),
        (lambda case: case['delay'] > 3, 'delay', 4),
        (lambda case: case['level'] > 1, 'level', 3),
        (lambda case: case['level'] > 3, 'level', 10),
        (lambda case: case['switch'], 'switch', True),
    ):
        case, tried = shrink(violates)
        assert violates(case)
        assert (name, case[name], type(case[name])) == (name, value, type(value))
        assert deviations(case, VARIABLES, NOMINAL) == (name, 'unknown')
        assert tried < 60


def test_two_that_are_needed_together_both_remain():
    case, _ = shrink(lambda case: case['force'] > 2.0 or case['delay'] > 5)
    assert len(deviations(case, VARIABLES, NOMINAL)) == 2  # one of them, and the unknown one
    case, _ = shrink(lambda case: case['force'] > 2.0 and case['delay'] > 5)
    assert deviations(case, VARIABLES, NOMINAL) == ('force', 'delay', 'unknown')


def drawn(variable):
    """Return a strategy of values of a variable."""
    shares = st.floats(0.0, 1.0, exclude_max=True)
    return shares.map(lambda share: variable.distribution.values(np.array([share])).tolist()[0])


cases = st.fixed_dictionaries({each.name: drawn(each) for each in VARIABLES})
NUMBERS = [each.name for each in VARIABLES if each.name not in ('model', 'switch')]
conditions = st.lists(
    st.one_of(
        st.tuples(st.sampled_from(NUMBERS), st.just('above'), st.floats(-200.0, 12.0)),
        st.tuples(st.sampled_from(NUMBERS), st.just('below'), st.floats(-200.0, 12.0)),
        st.tuples(st.sampled_from([each.name for each in VARIABLES]), st.just('as'), st.none()),
    ),
    max_size=4,
)


@given(cases, conditions)
def test_a_simpler_case_still_violates_with_no_more_deviations(case, conditions):
    def violates(other):
        for name, kind, bound in conditions:
            if kind == 'as' and other[name] != case[name]:
                return False
            # What the case does not keep is no condition.
            if kind == 'above' and case[name] > bound >= other[name]:
                return False
            if kind == 'below' and case[name] < bound <= other[name]:
                return False
        return True

    simpler, _ = shrink(violates, case)
    assert violates(simpler)
    assert simpler.keys() == case.keys()
    differ = deviations(simpler, VARIABLES, NOMINAL)
    assert set(differ) <= set(deviations(case, VARIABLES, NOMINAL))
    for each in VARIABLES:
        value, of = simpler[each.name], each.distribution
        assert type(value) is type(case[each.name])
        if value == NOMINAL[each.name]:
            continue
        if isinstance(of, Levels):
            assert value in of.levels
        else:
            assert of.low <= value <= of.high
    again, _ = shrink(violates, simpler)
    assert len(deviations(again, VARIABLES, NOMINAL)) <= len(differ)


@given(st.floats(min_value=5e-324, max_value=1e308), st.floats(0.0, 1e308))
def test_any_number_becomes_rounder(value, nominal):
    variable = Variable('x', Parameter((), 'x', 0.0, ''), Uniform(0.0, 1e308))
    case = shrunk(
        {'x': value}, [variable], {'x': nominal}, lambda cases: [each['x'] > 0.0 for each in cases]
    )
    assert 0.0 < case['x'] < math.inf
    assert case['x'] in (nominal, float(f'{case["x"]:.0e}')) or value < 1e-290


def test_an_impossible_case_is_no_violation():
    whole = WholeNumbers(1, 9, Uniform(0.5, 9.5))
    variable = Variable('n', Parameter((), 'n', 0, ''), whole)
    case = shrunk(
        {'n': 9}, [variable], {'n': 1}, lambda cases: [each['n'] in (9, 5) for each in cases]
    )
    assert case == {'n': 5}
