"""The page's address, and checks that the page can be served there."""

from __future__ import annotations

import ipaddress
import socket

from ballbot_ros.viewer.errors import ViewerError, importing

_PREFIX = 'viewer  '
LOOPBACK = ('127.0.0.1', 'localhost', '::1')


def require_viser() -> None:
    """Raise ViewerError if viser is not installed."""
    with importing():
        import viser  # noqa: F401


def check_address(host: str, port: int) -> None:
    """Raise ViewerError if no page can be served at an address; port 0 means any free port."""
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            # Like the server, ignore closing connections of an earlier server.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        raise ViewerError(
            f'the viewer cannot be served on {url_authority(host, port)}: {error.strerror}; '
            'choose another host or port (port 0: a free one)'
        ) from None


def address_line(address: str) -> str:
    """Return the line with which a viewer prints its address."""
    return f'{_PREFIX}{address}'


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
