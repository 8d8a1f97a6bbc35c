"""The brick's side of a pseudo-terminal, whose other side a PC opens as a serial device."""

from __future__ import annotations

import os
import select
import tty


class Listener:
    """A pseudo-terminal, of which the PC opens the device `path`."""

    def __init__(self) -> None:
        self._master, device = os.openpty()
        tty.setraw(device)
        self.path = os.ttyname(device)
        os.close(device)
        os.set_blocking(self._master, False)
        self._poll = select.poll()
        self._poll.register(self._master, select.POLLIN)

    def accept(self) -> int | None:
        """Return the file descriptor, which does not block, once the PC has opened the device."""
        is_closed = any(events & select.POLLHUP for _, events in self._poll.poll(0))
        return None if is_closed else self._master

    def hang_up(self, link: int) -> None:
        """Leave the terminal open: the device, and what its reader has not read, remain."""

    def close(self) -> None:
        """Remove the device."""
        os.close(self._master)
