"""The brick's Bluetooth link: RFCOMM, by the sockets of the standard library."""

from __future__ import annotations

import re
import socket

from ballbot_ros.errors import TeleopError

CHANNEL = 1
"""The channel on which the brick listens."""

_CONNECT_S = 10.0
_ADDRESS = re.compile('(?:[0-9A-Fa-f]{2}:){5}[0-9A-Fa-f]{2}')


def check_address(address: str) -> None:
    """Raise TeleopError if this is no Bluetooth address, or Python here has no Bluetooth."""
    if not _ADDRESS.fullmatch(address):
        raise TeleopError(f'{address!r} is no Bluetooth address, such as 00:16:53:01:02:03')
    if not hasattr(socket, 'AF_BLUETOOTH'):
        raise TeleopError(
            'this Python has no Bluetooth sockets: bind the brick to a serial device with '
            f'`sudo rfcomm bind 0 {address} {CHANNEL}`, and use --port /dev/rfcomm0'
        )


def connect(address: str) -> int:
    """Connect to a brick; return the file descriptor, which does not block.

    Raises
    ------
    OSError
        If the brick is off, out of reach, or not paired.
    """
    link = socket.socket(socket.AF_BLUETOOTH, socket.SOCK_STREAM, socket.BTPROTO_RFCOMM)
    with link:
        link.settimeout(_CONNECT_S)
        link.connect((address, CHANNEL))
        link.setblocking(False)
        return link.detach()
