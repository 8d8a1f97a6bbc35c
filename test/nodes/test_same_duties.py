"""The duties depend on scenario and seed only, whatever the delays of the nodes."""

import os
import random
import signal
import time

import pytest
from graph import NODES

from ballbot_ros.engine.golden import duty_sha256
from ballbot_ros.engine.scenario.reader import load_scenario

pytestmark = pytest.mark.graph

SETTINGS = [
    ('gyro_driver', 'noise', 0.7),
    ('plant_sim', 'duration', 1.5),
    ('plant_sim', 'battery_model', 'draining'),
]


# Other ways of running: test_recording_of_runs.py; other orders of messages:
# lockstep/test_robot_world.py.
@pytest.mark.slow
def test_delays_in_any_node_change_no_duty(start_run, tmp_path):
    """Nodes are suspended at random, each for longer than many ticks."""
    choose = random.Random(0)
    settings = [f'--set={node}.{name}={value}' for node, name, value in SETTINGS]
    run = start_run('stationary', '--json', '--output', tmp_path, *settings)
    pids = run.nodes()
    while run.process.poll() is None:
        pid = pids[choose.choice(NODES)]
        try:
            os.kill(pid, signal.SIGSTOP)
            time.sleep(choose.uniform(0.001, 0.25))
            os.kill(pid, signal.SIGCONT)
        except ProcessLookupError:
            break
        time.sleep(choose.uniform(0.0, 0.1))
    assert run.finish() in (0, 1), run.stderr  # such a short run may miss the expectations
    assert run.result['ticks'] == 375
    scenario = load_scenario('stationary')
    for setting in SETTINGS:
        scenario.parameters.set(*setting)
    assert run.result['duty_sha256'] == duty_sha256(scenario)
