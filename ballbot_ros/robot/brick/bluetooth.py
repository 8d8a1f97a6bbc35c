"""The 32-byte Bluetooth packets of NXT GamePad: sticks to the brick, log packets from it."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from ballbot_ros.errors import BallbotError
from ballbot_ros.robot.brick.sensors import quantise

PACKET_SIZE = 32
"""Size of each packet; one to the brick has the sticks in its first two bytes."""

_LOG = struct.Struct('<IbbHiiihhhhi')

Sticks = tuple[int, int]
"""Left stick vertical (up, forward, is negative) and right stick horizontal (right is positive)."""

NEUTRAL: Sticks = (0, 0)


def sticks_of(forward: float, rightward: float, full: int) -> Sticks:
    """Return the sticks for shares of the full speed, -1 ... 1, and a full stick (``gp_max``)."""
    return -quantise(forward * full), quantise(rightward * full)


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
        int16 values of the caller; this controller logs both pitch angles in the first two.
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
