"""Faults given to the nodes of a running graph: recorded, replayed and branched identically."""

import contextlib
import json
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from graph import call
from ros_client import Client
from std_srvs.srv import SetBool

from ballbot_ros.analysis.figure_parts import IntervalKind
from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.nodes.gamepad_teleop import GamepadTeleop
from ballbot_ros.nodes.teleop.sticks import Command
from ballbot_ros.parameters import GamepadParameters
from ballbot_ros.recording.messages.topics import PLANT_IMU
from ballbot_ros.robot.brick.fault_effects import change_faults

GIVEN = {
    'gyro_driver': ('gyro_x stuck duration=0.02', 'gyro_y wrong amount=3'),
    'encoder_driver': ('encoder_x slow amount=12', 'encoder_y intermittent duration=0.1'),
    'sonar_driver': ('sonar stuck', 'sonar off'),
    'gamepad_teleop': ('gamepad delayed amount=80', 'gamepad off duration=0.2'),
    'plant_sim': ('motor_x stuck duration=0.012', 'battery sag amount=0.5', 'motor_y weak'),
    'controller': ('task_ts1 slow amount=300', 'task_lcd slow duration=0.5'),
}


@pytest.mark.graph
@pytest.mark.parametrize('processes', ['separate', 'one'])
def test_faults_given_on_the_way_are_part_of_the_run(start_run, domain, tmp_path, processes):
    run = start_run(
        'stationary', '--profile=hardware', '--processes', processes, '--json',
        '--real-time-factor', 0.1, '--output', tmp_path / 'run', '--set=plant_sim.duration=3',
        '--set=plant_sim.faults=battery sag time=0.2 duration=0.1; task_ts2 slow time=0.1',
    )  # fmt: skip
    with contextlib.closing(Client(domain)) as client:
        client.watch(PLANT_IMU)
        client.spin_until(lambda: PLANT_IMU.name in client.newest)
        client.spin_until(lambda: client.now_ns() > 1_200_000_000)
        pause = SetBool.Request(data=True)
        assert client.call(SetBool, 'plant_sim/pause', pause).success
        for node, texts in GIVEN.items():
            for number in range(len(texts)):
                answer = client.set_value(node, 'faults', '; '.join(texts[: number + 1]))
                assert (answer.successful, answer.reason) == (True, '')
        answer = client.set_value('gyro_driver', 'faults', 'gyro_x delayed')
        assert answer.reason.startswith('gyro_driver.faults: gyro_x delayed time=')
        assert client.set_value('plant_sim', 'real_time_factor', 0.0).successful
        pause.data = False
        assert client.call(SetBool, 'plant_sim/pause', pause).success
    assert run.finish() in (0, 1), run.stderr  # by when the faults began
    path = run.result['recording']
    recorded = read_run(path)
    given = {(node, 'faults') for node in GIVEN}
    assert run.result['outcome'] in ('changed', 'expectations not met')
    assert {(each['node'], each['parameter']) for each in run.result['parameter_changes']} == given
    assert {(each.node, each.name) for each in recorded.outside_changes} == given
    shaded = {each.name for each in recorded.marked if each.kind is IntervalKind.FAULT}
    assert shaded == {
        'task_ts2 slow', *(' '.join(each.split()[:2]) for texts in GIVEN.values() for each in texts)
    }  # fmt: skip
    told = json.loads(call('info', path, '--json').stdout)['faults']
    assert {' '.join(each.split()[:2]) for each in told} == shaded
    assert [each for each in told if each.startswith('task_ts2 slow time=0.1 duration=')]
    replayed = call('replay', path)
    assert replayed.returncode == 0, replayed.stdout + replayed.stderr
    branch = call('branch', path, '--at', 2.5, '--output', tmp_path / 'branch', '--json')
    assert branch.returncode == 0, branch.stderr
    assert json.loads(branch.stdout)['duty_sha256'] == recorded.duty_sha256


def test_packets_before_a_fault_of_the_gamepad_are_known():
    node = SimpleNamespace(_sent={}, _faults=[], parameters=GamepadParameters())
    start_ns, found = 1_000_000_000, []
    for number in range(12):
        if number == 4:
            given = node.parameters.with_values({'faults': 'gamepad off time=0.1 duration=0.06'})
            change_faults(node._faults, given, start_ns)
        command = Command('', (number, 0))
        arrived = GamepadTeleop._arrived(node, start_ns + number * 20_000_000, command)
        found.append(arrived.sticks[0])
    assert found == [0, 1, 2, 3, 4, 4, 4, 4, 8, 9, 10, 11]
