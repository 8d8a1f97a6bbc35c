"""The PC's side of a brick: what it sends and when, and that nothing that arrives is lost."""

import contextlib
import random
import select
import signal
import socket
import subprocess
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import pytest
from generated import need
from graph import BALLBOT, LAST_RESORT_S, environment, wait_for

pytest.importorskip('rclpy')

from ballbot_ros.analysis.data_log import last_log
from ballbot_ros.controllers.codegen.application import write_application
from ballbot_ros.errors import RecordingError
from ballbot_ros.nodes import brick_link
from ballbot_ros.nodes.brick_link import BrickLink
from ballbot_ros.nodes.teleop.sticks import KEYBOARD
from ballbot_ros.nodes.transports.whole_packets import WholePackets
from ballbot_ros.parameters import BrickLinkParameters, ControllerParameters
from ballbot_ros.recording.messages.conversions import decode_sticks
from ballbot_ros.recording.messages.topics import BLUETOOTH_TX, CONTROLLER_STATE, GAMEPAD_JOY, RUN
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.robot.brick.bluetooth import FRAME_SIZE, LENGTH, LogPacket, stick_frame, sticks_in
from ballbot_ros.run.one_process import NodeThread, ros

FORWARD = (-100, 0)


def packet(time_ms):
    return LogPacket(time_ms, 0, 0, 8000, 0, 0, 0, 0, 0, 0, 0, 255)


class Brick:
    """A brick that listens on a socket, and keeps the bytes that it gets."""

    def __init__(self, path):
        self.path = str(path)
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(self.path)
        self._listener.listen()
        self.link, self.data = None, b''

    def accept(self):
        self._listener.settimeout(LAST_RESORT_S)
        self.link, _ = self._listener.accept()
        self.link.setblocking(False)

    def send(self, *times_ms):
        self.link.sendall(b''.join(LENGTH + packet(time_ms).encode() for time_ms in times_ms))

    def frames(self):
        """Return the sticks that have arrived so far, in whole packets."""
        with contextlib.suppress(BlockingIOError):
            while part := self.link.recv(2**16):
                self.data += part
        parts = [self.data[at : at + FRAME_SIZE] for at in range(0, len(self.data), FRAME_SIZE)]
        whole = [each for each in parts if len(each) == FRAME_SIZE]
        assert all(each == stick_frame(sticks_in(each[len(LENGTH) :])) for each in whole)
        return [sticks_in(each[len(LENGTH) :]) for each in whole]

    def close(self):
        if self.link:
            self.link.close()
        self._listener.close()


@pytest.fixture
def brick(tmp_path):
    brick = Brick(tmp_path / 'brick')
    yield brick
    brick.close()


@pytest.fixture
def start(domain, tmp_path, monkeypatch):
    """Start a link in this process; it is ended after the test, or by `close`."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    with contextlib.ExitStack() as stack:
        stack.enter_context(ros('FATAL'))

        def begin(path, **values):
            given = {'device': '', 'output': str(tmp_path / 'brick.mcap'), **values}
            node = BrickLink(BrickLinkParameters(serial_port=str(path), **given))
            thread = NodeThread(node)
            closing = contextlib.ExitStack()
            closing.callback(thread.close)
            node.end = closing.close
            stack.callback(closing.close)
            return node

        yield begin


def recorded(path):
    """Return the messages of a recording by topic, each as log time and bytes."""
    found = {}
    with RecordingReader(path) as reader:
        for raw in reader.raw_messages():
            found.setdefault(raw.topic.removeprefix('/'), []).append(raw)
    return found


def test_sticks_go_only_to_a_program_that_balances_and_neutral_ones_are_the_last(
    brick, start, tmp_path
):
    node = start(brick.path)
    brick.accept()
    node._sources.report(KEYBOARD, FORWARD, time.monotonic() + LAST_RESORT_S)  # held
    time.sleep(0.1)
    assert brick.frames() == []  # no packet: the program reads none
    brick.send(2004)
    wait_for(lambda: FORWARD in brick.frames(), what='sticks')
    brick.send(2104)
    wait_for(lambda: node._stream.packets == 2, what='the second packet')
    wait_for(lambda: not node._is_heard(time.monotonic()), what='the silence of the brick')
    count = len(brick.frames())
    time.sleep(0.1)
    assert len(brick.frames()) <= count + 1
    brick.send(2204)
    wait_for(lambda: len(brick.frames()) > count + 1, what='sticks again')
    node.end()
    assert brick.frames()[-1] == (0, 0)
    sticks = recorded(tmp_path / 'brick.mcap')[GAMEPAD_JOY.name]
    assert [decode_sticks(raw.data) for raw in sticks] == brick.frames()


def test_silence_of_the_user_means_neutral_sticks(brick, start):
    """A brick keeps the last packet for ever."""
    node = start(brick.path)
    brick.accept()
    brick.send(2004)
    wait_for(lambda: (0, 0) in brick.frames(), what='neutral sticks')
    node._sources.report(KEYBOARD, FORWARD, time.monotonic())
    wait_for(lambda: FORWARD in brick.frames(), what='sticks')
    time_ms = 2004

    def is_neutral():
        nonlocal time_ms
        time_ms += 100
        brick.send(time_ms)
        return brick.frames()[-1] == (0, 0)

    wait_for(is_neutral, what='neutral sticks after the silence')
    assert brick.frames().count(FORWARD) > 2


def test_a_brick_that_reads_nothing_gets_whole_packets_only():
    pc, brick = socket.socketpair()
    pc.setblocking(False)
    brick.setblocking(False)
    sender, data, sent = WholePackets(pc.fileno()), b'', []
    for number in range(5000):
        sticks = number % 100, -(number % 7)
        if sender.send(stick_frame(sticks)):
            sent.append(sticks)
        elif number % 3 == 0:
            data += brick.recv(1000)  # a bit of room again
    sender.finish(stick_frame((0, 0)), 0.0)
    with contextlib.suppress(BlockingIOError):
        while part := brick.recv(2**16):
            data += part
    expected = b''.join(map(stick_frame, sent))
    assert 1000 < len(sent) < 5000
    assert data[: len(expected)] == expected
    assert stick_frame((0, 0)).startswith(data[len(expected) :])
    pc.close()
    brick.close()


def hold(node, brick, sticks=FORWARD):
    """Let the user hold sticks until the brick has them."""
    node._sources.report(KEYBOARD, sticks, time.monotonic() + LAST_RESORT_S)
    time_ms = 2004

    def has_them():
        nonlocal time_ms
        time_ms += 100
        brick.send(time_ms)
        return sticks in brick.frames()

    wait_for(has_them, what='sticks')
    return time_ms


@pytest.mark.parametrize('words', ['nothing', 'wild values'])
def test_a_brick_that_falls_silent_gets_neutral_sticks_once(brick, start, words):
    """It keeps the last ones for ever, and its packets may be all that is lost."""
    node = start(brick.path, output='')
    brick.accept()
    hold(node, brick)
    if words == 'wild values':
        wild = LENGTH + replace(packet(2004), sonar_cm=10**9).encode()
        brick.link.sendall(5 * wild)
    wait_for(lambda: brick.frames()[-1] == (0, 0), what='neutral sticks')
    wait_for(lambda: not node._is_heard(time.monotonic()), what='the silence')
    count = len(brick.frames())
    time.sleep(0.1)
    assert len(brick.frames()) == count


@pytest.mark.parametrize('error', [RecordingError('disk full'), ZeroDivisionError('a mistake')])
def test_whatever_ends_the_link_ends_the_node_with_neutral_sticks(brick, start, monkeypatch, error):
    node = start(brick.path)
    brick.accept()
    time_ms = hold(node, brick)

    def fail(*_):
        raise error

    monkeypatch.setattr(node._messages, 'packet', fail)
    brick.send(time_ms + 100)
    wait_for(lambda: node.finished, what='the end')
    assert brick.frames()[-1] == (0, 0)
    assert node.exit_status == 1
    assert str(error) in node.failure


def test_a_link_that_carries_nothing_is_not_told_again_and_again(brick, start, monkeypatch):
    monkeypatch.setattr(brick_link, '_RETRY_S', 0.01)
    node, told = start(brick.path), []
    monkeypatch.setattr(
        node, 'get_logger', lambda: SimpleNamespace(info=told.append, warning=told.append)
    )
    for _ in range(20):
        brick.accept()
        brick.link.close()
    wait_for(lambda: node.connections >= 20, what='twenty connections')
    assert len(told) <= 3


def test_a_late_brick_is_found_and_a_restarted_one_begins_a_run(start, tmp_path):
    node = start(tmp_path / 'brick')
    wait_for(lambda: 'No such file' in node._link_problem, what='the warning')
    brick = Brick(tmp_path / 'brick')
    brick.accept()
    brick.send(61_004, 61_104)
    wait_for(lambda: node._stream.packets == 2, what='packets')
    brick.link.close()
    brick.accept()
    brick.send(2004, 2104, 2204)
    wait_for(lambda: node._stream.packets == 5, what='packets of the second run')
    node.end()
    brick.close()
    found = recorded(tmp_path / 'brick.mcap')
    assert len(found[RUN.name]) == 2
    assert len(found[BLUETOOTH_TX.name]) == len(found[CONTROLLER_STATE.name]) == 5
    assert node.connections == 2
    assert node.losses == ''


def test_what_is_missing_is_told_and_marked_in_the_recording(brick, start, tmp_path):
    node = start(brick.path)
    brick.accept()
    brick.send(2004, 2104)
    brick.link.sendall((LENGTH + packet(2204).encode())[1:])
    brick.send(2304, 2404)
    wait_for(lambda: node._stream.packets == 4, what='packets')
    node.end()
    told = '1 packets of the brick are missing, and 33 bytes belonged to none'
    assert node.losses == told
    with RecordingReader(tmp_path / 'brick.mcap') as reader:
        assert told in reader.damage
        assert [each.time_ms for each in last_log(reader)] == [2004, 2104, 2304, 2404]


def test_a_link_that_leads_nowhere_is_one_line(run_node):
    node = run_node('brick_link')
    assert node.finish() == 2
    assert node.output.splitlines()[-1].endswith('give either a Bluetooth address or a serial port')


class Relay(threading.Thread):
    """Stands between brick and PC, and cuts the connection to the PC again and again.

    `intact` are the packets of which all bytes went through one connection.
    """

    def __init__(self, brick, path, cuts, seed):
        super().__init__(daemon=True)
        self._brick, self._draw, self._cuts = brick, random.Random(seed), cuts
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(str(path))
        self._listener.listen()
        self.intact, self.is_done = [], False
        self._data, self._at = b'', 0

    def run(self):
        while not self.is_done:
            pc, _ = self._listener.accept()
            with pc:
                self._forward(pc, self._draw.randrange(20, 600) if self._cuts else None)
            self._cuts -= 1

    def _forward(self, pc, size):
        """Forward so many bytes of the brick, and all of the PC."""
        begin = self._at
        while size is None or self._at < begin + size:
            readable, _, _ = select.select([self._brick, pc], [], [], 0.1)
            if self.is_done:
                break
            if pc in readable:
                data = pc.recv(999)
                if not data:
                    break
                self._brick.sendall(data)
            if self._brick in readable:
                part = self._brick.recv(begin + size - self._at if size else 999)
                self._data += part
                self._at += len(part)
                pc.sendall(part)
        first = -(-begin // FRAME_SIZE)
        for number in range(first, self._at // FRAME_SIZE):
            data = self._data[number * FRAME_SIZE :][:FRAME_SIZE]
            self.intact.append(LogPacket.decode(data[len(LENGTH) :]))

    @property
    def cuts_left(self):
        return self._cuts


def test_fifty_disconnections_lose_nothing_that_arrived_intact(tmp_path, domain):
    """The generated C with a simulated robot sends a packet every 4 ms."""
    need('c')
    program = tmp_path / 'program'
    write_application(program, ControllerParameters(log_count=1))
    with contextlib.ExitStack() as stack:
        start_process(stack, domain, 'brick', 'emulate', program, '--socket', tmp_path / 'brick')
        brick = socket.socket(socket.AF_UNIX)
        wait_for(lambda: can_connect(brick, tmp_path / 'brick'), 'the emulator')
        relay = Relay(brick, tmp_path / 'relay', cuts=50, seed=1)
        relay.start()
        drive = start_process(
            stack, domain, 'brick', 'drive', '--port', tmp_path / 'relay', '--no-keyboard',
            '--device', '', '--program', program, '--output', tmp_path / 'run',
        )  # fmt: skip
        wait_for(lambda: relay.cuts_left <= 0 or drive.poll() is not None, 'fifty cuts')
        relay.is_done = True
        relay.join(LAST_RESORT_S)
        drive.send_signal(signal.SIGTERM)
        output, _ = drive.communicate(timeout=LAST_RESORT_S)
        assert drive.returncode == 0, output
    found = [LogPacket.decode(raw.data[-32:]) for raw in
             recorded(tmp_path / 'run/brick.mcap')[BLUETOOTH_TX.name]]  # fmt: skip
    assert found == relay.intact
    assert len(found) > 200


def start_process(stack, domain, *words):
    process = subprocess.Popen(
        [*BALLBOT, *map(str, words)], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, text=True, env=environment(domain),
    )  # fmt: skip
    stack.callback(process.wait, LAST_RESORT_S)
    stack.callback(process.terminate)
    return process


def can_connect(link, path):
    with contextlib.suppress(OSError):
        link.connect(str(path))
        return True
    return False
