"""The page's address, and checks that the page can be served there."""

from __future__ import annotations

import errno
import ipaddress
import socket

from ballbot_ros.viewer.errors import ViewerError, importing

NEXT_FREE = -1
"""Instead of a port: the usual one, or the next one that is free."""

_USUAL_PORT = 8080
_TRIED = 100
_PREFIX = 'viewer  '
LOOPBACK = ('127.0.0.1', 'localhost', '::1')


def require_viser() -> None:
    """Raise ViewerError if viser is not installed."""
    with importing():
        import viser  # noqa: F401


def check_address(host: str, port: int) -> int:
    """Return the port of a page, 0 for any free one; raise ViewerError if none can be served."""
    usual, tried = (_USUAL_PORT, _TRIED) if port == NEXT_FREE else (port, 1)
    for number in range(usual, usual + tried):
        try:
            family, _, _, _, address = socket.getaddrinfo(host, number, type=socket.SOCK_STREAM)[0]
            with socket.socket(family, socket.SOCK_STREAM) as probe:
                # Like the server, ignore closing connections of an earlier server.
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind(address)
            return number
        except OSError as error:
            reason = error
            if error.errno != errno.EADDRINUSE:
                break
    raise ViewerError(
        f'the viewer cannot be served on {url_authority(host, number)}: {reason.strerror}; '
        'choose another host or port (port 0: a free one)'
    )


def address_line(address: str, port: int = 0) -> str:
    """Return the line with which a viewer prints its address, after one if `port` was in use."""
    line = f'{_PREFIX}{address}'
    if port != NEXT_FREE or f':{_USUAL_PORT}/' in address:
        return line
    return f'port {_USUAL_PORT} is in use: the page takes the next free one\n{line}'


def address_in(line: str) -> str:
    """Return the address in a viewer's line; '' if it has none."""
    return line.removeprefix(_PREFIX) if line.startswith(f'{_PREFIX}http://') else ''


def url_authority(host: str, port: int) -> str:
    """Return host and port in URL notation."""
    return f'[{host}]:{port}' if ':' in host else f'{host}:{port}'


def is_any_address(host: str) -> bool:
    """Return whether `host` means all addresses of this machine."""
    try:
        return ipaddress.ip_address(host).is_unspecified
    except ValueError:  # a name
        return False


def network_warning(host: str) -> str:
    """Return a warning if the page is reachable over the network, else ''."""
    if host in LOOPBACK:
        return ''
    return (
        'the viewer is open to the network: everybody who reaches it can watch, '
        'and everybody who has the address with the token can steer'
    )
