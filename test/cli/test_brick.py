"""`ballbot brick`: a maker's way from the generated folder to a recording, on an emulated brick."""

import os
import re
import signal
import subprocess
import time

import pytest
from generated import SHORT, commissioning, need
from graph import BALLBOT, LAST_RESORT_S, environment, wait_for
from terminal import REPEAT_S, Terminal

from ballbot_ros.analysis.data_log import last_log
from ballbot_ros.controllers.codegen.application import write_application
from ballbot_ros.controllers.commissioning import END
from ballbot_ros.nodes.transports import serial_port
from ballbot_ros.recording.messages.conversions import decode_sticks
from ballbot_ros.recording.messages.topics import (
    BATTERY_STATE,
    BLUETOOTH_TX,
    CONTROLLER_STATE,
    GAMEPAD_JOY,
    GYRO_IMU,
    JOINT_STATES,
    MOTOR_DUTY,
    RUN,
)
from ballbot_ros.recording.reader import RecordingReader

LEFT = b'\x1b[D'


@pytest.mark.parametrize(
    ('words', 'told'),
    [
        (['drive'], 'give either --address or --port'),
        (['drive', '--address', '00:16:53:01:02:03', '--port', 'x'], 'give either --address or'),
        (['drive', '--port', 'x', '--program', 'nothing'], 'nothing: No such file or directory'),
        (
            ['drive', '--port', 'x', '--set', 'brick_link.lsb=0'],
            'brick_link.lsb: 0 is not within',
        ),
        (['drive', '--port', 'x', '--set', 'brick_link.x=1'], "brick_link has no parameter 'x'"),
        (['drive', '--port', 'x', '--set', 'plant_sim.map=track'], 'only brick_link runs here'),
        (['drive', '--port', 'x', '--set', 'brick_link.output=x'], 'use the options of the'),
        (['emulate', '--socket', 120 * 'x'], 'AF_UNIX path too long'),
        (['emulate', 'nothing'], 'nothing/parameters.yaml: not found; the folder was not written'),
        (['emulate', '--target', 'x'], "'x' is not one of 'c', 'arm'"),
        (['emulate', '--profile', 'x'], "unknown profile 'x'"),
        (['emulate', '--set', 'controller.k_i=0'], 'has its own values'),
        (['emulate', '--set', 'plant_sim.map=nothing.png'], 'nothing.png'),
        (['emulate', '--socket', 'no/folder/x'], 'no/folder/x: No such file or directory'),
    ],
)
def test_a_mistake_is_one_line(command, tmp_path, monkeypatch, words, told):
    need('c')
    monkeypatch.chdir(tmp_path)
    pytest.importorskip('rclpy')
    status, _, error = command('brick', *words)
    assert status == 2
    assert told in ' '.join(error.split())
    assert 'Traceback' not in error
    assert list(tmp_path.iterdir()) == []


def test_an_emulator_ends_with_its_signal_and_removes_its_socket(tmp_path, domain):
    need('c')
    path = tmp_path / 'brick'
    process = subprocess.Popen(
        [*BALLBOT, 'brick', 'emulate', '--socket', str(path)], stdout=subprocess.PIPE,
        env=environment(domain), text=True,
    )  # fmt: skip
    lines = [process.stdout.readline() for _ in range(3)]
    assert lines == [
        f'the brick is at {path}\n',
        f'drive it  ballbot brick drive --port {path}\n',
        'waiting for a connection\n',
    ]
    assert path.is_socket()
    process.send_signal(signal.SIGINT)
    assert process.wait(LAST_RESORT_S) == 0
    assert not path.exists()
    process.stdout.close()


def shown(terminal):
    return '\n'.join(terminal.shown())


def test_a_maker_generates_drives_and_records(command, tmp_path, domain, monkeypatch):
    """With keys, on a pseudo terminal; the robot obeys, and the log says so."""
    need('c')
    pytest.importorskip('rclpy')
    pytest.importorskip('prompt_toolkit')
    monkeypatch.chdir(tmp_path)
    assert command('codegen', '--output', 'mine')[0] == 0
    emulator = subprocess.Popen(
        [*BALLBOT, 'brick', 'emulate', 'mine', '--profile', 'ideal'], stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, env=environment(domain), text=True,
    )  # fmt: skip
    port = re.search('/dev/pts/[0-9]+', emulator.stdout.readline()).group()
    terminal = Terminal()
    drive = terminal.start(
        [*BALLBOT, 'brick', 'drive', '--port', port, '--program', 'mine', '--device', '',
         '--output', 'run'], **environment(domain),
    )  # fmt: skip
    terminal.wait_for_text(rb'nobody')
    wait_for(lambda: re.search('[1-9][0-9]* packets', shown(terminal)), what='packets')

    def has_turned():
        terminal.press(LEFT)
        time.sleep(REPEAT_S)
        found = re.search('motors.*rightward ([-+0-9]+)', shown(terminal))
        return found and int(found.group(1)) < -30

    wait_for(has_turned, what='a drive to the left')
    terminal.press(b'q')
    assert drive.wait(LAST_RESORT_S) == 0
    emulator.send_signal(signal.SIGTERM)
    emulator.communicate(timeout=LAST_RESORT_S)
    with RecordingReader('run/brick.mcap') as reader:
        counts = {name: each.message_count for name, each in reader.topics().items()}
        sticks = [decode_sticks(raw.data) for raw in reader.raw_messages([f'/{GAMEPAD_JOY.name}'])]
        attached = {*reader.attachments()}
        assert reader.damage is None
        packets = last_log(reader)
    assert counts[f'/{RUN.name}'] == 1
    for topic in (BLUETOOTH_TX, BATTERY_STATE, JOINT_STATES, CONTROLLER_STATE):
        assert counts[f'/{topic.name}'] == len(packets)
    assert (0, -50) in sticks
    assert sticks[-1] == (0, 0)
    assert packets[-1].rev_c < -30
    assert attached == {'parameters.yaml', 'versions.yaml'}


def test_a_maker_commissions_a_robot_on_a_stand(command, tmp_path, domain, monkeypatch):
    """Without a key, until the program has ended; the log has all of its phases."""
    need('c')
    pytest.importorskip('rclpy')
    monkeypatch.chdir(tmp_path)
    write_application(tmp_path / 'mine', commissioning(**SHORT))
    emulator = subprocess.Popen(
        [*BALLBOT, 'brick', 'emulate', 'mine', '--profile', 'stand'], stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, env=environment(domain), text=True,
    )  # fmt: skip
    port = re.search('/dev/pts/[0-9]+', emulator.stdout.readline()).group()
    drive = subprocess.Popen(
        [*BALLBOT, 'brick', 'drive', '--port', port, '--program', 'mine', '--device', '',
         '--no-keyboard', '--output', 'run'], env=environment(domain),
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    for _ in range(END + 2):
        wait_for_line(emulator.stdout, 'beep')
    time.sleep(REPEAT_S)
    drive.send_signal(signal.SIGINT)
    assert drive.wait(LAST_RESORT_S) == 0
    emulator.send_signal(signal.SIGTERM)
    emulator.communicate(timeout=LAST_RESORT_S)
    with RecordingReader('run/brick.mcap') as reader:
        counts = {name: each.message_count for name, each in reader.topics().items()}
        packets = last_log(reader)
    assert counts[f'/{MOTOR_DUTY.name}'] == counts[f'/{GYRO_IMU.name}'] == len(packets)
    assert {packet.adc1 for packet in packets} == {*range(END + 1)}
    assert 590 < packets[5].adc3 < 620


def wait_for_line(stream, text):
    while text not in (line := stream.readline()):
        assert line, f'ended before {text!r}'


def test_a_second_program_at_the_same_device_waits_for_it(tmp_path, domain):
    """Two readers would each get a part of the bytes."""
    need('c')
    emulator = subprocess.Popen(
        [*BALLBOT, 'brick', 'emulate'], stdout=subprocess.PIPE, env=environment(domain), text=True
    )
    port = re.search('/dev/pts/[0-9]+', emulator.stdout.readline()).group()
    held = serial_port.connect(port)
    drive = subprocess.Popen(
        [*BALLBOT, 'brick', 'drive', '--port', port, '--no-keyboard', '--device', '',
         '--no-record'], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        env=environment(domain), cwd=tmp_path, text=True,
    )  # fmt: skip
    lines = [drive.stdout.readline()]
    while 'not connected: Resource temporarily unavailable' not in lines[-1]:
        lines.append(drive.stdout.readline())
        assert lines[-1], lines
    os.close(held)
    while 'connected' not in lines[-1] or 'not connected' in lines[-1]:
        lines.append(drive.stdout.readline())
        assert lines[-1], lines
    for process in (drive, emulator):
        process.terminate()
        process.communicate(timeout=LAST_RESORT_S)
