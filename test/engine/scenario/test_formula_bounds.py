"""Bounds of formulas: no trace within the ranges of its signals has another robustness."""

import math
import random

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given, settings

from ballbot_ros.engine.scenario.formulas import ANY, Interval, Trace
from ballbot_ros.engine.scenario.property_language import parse_property

NAMES = 'duty_x_percent', 'duty_y_percent'
ORDINARY = Interval(-100.0, 100.0)


def bounds(text, **ranges):
    return parse_property('', text).formula.bounds(ranges or dict.fromkeys(NAMES, ORDINARY))


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('duty_x_percent < 150', (50, 250)),
        ('duty_x_percent > 150', (-250, -50)),
        ('always: duty_x_percent < 150', (50, math.inf)),
        ('eventually: duty_x_percent < 150', (-math.inf, 250)),
        ('not duty_x_percent < 150', (-250, -50)),
        ('duty_x_percent < 150 and duty_y_percent > -110', (10, 210)),
        ('duty_x_percent < 150 or duty_y_percent > -110', (50, 250)),
        ('duty_x_percent < 150 until: duty_y_percent > -110', (10, 210)),
        ('abs(duty_x_percent) < 150', (50, 150)),
        ('abs(duty_x_percent + 300) < 150', (-250, -50)),
        ('duty_x_percent + duty_y_percent < 150', (-50, 350)),
        ('duty_x_percent - duty_y_percent < 150', (-50, 350)),
        ('-2 * duty_x_percent < 150', (-50, 350)),
        ('duty_x_percent / 2 < 150', (100, 200)),
        ('duty_x_percent * duty_y_percent < 0', (-10000, 10000)),
        ('duty_x_percent / duty_y_percent < 1', (-math.inf, math.inf)),
        ('pitch_x_deg < 5', (-math.inf, math.inf)),
        ('abs(pitch_x_deg) > 0', (0, math.inf)),
        ('0 * pitch_x_deg < 1', (1, 1)),
        ('abs(pitch_x_deg) / pitch_y_deg < 1', (-math.inf, math.inf)),
        ('abs(pitch_x_deg) - abs(pitch_y_deg) < 1', (-math.inf, math.inf)),
    ],
)
def test_bounds_of_examples(text, expected):
    assert bounds(text) == expected


def random_value(picker, depth):
    if depth == 0 or picker.random() < 0.2:
        return picker.choice([*NAMES, f'{picker.uniform(0.5, 3.0):.3f}'])
    kind = picker.choice(['+', '-', '*', '/', 'abs', 'negative'])
    if kind == 'abs':
        return f'abs({random_value(picker, depth - 1)})'
    if kind == 'negative':
        return f'(-{random_value(picker, depth - 1)})'
    if kind in '*/':  # a number has no unit
        return f'({random_value(picker, depth - 1)} {kind} {picker.uniform(0.5, 3.0):.3f})'
    return f'({random_value(picker, depth - 1)} {kind} {random_value(picker, depth - 1)})'


def random_formula(picker, depth):
    if depth == 0 or picker.random() < 0.1:
        operator = picker.choice(['<', '<=', '>', '>='])
        return f'(({picker.choice(NAMES)} - {random_value(picker, 2)}) {operator} 1.5)'
    kind = picker.choice(['not', 'and', 'or', 'implies', 'always', 'eventually', 'until'])
    left = random_formula(picker, depth - 1)
    if kind == 'not':
        return f'(not {left})'
    start = picker.randrange(5)
    window = picker.choice(['', f' from {start * 4} to {(start + picker.randrange(9)) * 4} s'])
    window = window.replace(' s', 'e-3 s').replace(' to', 'e-3 to')
    if kind in ('always', 'eventually'):
        return f'({kind}{window}: {left})'
    right = random_formula(picker, depth - 1)
    return f'({left} until{window}: {right})' if kind == 'until' else f'({left} {kind} {right})'


finite = st.floats(-100.0, 100.0)
ranges = st.tuples(finite, finite).map(lambda pair: Interval(min(pair), max(pair)))


@given(st.integers(0, 10**6), st.tuples(ranges, ranges), st.integers(1, 30))
@settings(max_examples=200)
def test_no_robustness_is_beyond_the_bounds(seed, limits, length):
    picker, numbers = random.Random(seed), np.random.default_rng(seed)
    formula = parse_property('', random_formula(picker, picker.randrange(4))).formula
    # Also the ends, which are the extreme ones.
    shares = np.round(numbers.random((2, 3, length)) * 4.0) / 4.0
    signals = {
        name: np.clip(low + (high - low) * share, low, high)
        for name, (low, high), share in zip(NAMES, limits, shares, strict=True)
    }
    found = formula.values(
        Trace(lambda name, first, last: signals[name][:, first:last], length), 0, length
    )
    for known in (dict(zip(NAMES, limits, strict=True)), {NAMES[0]: limits[0]}, {}):
        low, high = formula.bounds(known)
        assert low <= high
        assert (found >= low).all()
        assert (found <= high).all()


@given(st.integers(0, 10**6), ranges, ranges)
def test_wider_ranges_have_wider_bounds(seed, one, other):
    picker = random.Random(seed)
    formula = parse_property('', random_formula(picker, 3)).formula
    inner, outer = (
        formula.bounds(dict.fromkeys(NAMES, each))
        for each in (one, Interval(min(one.low, other.low), max(one.high, other.high)))
    )
    assert outer.low <= inner.low <= inner.high <= outer.high
    assert formula.bounds(dict.fromkeys(NAMES, ANY)) == formula.bounds({})
