"""Parameters set while a graph runs: each run uses, and announces, the values at its start."""

import re

import pytest

pytest.importorskip('rclpy')

from graph import NODES, call
from std_srvs.srv import Trigger

from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.nodes.node_parameters import NEXT_RUN
from ballbot_ros.parameters import (
    CONTROLLER,
    ControllerParameters,
    EncoderParameters,
    GyroParameters,
    PlantParameters,
    SonarParameters,
)
from ballbot_ros.recording.messages.topics import PARAMETER_EVENTS, PLANT_IMU

pytestmark = pytest.mark.graph

DRIVERS = [name for name in NODES if name not in ('plant_sim', 'recorder')]


def test_each_run_is_recorded_and_replayed_with_its_own_values(start_node, client, tmp_path):
    path = tmp_path / 'runs.mcap'
    for name in DRIVERS:
        start_node(name, remap=f'__node:=my_{name}')
    recorder = start_node('recorder', output=path)
    plant = start_node(
        'plant_sim', remap='__node:=ball_plant', real_time_factor=0, require_recorder='true'
    )
    client.watch(PARAMETER_EVENTS)
    client.spin_until(lambda: PLANT_IMU.name in client.newest and client.now_ns() > 1_500_000_000)
    for node, name, value in (
        ('my_gyro_driver', 'noise', 0.5),
        ('my_gyro_driver', 'seed', 3),
        ('my_encoder_driver', 'seed', 3),
        ('my_encoder_driver', 'delay', 3),
        ('my_encoder_driver', 'delay_jitter', 2),
        ('my_sonar_driver', 'seed', 3),
        ('my_controller', 'seed', 3),
        ('my_gamepad_teleop', 'seed', 3),
        ('my_controller', 'ts2_period', 4),
        ('ball_plant', 'seed', 3),
        ('ball_plant', 'actuator_delay', 2),
        ('ball_plant', 'start_pitch_x', 0.02),
        ('ball_plant', 'map', 'corridor'),
        ('my_sonar_driver', 'map', 'corridor'),
        ('ball_plant', 'duration', 2),
    ):
        assert client.set_value(node, name, value).reason == NEXT_RUN
    # Gains take effect at once, and stay for the next run.
    assert client.set_value('my_controller', 'pwm_gain', 0.9).reason == ''
    client.spin_until(lambda: client.seen.get(PARAMETER_EVENTS.name))
    first_end = client.now_ns()
    assert client.call(Trigger, 'plant_sim/reset', Trigger.Request()).success
    assert plant.finish() == 0
    assert 'run 2 completed after 500 ticks' in plant.output
    assert recorder.interrupt() == 0

    replayed = call('replay', path, '--controller=python')
    assert replayed.returncode == 0
    assert re.findall(r'(\w+), 2 runs: identical', replayed.stdout) == ['controller', 'robot']
    first, second = read_run(path, 1), read_run(path, 2)
    assert first.end * 1e9 + 1e9 > first_end - 1e9
    assert [each[1:] for each in first.parameter_changes] == [(CONTROLLER, 'pwm_gain', 0.9)]
    assert second.parameter_changes == ()
    told = [run.attached.parameters for run in (first, second)]
    assert [each.of(GyroParameters).noise for each in told] == [0.0, 0.5]
    assert [each.of(EncoderParameters).delay for each in told] == [0, 3]
    assert [each.of(SonarParameters).seed for each in told] == [1, 3]
    assert [each.of(ControllerParameters).pwm_gain for each in told] == [1.0, 0.9]
    assert [each.of(PlantParameters).map for each in told] == ['', 'corridor']
    assert (first.grid, second.attached.has_parameters) == (None, True)
    assert second.grid is not None
    assert second.complete
