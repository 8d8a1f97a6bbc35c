"""The robustness of properties: laws, parts of runs, and an independent judge."""

import math
import pickle
import random
import sys
import typing

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot_ros.engine.scenario.formulas import (
    Always,
    Comparison,
    Formula,
    Negation,
    Trace,
    Until,
    Value,
    eventually,
    negation,
)
from ballbot_ros.engine.scenario.properties import (
    Course,
    MissingSignalError,
    MotionSignals,
    Part,
    Property,
)
from ballbot_ros.engine.scenario.property_language import SIGNAL_UNITS, parse_property
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.robot.world.clearance import clearance, walls_around
from ballbot_ros.robot.world.floor_map import load_map

sys.modules.setdefault('typing.io', typing)  # rtamt's parser imports it, Python 3.13 lacks it
import rtamt  # noqa: E402

NAMES = 'pitch_x_deg', 'pitch_y_deg', 'estimated_pitch_x_deg'
TOLERANCE = 1e-9


def trace_of(**signals):
    """Return a trace of signals, each (n,) or (r, n)."""
    arrays = {name: np.atleast_2d(np.asarray(each, float)) for name, each in signals.items()}
    end = next(iter(arrays.values())).shape[1]
    return Trace(lambda name, first, last: arrays[name][:, first:last], end)


def values_of(formula, trace):
    return formula.values(trace, 0, trace.end)


def above(name, number=0.0):
    return Comparison(Value(name), Value(number))


def random_formula(random, depth):
    """Return the same random formula in this package's language and in that of rtamt."""
    if depth == 0 or random.random() < 0.1:
        return random_comparison(random)
    kind = random.choice(['not', 'and', 'or', 'implies', 'always', 'eventually', 'until'])
    ours, theirs = random_formula(random, depth - 1)
    if kind == 'not':
        return f'not ({ours})', f'not({theirs})'
    start = random.randrange(6)
    end = start + random.randrange(12)
    window = f' from {start * TICK_S:.3f} to {end * TICK_S:.3f} s'
    bounds = f'[{start},{end}]'
    if random.random() < 0.3:
        window = bounds = ''
    if kind in ('always', 'eventually'):
        return f'({kind}{window}: {ours})', f'({kind}{bounds}({theirs}))'
    other, others = random_formula(random, depth - 1)
    if kind == 'until':
        return f'(({ours}) until{window}: ({other}))', f'(({theirs}) until{bounds} ({others}))'
    return f'(({ours}) {kind} ({other}))', f'(({theirs}) {kind} ({others}))'


def random_comparison(random):
    def value(depth=2):
        if depth == 0 or random.random() < 0.3:
            return random.choice([*NAMES, f'{random.uniform(0.5, 3.0):.3f}'])
        kind = random.choice(['+', '-', '*', 'abs'])
        if kind == 'abs':
            return f'abs({value(depth - 1)})'
        if kind == '*':
            return f'{random.uniform(0.5, 3.0):.3f} * ({value(depth - 1)})'
        return f'({value(depth - 1)} {kind} {value(depth - 1)})'

    operator = random.choice(['<', '<=', '>', '>='])
    # One side has a signal, as it must.
    text = f'({random.choice(NAMES)} - {value()}) {operator} {value()}'
    return text, f'({text})'


@pytest.mark.parametrize('seed', range(10))
def test_agrees_with_an_independent_judge(seed):
    randoms = random.Random(seed)
    for number in range(50):
        ours, theirs = random_formula(randoms, randoms.randrange(4))
        length = randoms.randrange(2, 40)
        signals = {
            name: [round(randoms.uniform(-4.0, 4.0), 6) for _ in range(length)] for name in NAMES
        }
        judge = rtamt.StlDiscreteTimeSpecification()
        for name in NAMES:
            judge.declare_var(name, 'float')
        judge.spec = theirs
        judge.parse()
        judged = judge.evaluate({'time': list(range(length)), **signals})
        expected = np.array([value for _, value in judged], float)
        formula, trace = parse_property('', ours).formula, trace_of(**signals)
        np.testing.assert_allclose(
            values_of(formula, trace)[0], expected, rtol=0.0, atol=TOLERANCE,
            err_msg=f'{number}: {ours}',
        )  # fmt: skip
        # Asked for one tick, as at the begin of a part, it is the same.
        for tick in {0, length // 2, length - 1}:
            (value,) = formula.values(trace, tick, tick + 1)[0]
            assert value == values_of(formula, trace)[0, tick], ours


signals = st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=40)
windows = st.tuples(st.integers(0, 10), st.integers(0, 20) | st.just(math.inf)).map(
    lambda pair: (pair[0], pair[0] + pair[1])
)


@given(signals, windows)
def test_always_is_never_the_opposite(signal, window):
    trace, formula = trace_of(x=signal), above('x')
    always = values_of(Always(*window, formula), trace)
    opposite = Negation(eventually(*window, Negation(formula)))
    assert always.tolist() == values_of(opposite, trace).tolist()
    for opposite in (Negation(formula), negation(formula)):
        assert (values_of(opposite, trace) == -values_of(formula, trace)).all()


@given(signals, windows)
def test_windows_are_those_of_the_definition(signal, window):
    trace = trace_of(x=signal)
    for operator, choose, otherwise in ((Always, min, math.inf), (eventually, max, -math.inf)):
        (found,) = values_of(operator(*window, above('x')), trace)
        for tick, value in enumerate(found):
            last = min(tick + window[1] + 1, len(signal))
            seen = signal[tick + window[0] : int(last)]
            assert value == (choose(seen) if seen else otherwise)


@given(signals, signals, st.integers(0, 20) | st.just(math.inf))
def test_eventually_is_an_until_of_no_condition(one, other, end):
    length = min(len(one), len(other))
    trace = trace_of(x=one[:length], y=other[:length])
    true = Comparison(Value('x'), Value(-math.inf))
    some = values_of(eventually(0, end, above('y')), trace)
    assert values_of(Until(end, true, above('y')), trace).tolist() == some.tolist()
    assert (values_of(Until(end, above('x'), above('y')), trace) <= some).all()


@given(signals, windows, st.floats(-5.0, 5.0))
def test_robustness_is_the_distance_of_the_signal_from_violation(signal, window, shift):
    trace, (start, end) = trace_of(x=signal), window
    for operator, sign in ((Always, -1), (eventually, 1)):
        formula = operator(start, end, above('x'))
        moved = values_of(formula, trace_of(x=np.array(signal) + shift))
        np.testing.assert_allclose(moved, values_of(formula, trace) + shift, atol=1e-9)
        # A longer window asks for more of always, and for less of eventually.
        wider = values_of(operator(start, end + 3, above('x')), trace)
        assert (sign * wider >= sign * values_of(formula, trace)).all()


@given(st.integers(0, 10**6))
@settings(max_examples=60)
def test_the_moment_has_the_value_of_the_robustness(seed):
    randoms = random.Random(seed)
    ours, _ = random_formula(randoms, 3)
    formula = parse_property('', ours).formula
    length = randoms.randrange(1, 40)
    trace = trace_of(**{name: [randoms.uniform(-4, 4) for _ in range(length)] for name in NAMES})
    (value,) = formula.values(trace, 0, 1)[0]
    tick = formula.decision(trace, 0)
    if math.isinf(value):
        assert tick is None
        return
    # Some comparison has this value, or its opposite, at this tick.
    found = [each.values(trace, tick, tick + 1)[0, 0] for each in comparisons(formula)]
    assert value in found or -value in found


def comparisons(formula):
    if isinstance(formula, Comparison):
        return [formula]
    parts = [each for each in vars(formula).values() if isinstance(each, Formula)]
    return [found for each in parts for found in comparisons(each)]


def test_runs_do_not_depend_on_each_other():
    randoms = np.random.default_rng(1)
    arrays = {name: randoms.normal(size=(5, 60)) for name in NAMES}
    picker = random.Random(2)
    for _ in range(20):
        formula = parse_property('', random_formula(picker, 3)[0]).formula
        together = values_of(formula, trace_of(**arrays))
        for run in range(5):
            alone = values_of(
                formula, trace_of(**{name: each[run] for name, each in arrays.items()})
            )
            assert alone[0].tolist() == together[run].tolist()


def test_a_missing_value_makes_what_needs_it_unknown():
    trace = trace_of(x=[1.0, math.nan, 3.0, 2.0])
    always = Always(0, 1, above('x'))
    assert np.isnan(values_of(always, trace)[0]).tolist() == [True, True, False, False]
    until = Until(math.inf, above('x'), above('x'))
    assert np.isnan(values_of(until, trace)[0]).tolist() == [True, True, False, False]


WHOLE = Part(250, 2500)
COURSE = Course(
    {'push': [(0.5, 0.6), (3.0, 3.1), (9.0, 11.0)]},
    'remote',
)


def parts(text, course=COURSE):
    return parse_property('', text).parts(1.0, WHOLE.last, course)


def test_scopes_select_parts_of_a_run():
    state = 'always: pitch_x_deg < 5'
    for text, expected in {
        state: [WHOLE],
        # After its end; the first push ends before the release, the last after the run.
        f'after each push: {state}': [WHOLE, Part(775, 2500)],
        f'after push 2: {state}': [Part(775, 2500)],
        f'after push 3: {state}': [],
        f'after the first push: {state}': [WHOLE],
        f'after each fault: {state}': [],
        # Up to its begin.
        f'until the first push: {state}': [],
        f'until push 2: {state}': [Part(250, 750)],
        f'until fault 1: {state}': [WHOLE],
        f'while remote: {state}': [WHOLE],
        f'while autonomous: {state}': [],
        f'from 3 s: {state}': [Part(750, 2500)],
        f'from 3 to 4 s: {state}': [Part(750, 1001)],
        f'from 3.001 to 3.01 s: {state}': [Part(751, 753)],
        f'while remote: after push 2: until push 3: {state}': [Part(775, 2250)],
    }.items():
        assert parts(text) == expected, text


def test_the_worst_part_decides():
    pitch = np.zeros(2500)
    pitch[1000], pitch[2400], pitch[100] = 2.0, 4.0, 9.0
    trace = trace_of(pitch_x_deg=pitch)
    upright = parse_property('', 'after each push: always for 1 s: pitch_x_deg < 5')
    both = [Part(990, 2500), Part(2200, 2500)]
    assert upright.robustness(trace.signals, both).tolist() == [1.0]
    assert upright.decision(trace.signals, both) == 2400
    assert upright.robustness(trace.signals, both[:1]).tolist() == [3.0]
    assert upright.decision(trace.signals, both[:1]) == 1000
    assert upright.robustness(trace.signals, []).tolist() == [math.inf]
    assert upright.decision(trace.signals, []) is None


def test_a_part_that_is_too_short_decides_nothing():
    trace = trace_of(pitch_x_deg=np.zeros(2500))
    upright = parse_property('', 'eventually within 2 s: always for 3 s: pitch_x_deg < 5')
    # The windows end one tick after the part: the end of the run is no tick.
    assert upright.robustness(trace.signals, [Part(1250, 2500)]).tolist() == [5.0]
    short = [Part(250, 2500), Part(1251, 2500)]
    assert np.isnan(upright.robustness(trace.signals, short)).all()
    assert upright.decision(trace.signals, short) is None
    assert upright.shortage(short) == 'it looks 5 s ahead from 5.004 s, but that ends at 10 s'
    always = parse_property('', 'always: eventually within 2 s: pitch_x_deg < 5')
    assert always.robustness(trace.signals, [Part(2499, 2500)]).tolist() == [5.0]


def motion(runs=2, ticks=40, **other):
    randoms = np.random.default_rng(3)
    position, psi = randoms.normal(size=(2, runs, ticks, 2))
    duty = randoms.integers(-100, 101, (runs, ticks, 2)).astype(np.int8)

    def find(name):
        raise MissingSignalError(name)

    return MotionSignals(np.arange(ticks) * TICK_S, position, psi, duty, find, **other)


def test_signals_of_the_motion():
    signals = motion()
    for plane in range(2):
        letter = 'xy'[plane]
        for name, expected in {
            f'pitch_{letter}_deg': np.degrees(signals.psi[:, :, plane]),
            f'position_{letter}_m': signals.position[:, :, plane],
            f'duty_{letter}_percent': signals.duty[:, :, plane].astype(float),
        }.items():
            assert (signals.values(name, 3, 9) == expected[:, 3:9]).all(), name
        speed = signals.values(f'speed_{letter}_m_per_s', 0, 40)
        assert np.isnan(speed[:, 0]).all()
        steps = np.diff(signals.position[:, :, plane], axis=1) / np.diff(signals.time)
        assert (speed[:, 1:] == steps).all()
        assert (signals.values(f'speed_{letter}_m_per_s', 7, 9) == speed[:, 7:9]).all()
    for name in set(SIGNAL_UNITS) - {
        f'{name}_{letter}_{unit}'
        for letter in 'xy'
        for name, unit in (
            ('pitch', 'deg'), ('position', 'm'), ('duty', 'percent'), ('speed', 'm_per_s')
        )
    }:  # fmt: skip
        with pytest.raises(MissingSignalError, match=name):
            signals.values(name, 0, 1)


def test_the_clearance_is_that_of_every_fifth_tick():
    walls = walls_around(load_map('track'), 10.0, 10.0)
    signals = motion(walls=walls)
    whole = signals.values('wall_clearance_m', 0, 40)
    assert (whole[0] == np.repeat(clearance(walls, signals.position[0, ::5]), 5)).all()
    assert (signals.values('wall_clearance_m', 7, 12) == whole[:, 7:12]).all()


def test_properties_can_be_sent_to_other_processes():
    each = parse_property('a', 'after each push: pitch_x_deg < 5 until: abs(pitch_x_deg) < 1')
    assert isinstance(each, Property)
    assert pickle.loads(pickle.dumps(each)) == each
