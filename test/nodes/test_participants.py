"""Runs with leftover, duplicate, foreign and user-written nodes."""

import json
import os
import signal
from pathlib import Path

import pytest

rclpy = pytest.importorskip('rclpy')

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue  # noqa: E402
from geometry_msgs.msg import Vector3Stamped  # noqa: E402
from graph import call  # noqa: E402
from std_msgs.msg import Header  # noqa: E402

from ballbot_ros.engine.trajectory import load_trajectory  # noqa: E402
from ballbot_ros.lockstep.participants import Announcement, Participant  # noqa: E402
from ballbot_ros.nodes.endpoints import reliable_qos  # noqa: E402
from ballbot_ros.parameters import CONTROLLER, GAMEPAD, NODES, PLANT, RECORDER, SONAR  # noqa: E402
from ballbot_ros.recording.messages.conversions import time_ns  # noqa: E402
from ballbot_ros.recording.messages.run_reports import encode_announcement  # noqa: E402
from ballbot_ros.recording.messages.topics import (  # noqa: E402
    DIAGNOSTICS,
    GYRO_IMU,
    HISTORY,
    MOTOR_DUTY,
    PARTICIPANTS,
    ROLL_CALL,
)
from ballbot_ros.recording.reader import RecordingReader  # noqa: E402
from campaign.site import descendants  # noqa: E402

pytestmark = pytest.mark.graph

OTHERS = [name for name in NODES if name not in (PLANT, RECORDER)]


def counts(folder):
    (path,) = folder.glob('*.mcap')
    with RecordingReader(path) as reader:
        assert reader.damage is None
        return {name: topic.message_count for name, topic in reader.topics().items()}


@pytest.mark.parametrize('slow', ['leftover', 'own'])
def test_a_run_next_to_leftover_nodes_waits_for_slow_nodes(start_node, start_run, client, slow):
    """Otherwise it would begin without the leftover nodes, or with them in place of its own."""
    leftover = [start_node(name).process.pid for name in OTHERS]
    assert start_node(PLANT, duration=0.1, real_time_factor=0.0).finish() == 0
    suspended = leftover if slow == 'leftover' else []
    for process in suspended:
        os.kill(process, signal.SIGSTOP)
    client.watch(ROLL_CALL, depth=100)
    run = start_run('stationary', '--json', '--no-record', '--set', 'plant_sim.duration=60')
    while len(suspended) < len(OTHERS):
        # At once, before a node takes part in anything.
        run.assert_running()
        for process in set(descendants(run.process.pid)).difference(suspended):
            if Path(f'/proc/{process}/comm').read_text().strip() in OTHERS:
                os.kill(process, signal.SIGSTOP)
                suspended.append(process)

    def calls():
        run.assert_running()
        return client.seen.get(ROLL_CALL.name, ())

    client.spin_until(lambda: len(calls()) > 20, what='the roll calls')
    for process in suspended:
        os.kill(process, signal.SIGCONT)
    client.spin_until(lambda: run.process.poll() is not None, what='the end of the run')
    assert run.finish() == 1
    assert run.result['ticks'] == 0
    assert 'two nodes publish on' in run.result['reason']


def test_leftover_nodes_and_a_restarted_one_serve_the_next_plant(start_node, tmp_path):
    nodes = {name: start_node(name) for name in OTHERS}
    recorder = start_node(RECORDER, output=tmp_path / 'all.mcap')
    hashes = []
    for number in range(3):
        path = tmp_path / f'{number}.npz'
        # The second run has another pose, so its nodes keep other answers to the first tick.
        pose, duration = (0.02, 0.004) if number == 1 else (0.07, 1.5)
        plant = start_node(PLANT, duration=duration, start_pitch_x=pose, real_time_factor=0.0,
                           require_recorder='true', trajectory_file=path)  # fmt: skip
        assert plant.finish() == 0, plant.output
        hashes.append(load_trajectory(path)[1]['duty_sha256'])
        nodes[CONTROLLER].kill()
        nodes[CONTROLLER] = start_node(CONTROLLER)
    assert hashes[0] == hashes[2]
    assert nodes[CONTROLLER].process.poll() is None
    recorder.interrupt()
    assert 'lost' not in recorder.output, recorder.output
    ticks = 375 + 1 + 375
    found = counts(tmp_path)
    assert [found[name] for name in ('/gyro', '/motor_duty', '/controller/state')] == [ticks] * 3


def test_forged_diagnostics_change_neither_verdict_nor_recording(start_run, client, tmp_path):
    forged = KeyValue(key='outcome', value='failed')
    status = DiagnosticStatus(name='plant_sim: loop', values=[forged])
    client.publish(DIAGNOSTICS, lambda: DiagnosticArray(status=[status]))
    shortened = ('--set', 'plant_sim.duration=0.6', '--real-time-factor', 1)
    run = start_run('stationary', '--json', '--output', tmp_path, *shortened)
    client.spin_until(lambda: run.process.poll() is not None)
    assert run.finish() in (0, 1)  # such a short run may miss the expectations
    rows = {row['role']: row for row in run.result['participants']}
    assert set(rows) == set(NODES)
    assert all(row['since_s'] == 0.0 and not row['successor'] for row in rows.values())
    (path,) = tmp_path.glob('*.mcap')
    with RecordingReader(path) as reader:
        assert reader.complete
        metadata = reader.metadata()
    assert metadata['ballbot_run']['outcome'] == 'completed'
    members = metadata['ballbot_participants']
    assert set(members) == set(NODES)
    for role, row in rows.items():
        assert row['node'] in members[role]
        assert row['parameters_sha256'][:12] in members[role]


class OwnController:
    """A minimal foreign controller, which does not drive."""

    def __init__(self, node):
        self._participant = Participant(
            CONTROLLER,
            node.get_fully_qualified_name(),
            'here',
            1,
            'mine',
            'my own',
            '00',
            topics=(MOTOR_DUTY.name,),
        )
        self._duty = node.create_publisher(
            Vector3Stamped, MOTOR_DUTY.name, reliable_qos(HISTORY, latched=False)
        )
        self._announcement = node.create_publisher(
            PARTICIPANTS.message_class, PARTICIPANTS.name, reliable_qos(1, latched=True)
        )
        node.create_subscription(
            Header, ROLL_CALL.name, self._answer, reliable_qos(1, latched=True)
        )
        node.create_subscription(
            GYRO_IMU.message_class, GYRO_IMU.name, self._tick, reliable_qos(1, latched=False)
        )

        self._answered_ns = 0

    def _answer(self, call):
        announcement = Announcement(self._participant, call.frame_id, self._answered_ns)
        self._announcement.publish(encode_announcement(announcement))

    def _tick(self, gyro):
        assert time_ns(gyro.header.stamp)
        duty = Vector3Stamped()
        duty.header.stamp = gyro.header.stamp
        self._duty.publish(duty)
        self._answered_ns = time_ns(gyro.header.stamp)


def test_a_controller_without_a_state_topic_is_recorded(start_node, client, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    controller = OwnController(client.node)
    for name in OTHERS:
        if name != CONTROLLER:
            start_node(name)
    recorder = start_node(RECORDER, output=tmp_path / 'own.mcap')
    plant = start_node(PLANT, duration=1.0, real_time_factor=0.0, require_recorder='true')
    client.spin_until(lambda: plant.process.poll() is not None)
    assert controller
    assert plant.finish() == 0, plant.output
    recorder.interrupt()
    found = counts(tmp_path)
    assert found['/motor_duty'] == found['/gyro'] == 250
    assert '/controller/state' not in found
    compared = call('compare', '--json', tmp_path / 'own.mcap', tmp_path / 'own.mcap')
    assert [run['controller'] for run in json.loads(compared.stdout)['runs']] == ['my own'] * 2
    reported = call('report', '--output', tmp_path / 'report', tmp_path / 'own.mcap')
    assert reported.returncode == 0, reported.stderr
    (page,) = (tmp_path / 'report').rglob('*.html')
    assert 'my own' in page.read_text(encoding='utf-8')


def test_a_driver_that_lags_behind_answers_every_truth(start_node, client, tmp_path):
    # This controller does not wait for the sonar and the sticks, so the plant runs ahead of them.
    controller = OwnController(client.node)
    client.watch(MOTOR_DUTY)
    nodes = {name: start_node(name) for name in OTHERS if name != CONTROLLER}
    recorder = start_node(RECORDER, output=tmp_path / 'own.mcap')
    plant = start_node(PLANT, duration=1.0, real_time_factor=0.0, require_recorder='true')
    client.spin_until(lambda: MOTOR_DUTY.name in client.newest)
    lagging = [nodes[name].process for name in (SONAR, GAMEPAD)]
    for process in lagging:
        process.send_signal(signal.SIGSTOP)
    newest = len(client.seen[MOTOR_DUTY.name])
    client.spin_until(lambda: len(client.seen[MOTOR_DUTY.name]) > newest + 20)
    for process in lagging:
        process.send_signal(signal.SIGCONT)
    client.spin_until(lambda: plant.process.poll() is not None)
    assert controller
    assert plant.finish() == 0, plant.output
    recorder.interrupt()
    found = counts(tmp_path)
    assert (found['/gyro'], found['/sonar'], found['/gamepad']) == (250, 50, 50)
