"""A brick for trying the PC's side: the generated C with a simulated robot, in real time."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from ballbot_ros.controllers.codegen.application import read_tasks
from ballbot_ros.controllers.codegen.compiled_program import CompiledProgram
from ballbot_ros.controllers.codegen.folder_check import read_folder_parameters
from ballbot_ros.controllers.codegen.programs import program_of
from ballbot_ros.controllers.codegen.toolchain import TARGETS, build
from ballbot_ros.controllers.interface import OperatingState
from ballbot_ros.engine.closed_loop import ClosedLoop, Tick
from ballbot_ros.engine.pacer import Pacer
from ballbot_ros.engine.scenario.reader import load_profile
from ballbot_ros.errors import TeleopError
from ballbot_ros.files import temporary_folder
from ballbot_ros.nodes.transports import local_socket, pseudo_terminal
from ballbot_ros.nodes.transports.whole_packets import WholePackets
from ballbot_ros.parameters import ControllerParameters, ParameterSet, PlantParameters
from ballbot_ros.parameters.files import assign
from ballbot_ros.process import StopRequest
from ballbot_ros.robot.brick.bluetooth import LENGTH, PACKET_SIZE, LogPacket, Sticks, sticks_in
from ballbot_ros.robot.brick.brick import DeviceInputs

RECEIVE_BUFFER = 256
"""Two buffers of 128 bytes: seven packets."""

_IDLE_S = 0.02


Listener = local_socket.Listener | pseudo_terminal.Listener
"""Where a PC connects to the brick."""


class Radio:
    """The brick's Bluetooth with its limits (nxtOSEK).

    A packet is dropped while the one before is still being sent. Received bytes wait in a buffer;
    the program takes one packet a call, whose length, not its content, says where it ends: after a
    lost byte, all that follows is wrong. The program does not notice that the link is lost.
    `dropped` counts the packets that could not be sent.
    """

    def __init__(self, listener: Listener) -> None:
        self._listener = listener
        self._link: int | None = None
        self._received = bytearray()
        self.dropped = 0

    @property
    def is_connected(self) -> bool:
        """Whether a PC is connected."""
        return self._link is not None

    def poll(self) -> None:
        """Take a new connection, and as many bytes as the buffer has room for."""
        if self._link is None:
            self._link = self._listener.accept()
            self._received.clear()
            if self._link is not None:
                self._sender = WholePackets(self._link)
        room = RECEIVE_BUFFER - len(self._received)
        if self._link is None or not room:
            return
        try:
            data = os.read(self._link, room)
        except BlockingIOError:
            return
        except OSError:
            data = b''
        self._received += data
        if not data:
            self._lose()

    def _lose(self) -> None:
        assert self._link is not None
        self._listener.hang_up(self._link)
        self._link = None

    def packet(self) -> Sticks | None:
        """Return the sticks of the oldest packet; None if there is no whole one."""
        if len(self._received) < len(LENGTH):
            return None
        size = len(LENGTH) + int.from_bytes(self._received[: len(LENGTH)], 'little')
        if len(self._received) < size:
            return None
        data = bytes(self._received[len(LENGTH) : size]).ljust(PACKET_SIZE, b'\0')
        del self._received[:size]
        return sticks_in(data)

    def send(self, packet: LogPacket) -> None:
        """Send a packet, unless the one before is still on its way."""
        if self._link is not None and not self._sender.send(LENGTH + packet.encode()):
            self.dropped += 1

    def close(self) -> None:
        """End the connection."""
        if self._link is not None:
            self._lose()


class EmulatedRobot(ClosedLoop):
    """A simulated robot whose program gets its sticks by radio."""

    def __init__(self, parameters: ParameterSet, program: CompiledProgram, radio: Radio) -> None:
        super().__init__(parameters, program=program)
        self._compiled, self._radio = program, radio

    def sample(self) -> DeviceInputs:
        """Return the samples of the devices, and a packet if the program will read one."""
        is_reading = self._compiled.reads_packets
        return super().sample()._replace(sticks=self._radio.packet() if is_reading else None)

    def tick(self) -> Tick:
        """Run one tick, and send its packets."""
        tick = super().tick()
        for packet in tick.outputs.log:
            self._radio.send(packet)
        return tick


def emulator_parameters(
    folder: Path, profile: str, assignments: Sequence[str] = ()
) -> ParameterSet:
    """Return the parameters of the robot and of the program in a folder.

    It raises BallbotError if the folder or a value can't be used.
    """
    parameters = load_profile(profile)
    parameters.update(read_folder_parameters(folder))
    for assignment in assignments:
        if assignment.startswith('controller.'):
            raise TeleopError(f'--set {assignment}: the program of {folder} has its own values')
        assign(parameters, assignment)
    ClosedLoop(parameters)  # refuses what does not fit together
    return parameters


@contextmanager
def compiled_program(folder: Path, implementation: str) -> Iterator[Callable[[], CompiledProgram]]:
    """Build the program in a folder for a target; yield what starts it.

    It raises CodegenError if a tool is missing, or it does not build.
    """
    parameters = read_folder_parameters(folder).of(ControllerParameters)
    with temporary_folder() as scratch:
        command = build(folder, TARGETS[implementation], Path(scratch))
        tasks = read_tasks(folder)
        yield lambda: program_of(parameters).start(command, tasks, parameters)


def emulate(
    parameters: ParameterSet,
    start: Callable[[], CompiledProgram],
    listener: Listener,
    tell: Callable[[str], None],
) -> None:
    """Run a brick until a signal, at the pace of the parameter `real_time_factor`.

    The program starts once a PC is connected, as on a brick, which connects only before. If it has
    given up when the next PC connects, robot and program start anew. `tell` receives what happens,
    line by line.
    """
    radio, pacer = Radio(listener), Pacer()
    pace = parameters.of(PlantParameters).real_time_factor
    robot: EmulatedRobot | None = None
    shown = ''
    try:
        with StopRequest() as stop:
            tell('waiting for a connection')
            while not stop.signal:
                was_connected = radio.is_connected
                radio.poll()
                if radio.is_connected != was_connected:
                    tell('connected' if radio.is_connected else 'connection lost')
                    has_given_up = robot and shown == OperatingState.OUT_OF_CONTROL
                    if radio.is_connected and (robot is None or has_given_up):
                        robot, shown = EmulatedRobot(parameters, start(), radio), ''
                        pacer.restart()
                if robot is None:
                    time.sleep(_IDLE_S)
                    continue
                time.sleep(pacer.delay_s(pace, time.monotonic()))
                pacer.on_tick(pace, time.monotonic())
                tick = robot.tick()
                if (state := robot.program.operating_state.value) != shown:
                    shown = state
                    tell(f'{tick.truth.stamp_ns * 1e-9:.1f} s  {state}')
                if tick.outputs.tones:
                    tell('beep')
    finally:
        radio.close()
