"""When the packets of a brick were sent, on the clock of the PC."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ballbot_ros.parameters.timing import MILLISECOND_NS, SECOND_NS
from ballbot_ros.robot.brick.bluetooth import LogPacket, elapsed

_MAX_AHEAD_NS = 2 * SECOND_NS
_MAX_DELAY_NS = 60 * SECOND_NS


class StampedPacket(NamedTuple):
    """A packet, its stamp [ns], and whether a run of the brick's program begins with it."""

    packet: LogPacket
    stamp_ns: int
    begins_run: bool


class BrickClock:
    """Gives packets stamps that have the steps of the brick's clock, which the radio can't delay.

    The first packet of a run sets both clocks to the same time. If a packet arrives more than 2 s
    before its time or 60 s after it, it had a wrong bit, or the clocks have drifted for hours: they
    are set anew. Stamps always increase. A brick can only start again while there is no connection,
    so after one 2 s in either direction mean a new run.
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
            since_ns = elapsed(packet, packets[-1]) * MILLISECOND_NS
            found.append(self._stamped(packet, now_ns - since_ns * (since_ns < _MAX_DELAY_NS)))
        return found

    def _stamped(self, packet: LogPacket, arrival_ns: int) -> StampedPacket:
        before, stamp_ns, is_wrong = self._newest, arrival_ns, True
        if before:
            stamp_ns = before.stamp_ns + elapsed(before.packet, packet) * MILLISECOND_NS
            longest_ns = _MAX_AHEAD_NS if self._is_new_connection else _MAX_DELAY_NS
            is_wrong = not -_MAX_AHEAD_NS <= arrival_ns - stamp_ns <= longest_ns
            if is_wrong:
                stamp_ns = max(arrival_ns, before.stamp_ns + MILLISECOND_NS)
        self._newest = StampedPacket(packet, stamp_ns, is_wrong and self._is_new_connection)
        self._is_new_connection = False
        return self._newest
