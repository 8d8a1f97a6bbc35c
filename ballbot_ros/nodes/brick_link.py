"""The PC's side of a real brick: sends it the sticks, publishes and records its data log."""

from __future__ import annotations

import errno
import os
import select
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING

from ballbot_ros.errors import BallbotError, RecordingError, TeleopError, os_errors
from ballbot_ros.nodes.base import BallbotNode
from ballbot_ros.nodes.gamepad_teleop import TeleopInputs
from ballbot_ros.nodes.middleware import DomainLock
from ballbot_ros.nodes.processes import join_thread
from ballbot_ros.nodes.teleop.gamepad import InputErrors
from ballbot_ros.nodes.teleop.sticks import Arbiter, Command
from ballbot_ros.nodes.transports import local_socket, rfcomm, serial_port
from ballbot_ros.parameters import BrickLinkParameters, LogFormat
from ballbot_ros.parameters.timing import MILLISECOND_NS, SLOW_PERIOD_NS, TICK_NS
from ballbot_ros.recording.brick_clock import BrickClock
from ballbot_ros.recording.csv_log import CsvLog
from ballbot_ros.recording.messages.brick_messages import BrickMessages
from ballbot_ros.recording.messages.run_messages import Send
from ballbot_ros.recording.messages.topics import SCENARIO, Topic
from ballbot_ros.recording.rosbag2 import RecordedTopic, media_type
from ballbot_ros.recording.writer import RecordingWriter
from ballbot_ros.robot.brick.bluetooth import NEUTRAL, LogPacket, LogStream, stick_frame
from ballbot_ros.robot.brick.sensors import NO_ECHO_CM
from ballbot_ros.viewer.derived_messages import offered_qos

if TYPE_CHECKING:
    from ballbot_ros.nodes.teleop_terminal import TeleopTerminal

SEND_S = SLOW_PERIOD_NS * 1e-9
"""Interval of the sticks: the program reads one packet every 4 ms while it balances."""

RETRY_S = 1.0
_LOST_S = 0.1
FLUSH_S = 0.5
END_S = 2.0
_LAST_WORD_S = 0.3
_READ_SIZE = 4096
_SILENCE_S, _SILENT_PERIODS = 0.25, 2.5
"""Silence after which a program does not balance: a time, and in periods of its packets."""

LONGEST_PERIOD_MS = 255 * TICK_NS // MILLISECOND_NS
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
        if Path(port).is_socket():
            return local_socket.connect(port)
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
        folder = parameters.attachments
        with os_errors(RecordingError, folder):
            files = sorted(Path(folder).iterdir()) if folder else []
            attachments = {each.name: each.read_bytes() for each in files}
        path = Path(parameters.output)
        with os_errors(RecordingError, path.parent):
            path.parent.mkdir(parents=True, exist_ok=True)
        self._writer = RecordingWriter(path)
        for name, data in attachments.items():
            self._writer.add_attachment(name, media_type(name), data)

    @property
    def now_ns(self) -> int:
        """The time of the PC [ns]; one that is set meanwhile does not make it jump."""
        return self._wall_ns + time.monotonic_ns()

    def make(self, topic: Topic) -> Send:
        """Return the function that sends the messages of a topic."""
        publisher, name = self._node.output(topic), self._node.resolve_topic_name(topic.name)
        recorded: RecordedTopic | None = None

        def send(stamp_ns: int, data: bytes) -> None:
            nonlocal recorded
            publisher.publish(data)
            if writer := self._writer:
                if recorded is None:
                    recorded = writer.add_topic(name, topic.type_name, qos=(offered_qos(topic),))
                writer.write(recorded, self.now_ns, data, recorded.count + 1, stamp_ns)

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
    neutral ones are sent when the user's inputs fall silent, and at the end.
    """

    def __init__(self, parameters: BrickLinkParameters | None = None) -> None:
        super().__init__(BrickLinkParameters, parameters)
        self.name, self._connect = _connector(self.parameters)
        lock = DomainLock(self.context.get_domain_id())
        self.on_destroy.callback(lock.release)
        self._output = BrickOutput(self)
        log_format = LogFormat.from_parameters(self.parameters)
        self._messages = BrickMessages(self._output.make, log_format)
        path = self.parameters.log_csv
        self._log = CsvLog(Path(path)) if path else None
        self._stream, self._clock = LogStream(), BrickClock()
        self.newest: LogPacket | None = None
        self._heard_s = -1e9
        self.connections, self._runs, self.is_connected = 0, 0, False
        self._command = Command(SCENARIO, NEUTRAL)
        self._sources, self._input_errors = Arbiter(), InputErrors()
        self._inputs = TeleopInputs(self, self._sources, self._input_errors)
        self.terminal: TeleopTerminal | None = None
        if self.parameters.keyboard:
            # Imported only here: it takes a while.
            from ballbot_ros.nodes.teleop_terminal import TeleopTerminal

            self.terminal = TeleopTerminal(
                self, self._sources, lambda: (self._source(), self._command.sticks), self.lines
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
                try:
                    link = self._connect()
                except OSError as error:
                    self.warn(f'{self.name}: not connected: {error.strerror or error}')
                    self._ends.wait(RETRY_S)
                    continue
                try:
                    self._serve(link)
                finally:
                    os.close(link)
                    self.is_connected = False
                    self._take(self._stream.end())
        except BallbotError as error:
            self.fail(str(error))
            self.finish()

    def _serve(self, link: int) -> None:
        """Serve a connection until it is lost, or the node ends."""
        self.connections, self.is_connected = self.connections + 1, True
        self._clock.on_connection()
        self.clear_warning()
        self.get_logger().info(f'{self.name}: connected')
        sender, poll = Sender(link), select.poll()
        poll.register(link, select.POLLIN)
        due_s = flush_s = time.monotonic()
        try:
            while not self._ends.is_set():
                now_s = time.monotonic()
                if poll.poll(max(0.0, due_s - now_s) * 1e3):
                    self._take(self._stream.feed(_read(link)))
                now_s = time.monotonic()
                if now_s >= due_s:
                    due_s = max(due_s + SEND_S, now_s)
                    self._send_sticks(sender, now_s)
                if now_s - flush_s > FLUSH_S:
                    flush_s = now_s
                    self._flush()
            if self._is_heard(time.monotonic()):
                sender.finish(stick_frame(NEUTRAL))
                self._messages.sticks(self._output.now_ns, NEUTRAL, SCENARIO)
        except OSError as error:
            self.warn(f'{self.name}: connection lost: {error.strerror}')
            self._ends.wait(_LOST_S)

    def _is_heard(self, now_s: float) -> bool:
        """Return whether the brick's program balances: only then does it send and read packets."""
        period_ms = self._stream.period_ms or LONGEST_PERIOD_MS
        return now_s - self._heard_s < max(_SILENCE_S, _SILENT_PERIODS * period_ms * 1e-3)

    def _send_sticks(self, sender: Sender, now_s: float) -> None:
        if not self._is_heard(now_s):
            return
        command = self._sources.select(now_s, NEUTRAL)
        if sender.send(stick_frame(command.sticks)):
            self._command = command
            self._messages.sticks(self._output.now_ns, command.sticks, command.source)

    def _take(self, packets: list[LogPacket]) -> None:
        if not packets:
            return
        self._heard_s = time.monotonic()
        for packet, stamp_ns, begins_run in self._clock.stamped(packets, self._output.now_ns):
            if begins_run:
                self._runs += 1
                self._messages.begin(stamp_ns, f'{self._runs} {self.name}')
                if self._log:
                    self._log.begin_run(packet.time_ms)
            self._messages.packet(stamp_ns, packet)
            if self._log:
                self._log.write(packet)
            self.newest = packet
            self.count_sample(stamp_ns)

    def _flush(self) -> None:
        self._output.flush()
        if self._log:
            self._log.flush()

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
            'sonar': f'{packet.sonar_cm} cm' if 0 <= packet.sonar_cm < NO_ECHO_CM else 'no echo',
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
        """Publish the diagnostics, with the errors of the inputs."""
        super().report()
        self._input_errors.remove_cleared()
        if str(self._input_errors):
            self.warn(str(self._input_errors))
        elif self.is_connected:
            self.clear_warning()

    def close(self) -> None:
        """Send neutral sticks, and finish recording and log."""
        if self.terminal:
            self.terminal.close()
        self._ends.set()
        join_thread(self._thread, END_S)
        self._inputs.close()
        try:
            self._output.close(self.losses)
            if self._log:
                self._log.close()
        except BallbotError as error:
            self.fail(str(error))


def _read(link: int) -> bytes:
    """Return the waiting bytes; OSError if the other side has gone."""
    with suppress(BlockingIOError):
        if data := os.read(link, _READ_SIZE):
            return data
        raise OSError(errno.ECONNRESET, 'the other side has closed it')
    return b''


class Sender:
    """Writes whole packets to a link that takes them at its own pace."""

    def __init__(self, link: int) -> None:
        self._link, self._rest = link, b''

    def send(self, frame: bytes) -> bool:
        """Send a packet, unless part of the one before is still waiting; return whether it goes."""
        if self._rest:
            self._write(self._rest)
        if self._rest:
            return False
        self._write(frame)
        return True

    def _write(self, data: bytes) -> None:
        try:
            self._rest = data[os.write(self._link, data) :]
        except BlockingIOError:
            self._rest = data
        except OSError:
            self._rest = b''  # lost; what has arrived before is read first

    def finish(self, frame: bytes) -> None:
        """Send a last packet, for which there is a short time."""
        ends_s, poll = time.monotonic() + _LAST_WORD_S, select.poll()
        poll.register(self._link, select.POLLOUT)
        is_sent = self.send(frame)
        while (self._rest or not is_sent) and (left_s := ends_s - time.monotonic()) > 0.0:
            poll.poll(left_s * 1e3)
            if is_sent:
                self._write(self._rest)
            else:
                is_sent = self.send(frame)
