"""Whole packets to a link that takes bytes at its own pace."""

from __future__ import annotations

import os
import select
import time


class WholePackets:
    """Writes packets to a file descriptor, none before all of the one before has gone."""

    def __init__(self, link: int) -> None:
        self._link, self._rest = link, b''

    def send(self, packet: bytes) -> bool:
        """Send a packet, unless the one before is still under way; return whether it goes.

        A link that is lost takes nothing: its reader notices that.
        """
        if self._rest and not self._write(self._rest):
            return False
        return not self._rest and self._write(packet)

    def _write(self, data: bytes) -> bool:
        try:
            self._rest = data[os.write(self._link, data) :]
        except BlockingIOError:
            self._rest = data
        except OSError:
            self._rest = b''
            return False
        return True

    def finish(self, packet: bytes, limit_s: float) -> bool:
        """Send a last packet, for which there is so much time; return whether it has gone."""
        ends_s, poll = time.monotonic() + limit_s, select.poll()
        poll.register(self._link, select.POLLOUT)
        self._rest += packet
        while self._rest and (left_s := ends_s - time.monotonic()) > 0.0:
            poll.poll(left_s * 1e3)
            if not self._write(self._rest):
                return False
        return not self._rest
