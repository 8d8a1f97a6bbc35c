"""The 32-byte Bluetooth packets of NXT GamePad: sticks to the brick, log packets from it.

In the stream of bytes, each follows its length, which is all that separates them.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from ballbot_ros.errors import BallbotError
from ballbot_ros.robot.brick.sensors import NO_DATA_CM, NO_ECHO_CM, battery_mv, quantise

PACKET_SIZE = 32
"""Size of each packet; one to the brick has the sticks in its first two bytes."""

LENGTH = struct.pack('<H', PACKET_SIZE)
"""What precedes each packet."""

FRAME_SIZE = len(LENGTH) + PACKET_SIZE

SAFE_LOG_MS = 20
"""Time between log packets [ms] below which a real link may corrupt them: it did with 4 ms."""

_LOG = struct.Struct('<IbbHiiihhhhi')

Sticks = tuple[int, int]
"""Left stick vertical (up, forward, is negative) and right stick horizontal (right is positive)."""

NEUTRAL: Sticks = (0, 0)


def sticks_of(forward: float, rightward: float, full: int) -> Sticks:
    """Return the sticks for shares of the full speed, -1 ... 1, and a full stick (``gp_max``)."""
    return -quantise(forward * full), quantise(rightward * full)


def stick_frame(sticks: Sticks) -> bytes:
    """Return the bytes that tell the brick the sticks, -128 ... 127."""
    return LENGTH + struct.pack('bb', *sticks).ljust(PACKET_SIZE, b'\0')


def sticks_in(packet: bytes) -> Sticks:
    """Return the sticks in a packet to the brick."""
    vertical, horizontal = struct.unpack_from('bb', packet)
    return vertical, horizontal


class PacketError(BallbotError):
    """Bytes that are not a packet, or values that do not fit in one."""


@dataclass(frozen=True)
class LogPacket:
    """Packet from the NXT to the PC: one record of the ADC data logger.

    Attributes
    ----------
    time_ms : int
        uint32 system tick.
    data1, data2 : int
        int8 values of the caller.
    battery_mv : int
        uint16.
    rev_a, rev_b, rev_c : int
        int32 motor angles [deg].
    adc1, adc2, adc3, adc4 : int
        int16 values of the caller; the document's program logs both pitch angles in the first two.
    sonar_cm : int
        int32.
    """

    time_ms: int
    data1: int
    data2: int
    battery_mv: int
    rev_a: int
    rev_b: int
    rev_c: int
    adc1: int
    adc2: int
    adc3: int
    adc4: int
    sonar_cm: int

    def encode(self) -> bytes:
        """Return the packet's 32 bytes; raise PacketError if a value does not fit its field."""
        values = tuple(vars(self).values())
        try:
            return _LOG.pack(*values)
        except struct.error as error:
            raise PacketError(f'{values} do not fit in a packet: {error}') from None

    @classmethod
    def decode(cls, data: bytes) -> LogPacket:
        """Read a packet of 32 bytes."""
        if len(data) != PACKET_SIZE:
            raise PacketError(f'a packet has {PACKET_SIZE} bytes, not {len(data)}')
        return cls(*_LOG.unpack(data))


CLOCK_PERIOD_MS = 2**32
"""The brick's clock counts milliseconds in 32 bits."""

_MAX_BATTERY_MV = battery_mv(100.0)
_MAX_GAP_MS = 10_000
_STEPS = 9
"""Steps of the clock whose median is the period of the packets."""

_WINDOW = 5 * FRAME_SIZE
"""Bytes within which a packet that does not follow the one before needs a successor."""

_MAX_DEGREES_PER_MS = 3
_SLACK_DEGREES = 30
_MAX_VOLTAGE_STEP_MV = 3000


def is_possible(packet: LogPacket) -> bool:
    """Return whether a brick can have sent a packet: its battery and sonar have such values."""
    is_distance = NO_DATA_CM <= packet.sonar_cm <= NO_ECHO_CM
    return is_distance and packet.battery_mv <= _MAX_BATTERY_MV


def elapsed(before: LogPacket, after: LogPacket) -> int:
    """Return the time from one packet to a later one [ms]."""
    return (after.time_ms - before.time_ms) % CLOCK_PERIOD_MS


def follows(before: LogPacket, after: LogPacket) -> bool:
    """Return whether a packet can be the next one: its clock, battery and motors are near."""
    elapsed_ms = elapsed(before, after)
    if not 0 < elapsed_ms <= _MAX_GAP_MS:
        return False
    most = _MAX_DEGREES_PER_MS * elapsed_ms + _SLACK_DEGREES
    turned = (
        after.rev_a - before.rev_a, after.rev_b - before.rev_b, after.rev_c - before.rev_c
    )  # fmt: skip
    is_near = abs(after.battery_mv - before.battery_mv) <= _MAX_VOLTAGE_STEP_MV
    return is_near and all(abs(degrees) <= most for degrees in turned)


class LogStream:
    """Finds the log packets in the bytes of a connection, in which some may be lost or wrong.

    The protocol has no checksum and no mark at which to begin again, so a packet counts if it has
    the right length, possible values, and follows the one before. If it does not follow, as after
    a restart of the brick, it counts once the next one follows it. A wrong bit that leaves a packet
    plausible is not found.

    Attributes
    ----------
    skipped_bytes : int
        Number of bytes that belonged to none.
    lost_packets : int
        Number of packets missing between those found, by their times.
    period_ms : int
        Usual time between two packets [ms]; 0 before the second.
    """

    def __init__(self) -> None:
        self.packets = self.skipped_bytes = self.lost_packets = self.period_ms = 0
        self._steps_ms: deque[int] = deque(maxlen=_STEPS)
        self._bytes = bytearray()
        self._newest: LogPacket | None = None
        self._is_fresh = True

    def feed(self, data: bytes) -> list[LogPacket]:
        """Return the packets that these bytes complete."""
        self._bytes += data
        return list(self._packets(is_end=False))

    def end(self) -> list[LogPacket]:
        """End the connection; return the last packet, if it lacked only its successor."""
        found = list(self._packets(is_end=True))
        self._skip(len(self._bytes))
        self._is_fresh = True
        return found

    def _packets(self, *, is_end: bool) -> Iterator[LogPacket]:
        at = 0
        while (at := self._bytes.find(LENGTH, at)) >= 0:
            packet = self._packet(at)
            is_complete = len(self._bytes) >= at + FRAME_SIZE
            verdict = self._judge(packet, at, is_end=is_end) if packet else not is_complete
            if packet and verdict:
                self._skip(at)
                del self._bytes[:FRAME_SIZE]
                self._count(packet)
                yield packet
                at = 0
            elif verdict is False:
                at += 1
            else:  # the bytes so far do not tell
                break
        if at < 0:  # keep what may be the first byte of a length
            at = len(self._bytes) - self._bytes.endswith(LENGTH[:1])
        self._skip(at)

    def _packet(self, at: int) -> LogPacket | None:
        """Return a complete and possible packet whose length is at an index."""
        data = self._bytes[at : at + FRAME_SIZE]
        if len(data) < FRAME_SIZE:
            return None
        packet = LogPacket.decode(bytes(data[len(LENGTH) :]))
        return packet if is_possible(packet) else None

    def _starts(self, first: int, end: int) -> Iterator[int]:
        """Yield where packets may begin, from an index up to another."""
        while (first := self._bytes.find(LENGTH, first, end)) >= 0:
            yield first
            first += 1

    def _judge(self, packet: LogPacket, at: int, *, is_end: bool) -> bool | None:
        """Return whether a packet counts; None if the bytes so far do not tell."""
        after, is_doubtful = at + FRAME_SIZE, True
        if (self._is_fresh and at == 0) or (self._newest and follows(self._newest, packet)):
            if self._bytes[after : after + len(LENGTH)] == LENGTH:
                return True
            # It may have lost its end, so that it includes the beginning of the next one.
            is_doubtful = False
            for start in self._starts(at + 1, after):
                if len(self._bytes) < start + FRAME_SIZE and not is_end:
                    return None
                if inner := self._packet(start):
                    if self._newest and follows(self._newest, inner):
                        return False
                    is_doubtful = self._newest is None
        if not is_doubtful:
            return True
        for start in self._starts(at + 1, after + _WINDOW):
            other = self._packet(start)
            if other and start >= after and follows(packet, other):
                return True
            if other and self._newest and follows(self._newest, other):
                return False
        if is_end:
            rest = bytes(self._bytes[after:])
            return rest.startswith(LENGTH) or LENGTH.startswith(rest)
        return None if len(self._bytes) < after + _WINDOW else False

    def _skip(self, count: int) -> None:
        if count:
            self.skipped_bytes += count
            del self._bytes[:count]
            self._is_fresh = False

    def _count(self, packet: LogPacket) -> None:
        self.packets += 1
        if self._newest and follows(self._newest, packet):
            self._steps_ms.append(elapsed(self._newest, packet))
            self.period_ms = sorted(self._steps_ms)[(len(self._steps_ms) - 1) // 2]
            # A wrong clock makes one step longer and the next one shorter.
            self.lost_packets += round(self._steps_ms[-1] / self.period_ms) - 1
        else:
            self._steps_ms.clear()
        self._newest, self._is_fresh = packet, False
