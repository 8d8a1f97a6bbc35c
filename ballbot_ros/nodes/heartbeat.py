"""The plant's signs of life for the command that started it.

They go through a pipe, because no call of the middleware may prevent the command from ending.
"""

from __future__ import annotations

import os
import struct
from contextlib import suppress
from typing import NamedTuple

HEARTBEAT_FD_ENV = 'BALLBOT_HEARTBEAT'
"""Environment variable of a plant: file descriptor of the pipe, inherited from its command."""

HEARTBEAT_S = 0.1
"""Period of the heartbeats [s]."""

_MESSAGE = struct.Struct('<q?')
_MAX_BYTES = _MESSAGE.size * 4096


class Heartbeat(NamedTuple):
    """What the plant tells: sim time [ns], 0 before the first tick, and the end of the run."""

    now_ns: int
    has_ended: bool


class HeartbeatSender:
    """Sends the heartbeats of this process, if its command wants any."""

    def __init__(self) -> None:
        file = os.environ.get(HEARTBEAT_FD_ENV)
        self.file = int(file) if file else None

    def send(self, beat: Heartbeat) -> None:
        """Send a heartbeat, unless the command has ended or does not read."""
        if self.file is not None:
            with suppress(BrokenPipeError, BlockingIOError):
                os.write(self.file, _MESSAGE.pack(*beat))


class HeartbeatPipe:
    """The pipe of a command.

    Attributes
    ----------
    theirs : int
        The descriptor for the plant.
    """

    def __init__(self) -> None:
        self._ours, self.theirs = os.pipe()
        for file in (self._ours, self.theirs):
            os.set_blocking(file, False)

    def newest(self) -> Heartbeat | None:
        """Return the newest heartbeat since the last call, if there is any."""
        try:
            data = os.read(self._ours, _MAX_BYTES)
        except BlockingIOError:
            return None
        beats = [Heartbeat(*beat) for beat in _MESSAGE.iter_unpack(data)]
        return beats[-1] if beats else None

    def close(self) -> None:
        """Close both ends."""
        os.close(self._ours)
        os.close(self.theirs)
