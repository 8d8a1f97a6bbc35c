"""Faults of every kind in the graph, in every way of running, and their replay."""

import json

import pytest
from graph import call

SCENARIO = """purpose: faults of every kind
duration: 4.5
profile: {profile}
map: corridor
sticks:
  vertical:
    - {{name: forward, points: [[1.5, 0], [4.0, -90]]}}
faults:
  - {{component: gyro_x, type: wrong, time: 2.0, duration: 0.02, amount: 10}}
  - {{component: gyro_y, type: stuck, time: 2.1, duration: 0.03}}
  - {{component: gyro_x, type: slow, time: 2.2, duration: 0.5, amount: 8}}
  - {{component: gyro_y, type: delayed, time: 2.2, duration: 0.5, amount: 5}}
  - {{component: encoder_x, type: garbage, time: 2.6, duration: 0.008}}
  - {{component: encoder_y, type: delayed, time: 2.7, duration: 0.2, amount: 9}}
  - {{component: sonar, type: stuck, time: 1.0, duration: 1}}
  - {{component: sonar, type: intermittent, time: 2.0, duration: 1}}
  - {{component: motor_x, type: weak, time: 2.5, duration: 0.2, amount: 0.8}}
  - {{component: motor_y, type: stuck, time: 2.7, duration: 0.012}}
  - {{component: battery, type: sag, time: 2.3, duration: 1}}
  - {{component: gamepad, type: delayed, time: 1.0, duration: 1}}
  - {{component: gamepad, type: intermittent, time: 2.5, duration: 1}}
  - {{component: brick, type: restart, time: 2.802, duration: 0.013}}
  - {{component: battery, type: brown-out, time: 4.1, duration: 0.05}}
"""
SLOW_TASK = '  - {component: task_ts1, type: slow, time: 2, duration: 1, amount: 300}\n'


@pytest.mark.graph
@pytest.mark.parametrize('profile', ['ideal', 'hardware'])
def test_faults_are_the_same_in_the_graph_and_without_it(start_run, tmp_path, profile):
    path = tmp_path / 'faults.yaml'
    text = SCENARIO.format(profile=profile) + SLOW_TASK * (profile == 'hardware')
    path.write_text(text, encoding='utf-8')
    found = set()
    for processes in ('separate', 'none'):
        output = tmp_path / processes
        run = start_run(path, f'--processes={processes}', '--output', output, '--json')
        assert run.finish() == 0, run.result['reason']
        found.add(run.result['duty_sha256'])
        done = call('replay', output / 'faults.mcap', '--json')
        replayed = json.loads(done.stdout)
        assert done.returncode == 0, replayed
    assert len(found) == 1
