"""The PC's side of a real brick: sends it the sticks, publishes and records its data log."""

from __future__ import annotations

import errno
import math
import os
import select
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING

from ballbot_ros.errors import BallbotError, TeleopError, one_line
from ballbot_ros.nodes.base import BallbotNode
from ballbot_ros.nodes.gamepad_teleop import TeleopInputs
from ballbot_ros.nodes.middleware import DomainLock
from ballbot_ros.nodes.processes import join_thread
from ballbot_ros.nodes.teleop.gamepad import InputErrors
from ballbot_ros.nodes.teleop.sticks import Arbiter, Command
from ballbot_ros.nodes.transports import local_socket, rfcomm, serial_port
from ballbot_ros.nodes.transports.whole_packets import WholePackets
from ballbot_ros.parameters import BrickLinkParameters, LogFormat
from ballbot_ros.parameters.timing import MILLISECOND_NS, SLOW_PERIOD_NS, TICK_NS
from ballbot_ros.recording.brick_clock import BrickClock
from ballbot_ros.recording.messages.brick_messages import BrickMessages
from ballbot_ros.recording.messages.run_messages import Send
from ballbot_ros.recording.messages.topics import SCENARIO, Topic
from ballbot_ros.recording.writer import RecordingWriter
from ballbot_ros.robot.brick.bluetooth import NEUTRAL, LogPacket, LogStream, stick_frame
from ballbot_ros.robot.brick.sensors import NO_DATA_CM, NO_ECHO_CM
from ballbot_ros.viewer.derived_messages import offered_qos

if TYPE_CHECKING:
    from ballbot_ros.nodes.teleop.terminal import Terminal

_SEND_S = SLOW_PERIOD_NS * 1e-9
"""Interval of the sticks: the program reads one packet every 4 ms while it balances."""

_RETRY_S, _LOST_S = 1.0, 0.1
_FLUSH_S = 0.5
_END_S = 2.0
_LAST_WORD_S = 0.3
_READ_SIZE = 4096
_NO_DISTANCE = {NO_ECHO_CM: 'no echo', NO_DATA_CM: 'no data'}
_SILENCE_S, _SILENT_PERIODS = 0.25, 2.5
"""Silence after which a program does not balance: a time, and in periods of its packets."""
_LONGEST_PERIOD_MS = 255 * TICK_NS // MILLISECOND_NS
"""The longest period of packets that a program can have (`log_count`)."""


def _connector(parameters: BrickLinkParameters) -> tuple[str, Callable[[], int]]:
    """Return the name of the link, and the function that opens it."""
    address, port = parameters.address, parameters.serial_port
    if bool(address) == bool(port):
        raise TeleopError('give either a Bluetooth address or a serial port')
    if address:
        rfcomm.check_address(address)
        return address, lambda: rfcomm.connect(address)

    def connect() -> int:
        path = Path(port)
        if path.is_socket():
            return local_socket.connect(port)
        if path.is_dir() or path.is_file():
            raise TeleopError(f'{port}: neither a serial device nor a socket')
        return serial_port.connect(port)

    return port, connect


class BrickOutput:
    """Publishes messages, and records them: log times are those of the PC, stamps the brick's."""

    def __init__(self, node: BrickLink) -> None:
        self._node, parameters = node, node.parameters
        self._writer: RecordingWriter | None = None
        self._wall_ns = time.time_ns() - time.monotonic_ns()
        if not parameters.output:
            return
        path, folder = Path(parameters.output), parameters.attachments
        self._writer = RecordingWriter.with_attachments(path, folder)

    @property
    def now_ns(self) -> int:
        """The time of the PC [ns]; one that is set meanwhile does not make it jump."""
        return self._wall_ns + time.monotonic_ns()

    def make(self, topic: Topic) -> Send:
        """Return the function that sends the messages of a topic."""
        publisher, name = self._node.output(topic), self._node.resolve_topic_name(topic.name)
        qos = (offered_qos(topic),)
        write = self._writer and self._writer.sender(name, topic.type_name, qos=qos)

        def send(stamp_ns: int, data: bytes) -> None:
            publisher.publish(data)
            if write:
                write(self.now_ns, data, stamp_ns)

        return send

    def flush(self) -> None:
        """Pass everything to the operating system."""
        if self._writer:
            self._writer.flush()

    def close(self, incomplete: str) -> None:
        """Finish the recording, with the reason why it is incomplete, if any."""
        if self._writer:
            if incomplete:
                self._writer.mark_incomplete(incomplete)
            self._writer.close()


class BrickLink(BallbotNode[BrickLinkParameters]):
    """Connects to a brick as often as necessary, and passes on what goes to and fro.

    A thread serves the link. Sticks are only sent while packets arrive: a program that does not
    balance reads none, and would find old ones later. The brick keeps the last sticks for ever, so
    neutral ones are sent when the user's inputs or the brick fall silent, and at the end, whatever
    ends the link.
    """

    def __init__(self, parameters: BrickLinkParameters | None = None) -> None:
        super().__init__(BrickLinkParameters, parameters)
        self.name, self._connect = _connector(self.parameters)
        lock = DomainLock(self.context.get_domain_id())
        self.on_destroy.callback(lock.release)
        self._output = BrickOutput(self)
        log_format = LogFormat.from_parameters(self.parameters)
        self._messages = BrickMessages(self._output.make, log_format)
        self._stream, self._clock = LogStream(), BrickClock()
        self.newest: LogPacket | None = None
        self._heard_s = -math.inf
        self._link_problem, self._is_fruitless = '', False
        self.connections, self._runs, self.is_connected = 0, 0, False
        self._command = Command(SCENARIO, NEUTRAL)
        self._sources, self._input_errors = Arbiter(), InputErrors()
        self._inputs = TeleopInputs(self, self._sources, self._input_errors)
        self.terminal: Terminal | None = None
        if self.parameters.keyboard:
            # Imported only here: it takes a while.
            from ballbot_ros.nodes.teleop.terminal import KeyboardSticks, Terminal

            self.terminal = Terminal(
                KeyboardSticks(self.parameters.gp_max),
                self._sources,
                lambda: (self._source(), self._command.sticks),
                self.lines,
                on_quit=self.finish,
            )
        self._ends = Event()
        self._thread = Thread(target=self._run, name='link', daemon=True)
        self._thread.start()

    def _source(self) -> str:
        return self._command.source_name('')

    # The link's thread

    def _run(self) -> None:
        try:
            while not self._ends.is_set():
                self._connect_once()
        except Exception as error:
            # Whatever it is, the command must end rather than go on without a link.
            known = isinstance(error, BallbotError)
            self.fail(str(error) if known else f'{type(error).__name__}: {one_line(error)}')
            self.finish()

    def _connect_once(self) -> None:
        """Serve a connection, if there is one, until it is lost; then wait for a moment."""
        count = self._stream.packets
        try:
            link = self._connect()
        except OSError as error:
            self._show_link_problem(f'{self.name}: not connected: {error.strerror or error}')
            self._is_fruitless = False
            self._ends.wait(_RETRY_S)
            return
        self.connections, self.is_connected = self.connections + 1, True
        self._clock.on_connection()
        if not self._is_fruitless:
            self.get_logger().info(f'{self.name}: connected')
        sender = WholePackets(link)
        try:
            self._serve(link, sender)
        except OSError as error:
            self._show_link_problem(f'{self.name}: connection lost: {error.strerror}')
        finally:
            self._end_sticks(sender)
            os.close(link)
            self.is_connected = False
        self._take(self._stream.end())
        self._output.flush()
        if self._ends.is_set():
            return
        if serial_port.is_pseudo(self.name):
            # Its number soon belongs to another terminal, which must not be taken for the brick.
            raise TeleopError(f'{self.name}: the other side of this pseudo-terminal has ended')
        self._is_fruitless = self._stream.packets == count
        self._ends.wait(_RETRY_S if self._is_fruitless else _LOST_S)

    def _serve(self, link: int, sender: WholePackets) -> None:
        """Serve a connection until the node ends; OSError if it is lost."""
        poll = select.poll()
        poll.register(link, select.POLLIN)
        due_s = flush_s = time.monotonic()
        while not self._ends.is_set():
            if poll.poll(max(0.0, due_s - time.monotonic()) * 1e3):
                self._take(self._stream.feed(_read(link)))
            now_s = time.monotonic()
            if now_s >= due_s:
                due_s = max(due_s + _SEND_S, now_s)
                self._send_sticks(sender, now_s)
            if now_s - flush_s > _FLUSH_S:
                flush_s = now_s
                self._output.flush()

    def _is_heard(self, now_s: float) -> bool:
        """Return whether the brick's program balances: only then does it send and read packets."""
        period_ms = self._stream.period_ms or _LONGEST_PERIOD_MS
        return now_s - self._heard_s < max(_SILENCE_S, _SILENT_PERIODS * period_ms * 1e-3)

    def _send_sticks(self, sender: WholePackets, now_s: float) -> None:
        command = Command(SCENARIO, NEUTRAL)
        if self._is_heard(now_s):
            command = self._sources.select(now_s, NEUTRAL)
        elif self._command.sticks == NEUTRAL:
            return
        if sender.send(stick_frame(command.sticks)):
            self._command = command
            self._messages.sticks(self._output.now_ns, command.sticks, command.source)

    def _end_sticks(self, sender: WholePackets) -> None:
        """Send neutral sticks, unless they were the last ones."""
        is_heard = self._is_heard(time.monotonic())
        if not is_heard and self._command.sticks == NEUTRAL:
            return
        self._command = Command(SCENARIO, NEUTRAL)
        if sender.finish(stick_frame(NEUTRAL), _LAST_WORD_S):
            with suppress(BallbotError):  # a recording that can't be written has ended the node
                self._messages.sticks(self._output.now_ns, NEUTRAL, SCENARIO)

    def _take(self, packets: list[LogPacket]) -> None:
        if not packets:
            return
        self._heard_s, self._link_problem = time.monotonic(), ''
        for packet, stamp_ns, begins_run in self._clock.stamped(packets, self._output.now_ns):
            if begins_run:
                self._runs += 1
                self._messages.begin(stamp_ns, f'{self._runs} {self.name}')
            self._messages.packet(stamp_ns, packet)
            self.newest = packet
            self.count_sample(stamp_ns)

    def _show_link_problem(self, text: str) -> None:
        if text != self._link_problem:
            self._link_problem = text
            self.get_logger().warning(text)

    # What the user sees

    def lines(self) -> Mapping[str, str]:
        """Return names and texts for a terminal; called on its thread."""
        packet, stream = self.newest, self._stream
        link = 'connected' if self.is_connected else f'waiting for {self.name}'
        if packet is None:
            return {'link': link}
        lsb = self.parameters.lsb
        return {
            'link': f'{link}   {stream.packets} packets, {stream.lost_packets} lost',
            'brick time': f'{packet.time_ms / 1e3:.1f} s',
            'battery': f'{packet.battery_mv / 1e3:.2f} V',
            'pitch': f'forward {packet.adc1 * lsb:+.2f} °   rightward {packet.adc2 * lsb:+.2f} °',
            'motors': f'forward {packet.rev_b:+d} °   rightward {packet.rev_c:+d} °',
            'sonar': _NO_DISTANCE.get(packet.sonar_cm, f'{packet.sonar_cm} cm'),
        }

    @property
    def losses(self) -> str:
        """What did not arrive intact; '' if nothing is known to be missing."""
        stream = self._stream
        if not (stream.lost_packets or stream.skipped_bytes):
            return ''
        return (
            f'{stream.lost_packets} packets of the brick are missing, and {stream.skipped_bytes} '
            'bytes belonged to none'
        )

    def diagnose(self) -> Mapping[str, object]:
        """Return the state of the link, and the input in command."""
        vertical, horizontal = self._command.sticks
        return {
            'link': self.name,
            'connected': self.is_connected,
            'connections': self.connections,
            'packets': self._stream.packets,
            'lost packets': self._stream.lost_packets,
            'skipped bytes': self._stream.skipped_bytes,
            'in command': self._source(),
            'sticks': f'{vertical} {horizontal}',
            'gamepad': self._inputs.gamepad or 'none',
        }

    def report(self) -> None:
        """Publish the diagnostics, with the problems of link and inputs."""
        self._input_errors.remove_cleared()
        problems = [self._link_problem, str(self._input_errors)]
        if text := '; '.join(filter(None, problems)):
            self.warn(text)
        else:
            self.clear_warning()
        super().report()

    def close(self) -> None:
        """Send neutral sticks, and finish the recording."""
        if self.terminal:
            self.terminal.close()
        self._ends.set()
        join_thread(self._thread, _END_S)
        self._inputs.close()
        if self._thread.is_alive():
            self.fail(f'{self.name}: the link does not end; the recording is not finished')
            return
        try:
            self._output.close(self.losses)
        except BallbotError as error:
            self.fail(str(error))


def _read(link: int) -> bytes:
    """Return the waiting bytes; OSError if the other side has gone."""
    with suppress(BlockingIOError):
        if data := os.read(link, _READ_SIZE):
            return data
        raise OSError(errno.ECONNRESET, 'the other side has closed it')
    return b''
