"""The brick's Bluetooth link: RFCOMM, by the sockets of the standard library."""

from __future__ import annotations

import re
import socket
from pathlib import Path

from ballbot_ros.errors import TeleopError

CHANNEL = 1
"""The channel on which the brick listens."""

_CONNECT_S = 10.0
_ADAPTERS = Path('/sys/class/bluetooth')
_ADDRESS = re.compile('(?:[0-9A-Fa-f]{2}:){5}[0-9A-Fa-f]{2}')


def check_address(address: str) -> None:
    """Raise TeleopError if this is no Bluetooth address, or Python here has no Bluetooth."""
    if not _ADDRESS.fullmatch(address):
        raise TeleopError(f'{address!r} is no Bluetooth address, such as 00:16:53:01:02:03')
    require_sockets()


def require_sockets() -> None:
    """Raise TeleopError if Python here was built without Bluetooth."""
    if not hasattr(socket, 'AF_BLUETOOTH'):
        raise TeleopError(
            'this Python has no Bluetooth sockets: use another one, or bind the brick to a serial '
            f'device with `sudo rfcomm bind 0 ADDRESS {CHANNEL}`, and use --port /dev/rfcomm0'
        )


def describe_adapters(folder: Path = _ADAPTERS) -> str:
    """Return the names of the Bluetooth adapters of this machine.

    It raises TeleopError if there is none, or all are switched off; the message says what to do.
    """
    # A connection is a child of its adapter, such as hci0:256.
    found = sorted(each for each in folder.glob('hci*') if ':' not in each.name)
    if not found:
        raise TeleopError('no Bluetooth adapter found: plug one in, or start `bluetoothd`')
    if all(any(map(_is_blocked, each.glob('rfkill*'))) for each in found):
        raise TeleopError(f'{found[0].name} is switched off: run `rfkill unblock bluetooth`')
    return ', '.join(each.name for each in found)


def _is_blocked(switch: Path) -> bool:
    return any((switch / kind).read_text().strip() == '1' for kind in ('soft', 'hard'))


def connect(address: str) -> int:
    """Connect to a brick; return the file descriptor, which does not block.

    It raises OSError if the brick is off, out of reach, or not paired.
    """
    link = socket.socket(socket.AF_BLUETOOTH, socket.SOCK_STREAM, socket.BTPROTO_RFCOMM)
    with link:
        link.settimeout(_CONNECT_S)
        link.connect((address, CHANNEL))
        link.setblocking(False)
        return link.detach()
