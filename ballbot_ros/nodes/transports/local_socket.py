"""A link through a Unix socket, on which an emulated brick listens."""

from __future__ import annotations

import os
import socket
from pathlib import Path


def connect(path: str) -> int:
    """Connect to a socket; return the file descriptor, which does not block.

    It raises OSError if nobody listens there.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as link:
        link.connect(path)
        link.setblocking(False)
        return link.detach()


def _is_served(path: str) -> bool:
    try:
        os.close(connect(path))
    except ConnectionRefusedError:
        return False
    return True


class Listener:
    """The brick's side of a socket: takes one connection at a time."""

    def __init__(self, path: str) -> None:
        self.path = path
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
        if Path(path).is_socket() and not _is_served(path):
            Path(path).unlink()  # left over from a brick that was killed
        self._socket.bind(path)
        self._socket.listen(1)

    def accept(self) -> int | None:
        """Return the file descriptor of a new connection, which does not block; None for none."""
        try:
            link, _ = self._socket.accept()
        except BlockingIOError:
            return None
        with link:
            link.setblocking(False)
            return link.detach()

    def hang_up(self, link: int) -> None:
        """End a connection."""
        os.close(link)

    def close(self) -> None:
        """Remove the socket."""
        self._socket.close()
        Path(self.path).unlink(missing_ok=True)
