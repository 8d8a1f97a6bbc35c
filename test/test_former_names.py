"""Former names: what reads or writes them has the current ones, too."""

import pytest

from ballbot_ros.analysis.run_metrics import RUN_METRICS
from ballbot_ros.former_names import (
    FORMER_METRICS,
    FORMER_PLANT_KEYS,
    current_metric,
    with_current_names,
    with_former_names,
    without_former_names,
)
from ballbot_ros.scenario.metrics import METRICS


@pytest.mark.parametrize('former', FORMER_METRICS)
def test_a_former_metric_stands_for_one_of_today(former):
    known = {*METRICS, *RUN_METRICS}
    assert former not in known
    assert current_metric(former) in known


def test_a_current_metric_is_itself():
    assert {current_metric(name) for name in METRICS} == METRICS.keys()


def test_a_value_that_is_missing_has_no_former_name_either():
    values = {'ticks': 1, 'resends': 2}
    assert with_former_names(values, FORMER_PLANT_KEYS) == {
        **values,
        'asked again': 2,
        'asked_again': 2,
    }
    assert values == {'ticks': 1, 'resends': 2}


def test_a_current_name_counts_more_than_a_former_one():
    values = {'overruns': 1, 'asked again': 2, 'resends': 3}
    assert with_current_names(values, FORMER_PLANT_KEYS) == {**values, 'late ticks': 1}


def test_a_former_name_is_left_out_only_beside_the_current_one():
    values = {'overruns': 1, 'asked again': 2, 'resends': 2}
    assert without_former_names(values, FORMER_PLANT_KEYS) == {'overruns': 1, 'resends': 2}
