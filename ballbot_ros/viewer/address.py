"""Where the page is served; and whether it can be."""

from __future__ import annotations

import ipaddress
import socket

from ballbot_ros.viewer.errors import ViewerError

LOOPBACK = ('127.0.0.1', 'localhost', '::1')


def require_viser() -> None:
    """Find out whether the page can be made at all.

    Raises
    ------
    ViewerError
        If viser is not installed.
    """
    try:
        import viser  # noqa: F401
    except ImportError as error:
        raise ViewerError(
            f'the viewer lacks a package ({error}): pip install "ballbot_ros[viewer]"'
        ) from None


def check_address(host: str, port: int) -> None:
    """Find out whether a page can be served there; port 0 stands for a free one.

    Raises
    ------
    ViewerError
        If the port is taken, or the host is not one of this machine.
    """
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            # As the server does it: connections of an earlier one that still close don't count.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        raise ViewerError(
            f'the viewer cannot be served on {location(host, port)}: {error.strerror}; '
            'choose another host or port (port 0: a free one)'
        ) from None


def location(host: str, port: int) -> str:
    """Return host and port as a URL has them."""
    return f'[{host}]:{port}' if ':' in host else f'{host}:{port}'


def is_any_address(host: str) -> bool:
    """Tell whether `host` stands for all addresses of this machine."""
    try:
        return ipaddress.ip_address(host).is_unspecified
    except ValueError:  # a name
        return False


def warning_of(host: str) -> str:
    """Return a warning where others in the network reach the page, else nothing."""
    if host in LOOPBACK:
        return ''
    return (
        'the viewer is open to the network: everybody who reaches it can look, '
        'and whoever has the address with the token can steer'
    )
