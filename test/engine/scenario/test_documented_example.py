"""The page on scenarios: its example runs, and it is complete."""

import re
from pathlib import Path

import pytest

from ballbot_ros.engine.scenario.metrics import METRICS
from ballbot_ros.engine.scenario.reader import SCENARIO_KEYS, load_scenario

PAGE = (Path(__file__).parents[3] / 'docs/scenarios.md').read_text(encoding='utf-8')
EXAMPLE = re.search(r'```yaml\n(.*?)```', PAGE, re.DOTALL)[1]


@pytest.fixture
def example(tmp_path):
    path = tmp_path / 'there_and_back.yaml'
    path.write_text(EXAMPLE, encoding='utf-8')
    return path


def test_the_example_has_every_key_but_the_map(example):
    load_scenario(str(example))
    assert set(re.findall(r'^(\w+):', EXAMPLE, re.MULTILINE)) == SCENARIO_KEYS - {'map'}


def test_the_example_meets_its_expectations(start_run, example):
    run = start_run(example, '--processes=none', '--no-record', '--json')
    assert run.finish() == 0, run.result['reason']


def test_every_key_and_metric_is_on_the_page():
    assert [key for key in (*SCENARIO_KEYS, *METRICS) if f'`{key}`' not in PAGE] == []
