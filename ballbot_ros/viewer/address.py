"""The address of a page, checks that it can be served there, and who may steer."""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
from collections.abc import Sequence
from dataclasses import dataclass, field

from ballbot_ros.errors import ViewerError, importing

USUAL_PORT, NEXT_FREE = 8080, -1
"""The port of a page; and, instead of a port: the usual one or the next one that is free."""

_PREFIX = 'viewer  '
LOOPBACK = ('127.0.0.1', 'localhost', '::1')


def require_viser() -> None:
    """Raise MissingExtraError if viser is not installed."""
    with importing('viewer'):
        import viser  # noqa: F401


def check_address(host: str, port: int) -> None:
    """Raise ViewerError if no page can be served at an address; for port 0 any free one will do."""
    port = max(port, 0)  # the next free one is left to the server
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


def address_line(address: str, port: int = 0) -> str:
    """Return the line with which a viewer prints its address, after one if `port` was in use."""
    line = f'{_PREFIX}{address}'
    if port != NEXT_FREE or f':{USUAL_PORT}/' in address:
        return line
    return f'port {USUAL_PORT} is in use: the page takes the next free one\n{line}'


def address_in(line: str) -> str:
    """Return the address in a viewer's line; '' if it has none."""
    return line.removeprefix(_PREFIX) if line.startswith(f'{_PREFIX}http://') else ''


def url_authority(host: str, port: int) -> str:
    """Return host and port in URL notation."""
    return f'[{host}]:{port}' if ':' in host else f'{host}:{port}'


def _is_any_address(host: str) -> bool:
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


@dataclass(frozen=True)
class AccessPolicy:
    """Decides on requests by their headers and by the token in their address.

    Any web page open in a browser on this machine can send requests here. It can't forge two
    headers: ``Origin`` names the requesting page, ``Host`` the requested address. Since the name of
    a foreign page may point to this machine, too (DNS rebinding), only this machine's own names are
    accepted: `host`, which serves the page, and the host name `machine`. A page with the token,
    which has letters, digits, ``-`` and ``_``, may steer.
    """

    host: str
    machine: str = field(default_factory=socket.gethostname)
    token: str = field(default_factory=secrets.token_urlsafe)

    def address(self, port: int) -> str:
        """Return the page's address with the token."""
        name = self.machine if _is_any_address(self.host) else self.host
        return f'http://{url_authority(name, port)}/?token={self.token}'

    def allows(self, hosts: Sequence[str], origins: Sequence[str], at: tuple[str, int]) -> bool:
        """Return whether to answer a request that arrived `at` this local address and port.

        `hosts` and `origins` are its headers ``Host`` and, from a browser, ``Origin``.
        """
        if len(hosts) != 1:
            return False
        address, port = at
        names = {*LOOPBACK, self.host, address}
        if _is_any_address(self.host):
            names.add(self.machine)
        # Compare without port 80, which browsers omit.
        served = {url_authority(name.lower(), port).removesuffix(':80') for name in names}
        if hosts[0].lower().removesuffix(':80') not in served:
            return False
        return all(origin == f'http://{hosts[0]}' for origin in origins)

    def may_steer(self, target: str) -> bool:
        """Return whether a request for `target`, a path with its query, carries the token."""
        token = target.rpartition('token=')[2]
        return hmac.compare_digest(token.encode(errors='replace'), self.token.encode())

    def is_page(self, target: str) -> bool:
        """Return whether `target` is the page; viser's would run content that a query names."""
        return target == '/' or (target.startswith('/?token=') and self.may_steer(target))
