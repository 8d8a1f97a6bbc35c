"""Decides which requests the viewer answers, and which pages may steer."""

from __future__ import annotations

import hmac
import secrets
import socket
from collections.abc import Sequence
from dataclasses import dataclass, field

from ballbot_ros.viewer.address import LOOPBACK, is_any_address, url_authority


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
        name = self.machine if is_any_address(self.host) else self.host
        return f'http://{url_authority(name, port)}/?token={self.token}'

    def allows(self, hosts: Sequence[str], origins: Sequence[str], at: tuple[str, int]) -> bool:
        """Return whether to answer a request that arrived `at` this local address and port.

        `hosts` and `origins` are its headers ``Host`` and, from a browser, ``Origin``.
        """
        if len(hosts) != 1:
            return False
        address, port = at
        names = {*LOOPBACK, self.host, address}
        if is_any_address(self.host):
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
