"""Conditions on changes of metrics: their form, and when they hold."""

import math

import pytest
from hypothesis import strategies as st
from laws import given, is_read_or_refused_in_one_line

from ballbot_ros.analysis.comparison import Condition, ConditionError, parse_condition

METRICS = ('peak_pitch_deg', 'energy_j')
AMOUNTS = st.floats(0, 1e6).map(lambda x: float(f'{x:.6f}'))
CONDITIONS = st.builds(
    Condition, st.sampled_from(METRICS), st.sampled_from('<>'), AMOUNTS, st.booleans()
)
VALUES = st.floats(-1e6, 1e6)


@given(CONDITIONS)
def test_a_condition_reads_back_from_its_text(condition):
    read = parse_condition(f' {condition} ', METRICS)
    assert (read.metric, read.sign, read.percent) == (
        condition.metric,
        condition.sign,
        condition.percent,
    )
    assert read.amount == pytest.approx(condition.amount, rel=1e-11)


@given(st.text(max_size=30))
def test_any_text_is_a_condition_or_refused_in_one_line(text):
    assert is_read_or_refused_in_one_line(parse_condition, text, METRICS)


@pytest.mark.parametrize(
    'text',
    ['', 'energy_j', 'energy_j>', '>5', 'energy_j>-1', 'energy_j>=1', 'energy_j>5%%',
     'energy_j>nan', 'energy_j>1e3', 'energy_j>inf', 'no_such>5', 'energy>5'],
)  # fmt: skip
def test_other_forms_and_metrics_are_refused(text):
    with pytest.raises(ConditionError) as refused:
        parse_condition(text, METRICS)
    assert repr(text) in str(refused.value)


def test_a_typo_gets_a_hint():
    with pytest.raises(ConditionError, match='did you mean peak_pitch_deg'):
        parse_condition('peak_pitch_degree>5', METRICS)


CASES = [
    ('energy_j>5%', 100.0, 105.0, False),
    ('energy_j>5%', 100.0, 105.1, True),
    ('energy_j>5%', -100.0, -94.9, True),
    ('energy_j<5%', 100.0, 94.9, True),
    ('energy_j<5%', 100.0, 110.0, False),
    ('energy_j>0.1', 1.0, 1.2, True),
    ('energy_j>0.1', 1.0, 1.05, False),
    ('energy_j<0.1', 1.0, 0.8, True),
    ('energy_j>5%', 0.0, 1e-9, True),
    ('energy_j>0%', 1.0, 1.0, False),
    ('energy_j>5%', 1.0, math.nan, True),
    ('energy_j<5%', 1.0, math.nan, True),
    ('energy_j>5%', math.nan, 1.0, False),
    ('energy_j>5%', math.nan, math.nan, False),
]


def test_when_a_condition_holds():
    for text, reference, value, holds in CASES:
        condition = parse_condition(text, METRICS)
        assert condition.holds(reference, value) is holds, (text, reference, value)


@given(CONDITIONS, VALUES)
def test_no_condition_holds_without_a_change(condition, value):
    assert not condition.holds(value, value)


@given(CONDITIONS, VALUES, VALUES)
def test_a_rise_is_the_fall_of_the_mirrored_metric(condition, reference, value):
    other = Condition(condition.metric, '<' if condition.sign == '>' else '>', condition.amount,
                      condition.percent)  # fmt: skip
    assert condition.holds(reference, value) == other.holds(-reference, -value)
