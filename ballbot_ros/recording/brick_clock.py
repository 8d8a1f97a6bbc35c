"""When the packets of a brick were sent, on the clock of the PC."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ballbot_ros.parameters.timing import MILLISECOND_NS, SECOND_NS
from ballbot_ros.robot.brick.bluetooth import LogPacket, elapsed

_MAX_APART_NS = 2 * SECOND_NS


class StampedPacket(NamedTuple):
    """A packet, its stamp [ns], and whether a run of the brick's program begins with it."""

    packet: LogPacket
    stamp_ns: int
    begins_run: bool


class BrickClock:
    """Gives packets stamps that have the steps of the brick's clock, which the radio can't delay.

    The first packet of a run sets both clocks to the same time. Where they are more than 2 s apart
    later, it was a wrong bit, or the clocks have drifted for hours: they are set anew. Stamps
    always increase. A brick can only start again while there is no connection.
    """

    def __init__(self) -> None:
        self._newest: StampedPacket | None = None
        self._is_new_connection = True

    def on_connection(self) -> None:
        """Note a new connection."""
        self._is_new_connection = True

    def stamped(self, packets: Sequence[LogPacket], now_ns: int) -> list[StampedPacket]:
        """Return packets, of which the last one arrives now, with stamps."""
        found = []
        for packet in packets:
            arrival_ns = now_ns - elapsed(packet, packets[-1]) * MILLISECOND_NS
            if abs(arrival_ns - now_ns) > _MAX_APART_NS:
                arrival_ns = now_ns
            found.append(self._stamped(packet, arrival_ns))
        return found

    def _stamped(self, packet: LogPacket, arrival_ns: int) -> StampedPacket:
        before, stamp_ns = self._newest, arrival_ns
        is_apart = before is None
        if before:
            stamp_ns = before.stamp_ns + elapsed(before.packet, packet) * MILLISECOND_NS
            is_apart = abs(stamp_ns - arrival_ns) > _MAX_APART_NS
            if is_apart:
                stamp_ns = max(arrival_ns, before.stamp_ns + MILLISECOND_NS)
        self._newest = StampedPacket(packet, stamp_ns, is_apart and self._is_new_connection)
        self._is_new_connection = False
        return self._newest
