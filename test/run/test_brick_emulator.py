"""The emulated brick: the limits of its radio, and the program that it runs."""

import contextlib
import os
import socket

import pytest
from generated import SHORT, commissioning, need

from ballbot_ros.controllers.codegen.application import write_application
from ballbot_ros.controllers.document.program import ControlMode
from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.scenario.reader import load_profile
from ballbot_ros.errors import BallbotError
from ballbot_ros.nodes.transports import local_socket, pseudo_terminal, serial_port
from ballbot_ros.parameters import ControllerParameters, GyroParameters
from ballbot_ros.robot.brick.bluetooth import (
    FRAME_SIZE,
    LENGTH,
    NEUTRAL,
    LogPacket,
    LogStream,
    stick_frame,
)
from ballbot_ros.run.brick_emulator import (
    RECEIVE_BUFFER,
    EmulatedRobot,
    Radio,
    compiled_program,
    emulator_parameters,
)

PACKET = LogPacket(2000, 0, 0, 8000, 0, 0, 0, 0, 0, 0, 0, 255)


class Wire:
    """A listener that connects one end of a pair of sockets; `pc` is the other end."""

    def __init__(self):
        self.path = 'wire'
        self.connect()

    def connect(self):
        brick, self.pc = socket.socketpair()
        brick.setblocking(False)
        self._waiting = brick.detach()

    def accept(self):
        link, self._waiting = self._waiting, None
        return link

    def hang_up(self, link):
        os.close(link)

    def close(self):
        self.pc.close()


@pytest.fixture
def wire():
    return Wire()


@pytest.fixture
def radio(wire):
    radio = Radio(wire)
    radio.poll()
    yield radio
    radio.close()
    wire.close()


def test_a_call_takes_one_packet_and_seven_wait(wire, radio):
    """More remain with the sender: the buffer has 256 bytes (facts, section 10)."""
    for number in range(10):
        wire.pc.sendall(stick_frame((number, -number)))
    radio.poll()
    assert RECEIVE_BUFFER // FRAME_SIZE == 7
    assert [radio.packet() for _ in range(8)] == [*((n, -n) for n in range(7)), None]
    radio.poll()
    assert [radio.packet() for _ in range(4)] == [(7, -7), (8, -8), (9, -9), None]


def test_a_packet_in_parts_counts_once_it_is_whole(wire, radio):
    data = stick_frame((5, 6))
    for size in (1, 20, 12):
        part, data = data[:size], data[size:]
        wire.pc.sendall(part)
        radio.poll()
        assert radio.packet() is None
    wire.pc.sendall(data)
    radio.poll()
    assert radio.packet() == (5, 6)


def test_after_a_lost_byte_all_is_wrong(wire, radio):
    """The length alone says where a packet ends, and nobody looks at its content."""
    wire.pc.sendall(stick_frame((5, 6))[1:] + stick_frame((5, 6)))
    radio.poll()
    assert radio.packet() is None  # a length of 0x0500


def test_a_packet_is_dropped_while_another_is_being_sent(wire, radio):
    while not radio.dropped:
        radio.send(PACKET)
    radio.send(PACKET)
    assert radio.dropped == 2
    wire.pc.setblocking(False)
    data = b''
    with contextlib.suppress(BlockingIOError):
        while part := wire.pc.recv(4096):
            data += part
    radio.send(PACKET)  # the rest of the one under way, and another
    data += wire.pc.recv(4096)
    assert data == len(data) // FRAME_SIZE * (LENGTH + PACKET.encode())
    assert radio.dropped == 2


def test_a_lost_link_is_not_noticed_by_the_program_and_can_return(wire, radio):
    wire.pc.sendall(stick_frame((5, 6)))
    wire.pc.close()
    radio.poll()
    radio.poll()
    assert not radio.is_connected
    radio.send(PACKET)  # as on a brick, into the void
    wire.connect()
    radio.poll()
    assert radio.is_connected
    assert radio.packet() is None  # what had come before is gone
    radio.send(PACKET)
    assert wire.pc.recv(99) == LENGTH + PACKET.encode()


def test_a_pseudo_terminal_is_a_serial_device_with_raw_bytes():
    listener = pseudo_terminal.Listener()
    assert listener.accept() is None
    link = serial_port.connect(listener.path)
    with pytest.raises(OSError, match='Resource temporarily unavailable'):
        serial_port.connect(listener.path)
    brick = listener.accept()
    every_byte = bytes(range(256))
    for one, other in ((brick, link), (link, brick)):
        os.write(one, every_byte)
        assert os.read(other, 999) == every_byte
    os.close(link)
    assert listener.accept() is None
    os.close(serial_port.connect(listener.path))
    listener.close()


def test_a_local_socket_takes_one_connection_after_the_other(tmp_path):
    listener = local_socket.Listener(str(tmp_path / 'brick'))
    assert listener.accept() is None
    for _ in range(2):
        link = local_socket.connect(listener.path)
        brick = listener.accept()
        os.write(brick, b'hello')
        assert os.read(link, 9) == b'hello'
        listener.hang_up(brick)
        assert os.read(link, 9) == b''
        os.close(link)
    with pytest.raises(OSError, match='Address already in use'):
        local_socket.Listener(listener.path)
    listener.close()
    assert list(tmp_path.iterdir()) == []
    with socket.socket(socket.AF_UNIX) as killed:  # its file remains
        killed.bind(listener.path)
    local_socket.Listener(listener.path).close()


@pytest.fixture
def folder(tmp_path):
    need('c')
    write_application(tmp_path / 'program', load_profile('hardware').of(ControllerParameters))
    return tmp_path / 'program'


def test_the_program_drives_the_robot_as_the_python_program_does(folder, wire):
    """Bit for bit, with the packets of a PC that sends one every 20 ms."""
    parameters = emulator_parameters(folder, 'hardware')
    sticks = {2.5: (-100, 0), 4.0: NEUTRAL}

    class Scripted:
        """The same sticks for the ordinary loop."""

        def sticks_at(self, time):
            return max(
                ((at, each) for at, each in sticks.items() if at <= time), default=(0, NEUTRAL)
            )[1]

        def pushes_from(self, start_ns):
            return []

    ordinary, radio = ClosedLoop(parameters, Scripted()), Radio(wire)
    radio.poll()
    stream, found, expected = LogStream(), [], []
    with compiled_program(folder, 'c') as start:
        robot = EmulatedRobot(parameters, start(), radio)
        for number in range(1500):
            if number % 5 == 0 and robot.program.control_mode == ControlMode.CONTROL:
                wire.pc.sendall(stick_frame(Scripted().sticks_at(number * 0.004)))
            radio.poll()
            tick, other = robot.tick(), ordinary.tick()
            assert tick.outputs.duty == other.outputs.duty
            expected += other.outputs.log
            if tick.outputs.log:
                found += stream.feed(wire.pc.recv(999))
    assert found == expected
    assert max(packet.rev_b for packet in found) > 200
    radio.close()


def test_the_folder_decides_about_the_program_and_the_profile_about_the_robot(folder):
    write_application(folder, ControllerParameters(k_i=-0.009, time_start=800))
    parameters = emulator_parameters(folder, 'hardware', ['gyro_driver.noise=0.25'])
    program = parameters.of(ControllerParameters)
    assert (program.k_i, program.time_start, program.kernel) == (-0.009, 800, True)
    assert parameters.of(GyroParameters).noise == 0.25
    with pytest.raises(
        BallbotError, match=r'--set controller\.k_i=0: the program of .* own values'
    ):
        emulator_parameters(folder, 'ideal', ['controller.k_i=0'])
    with pytest.raises(BallbotError, match='not found; the folder was not written by'):
        emulator_parameters(folder / 'x', 'ideal')
    with pytest.raises(BallbotError, match="unknown profile 'x'"):
        emulator_parameters(folder, 'x')


def test_the_commissioning_program_takes_the_sticks_and_logs_as_in_python(tmp_path, wire):
    """Nobody drives, but a PC sends its neutral sticks while packets arrive."""
    need('c')
    write_application(tmp_path / 'program', commissioning(**SHORT))
    parameters = emulator_parameters(tmp_path / 'program', 'stand')
    ordinary, radio = ClosedLoop(parameters), Radio(wire)
    radio.poll()
    stream, found, expected = LogStream(), [], []
    with compiled_program(tmp_path / 'program', 'c') as start:
        robot = EmulatedRobot(parameters, start(), radio)
        for number in range(600):
            if number % 5 == 0:
                wire.pc.sendall(stick_frame(NEUTRAL))
            radio.poll()
            tick, other = robot.tick(), ordinary.tick()
            assert tick.outputs.duty == other.outputs.duty
            assert tick.outputs.tones == other.outputs.tones
            assert radio.packet() is None
            expected += other.outputs.log
            if tick.outputs.log:
                found += stream.feed(wire.pc.recv(999))
    assert found == expected
    assert len(found) == 120
    assert {packet.adc1 for packet in found} == {*range(7)}
    assert max(packet.data1 for packet in found) > 90
    radio.close()
