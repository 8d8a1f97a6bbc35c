"""Dead time of everything gives the same duties in all arrangements of processes."""

import pytest

from ballbot_ros.parameters import PLANT
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.scenario.library import load_scenario
from ballbot_ros.simulation.golden import duty_sha256

pytestmark = pytest.mark.graph

DEAD_TIMES = {
    PLANT: {
        'actuator_delay': 1,
        'actuator_delay_jitter': 3,
        'duration': 1.6,
        'map': 'track',
        'on_wall_hit': 'report',
    },
    'gyro_driver': {'delay': 2, 'delay_jitter': 4, 'noise': 0.7},
    'encoder_driver': {'delay': 3},
    'sonar_driver': {'delay': 20, 'delay_jitter': 90},
}
SETTINGS = [
    (node, name, value) for node, values in DEAD_TIMES.items() for name, value in values.items()
]


@pytest.fixture(scope='module')
def expected_sha256():
    scenario = load_scenario('stationary')
    for setting in SETTINGS:
        scenario.parameters.set(*setting)
    return duty_sha256(scenario)


@pytest.mark.parametrize('processes', ['separate', 'one', 'none'])
def test_dead_times_are_the_same_everywhere_and_replayed(
    start_run, command, tmp_path, expected_sha256, processes
):
    settings = [f'--set={node}.{name}={value}' for node, name, value in SETTINGS]
    run = start_run('stationary', '--processes', processes, '--json', '--output', tmp_path,
                    *settings)  # fmt: skip
    assert run.finish() in (0, 1), run.stderr  # such a short run may miss the expectations
    assert run.result['duty_sha256'] == expected_sha256
    recording = tmp_path / 'stationary.mcap'
    with RecordingReader(recording) as reader:
        assert '/gyro' in reader.topics()
        assert '/plant/steps' not in reader.topics()
    status, output, errors = command('replay', recording)
    assert (status, errors) == (0, '')
    assert 'robot: identical, 400 ticks' in output
