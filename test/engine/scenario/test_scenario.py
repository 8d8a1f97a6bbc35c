"""The expectations of a scenario, and its effects on the robot."""

import math

import pytest
from parts import step

from ballbot_ros.engine.scenario.metrics import METRICS
from ballbot_ros.engine.scenario.scenario import Expectation, Scenario, ScheduledPush
from ballbot_ros.robot.plant.ground_truth import Push


@pytest.mark.parametrize(
    ('minimum', 'maximum', 'within', 'without'),
    [
        (1.0, 3.0, (1.0, 2.0, 3.0), (0.999, 3.001, math.nan, math.inf)),
        (None, 3.0, (-math.inf, 3.0), (3.001, math.nan)),
        (1.0, None, (1.0, math.inf), (0.999, math.nan)),
        (None, None, (0.0, math.inf), (math.nan,)),
    ],
)
def test_an_expectation_holds_within_its_bounds_and_never_for_nan(
    minimum, maximum, within, without
):
    expectation = Expectation('settling_time_s', minimum, maximum)
    assert all(expectation.holds(value) for value in within)
    assert not any(expectation.holds(value) for value in without)


def test_the_text_of_an_expectation_has_its_bounds():
    assert str(Expectation('x', 1.0, 2.5)) == '1 … 2.5'
    assert str(Expectation('x', maximum=2.5)) == '≤ 2.5'
    assert str(Expectation('x', minimum=0.0)) == '≥ 0'


def test_the_text_of_an_expectation_has_its_window():
    assert Expectation('x', 1.0).window == ''
    assert Expectation('x', 1.0, start=2.0).window == '2 s to the end'
    assert Expectation('x', 1.0, start=2.0, end=3.5).window == '2 s to 3.5 s'


def test_sticks_are_vertical_then_horizontal():
    scenario = Scenario(vertical=step(1.0, -100), horizontal=step(2.0, 40))
    assert [scenario.sticks_at(time) for time in (0.0, 1.0, 2.0)] == [(0, 0), (-100, 0), (-100, 40)]


def test_pushes_count_from_the_start_of_the_run():
    scenario = Scenario(
        pushes=(ScheduledPush(1.5, 0.1, force=2.0, direction='left'), ScheduledPush(0.0, 0.004))
    )
    assert scenario.pushes_from(10**9) == [
        Push(2_500_000_000, 2_600_000_000, (0.0, -2.0)),
        Push(1_000_000_000, 1_004_000_000, (0.0, 0.0)),
    ]


def test_every_metric_has_a_unit_in_its_name_and_a_meaning():
    for name, meaning in METRICS.meanings.items():
        endings = ('_s', '_deg', '_m', '_percent', '_share', '_ms', '_jobs', 'utilisation')
        assert name.endswith(endings)
        assert meaning
