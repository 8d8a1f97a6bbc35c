"""Who is let in to the page, and who may steer."""

from __future__ import annotations

import hmac
from collections.abc import Sequence
from dataclasses import dataclass

from ballbot_ros.viewer.address import LOOPBACK, is_any_address, location


@dataclass(frozen=True)
class AccessPolicy:
    """Decides on each request by what its browser tells, and by the token in its address.

    Every web page that is open in a browser of this machine can send requests here. No page can
    forge two headers: ``Origin`` names the page that sends, ``Host`` the address that it calls.
    The name of a foreign page may point to this machine, too (DNS rebinding), so only the names
    are let in that this machine is known by.

    Attributes
    ----------
    host : str
        Where the page is served.
    machine : str
        This machine's host name.
    token : str
        Of letters, digits, ``-`` and ``_``; whoever has it may steer.
    """

    host: str
    machine: str
    token: str

    def address(self, port: int) -> str:
        """Return the page's address for those who may steer."""
        name = self.machine if is_any_address(self.host) else self.host
        return f'http://{location(name, port)}/?token={self.token}'

    def allows(self, hosts: Sequence[str], origins: Sequence[str], at: tuple[str, int]) -> bool:
        """Tell whether a request may come in.

        Parameters
        ----------
        hosts, origins : sequence of str
            Values of its headers ``Host`` and ``Origin``; only browsers send the second.
        at : tuple
            Address and port of this machine that it has come to.
        """
        if len(hosts) != 1:
            return False
        address, port = at
        names = {*LOOPBACK, self.host, address}
        if is_any_address(self.host):
            names.add(self.machine)
        # Browsers leave out the port 80.
        served = {location(name.lower(), port).removesuffix(':80') for name in names}
        if hosts[0].lower().removesuffix(':80') not in served:
            return False
        return all(origin == f'http://{hosts[0]}' for origin in origins)

    def may_steer(self, target: str) -> bool:
        """Tell whether a request for `target`, a path with its query, ends in the token."""
        token = target.rpartition('token=')[2]
        return hmac.compare_digest(token.encode(errors='replace'), self.token.encode())

    def page(self, host: str, target: str) -> str:
        """Return the target that a browser is to ask for in place of `target`, which has a query.

        viser's page connects to where the query says, so nobody else may write it: the page would
        show, and run, what comes from there.

        Parameters
        ----------
        host : str
            Address and port under which the browser calls this machine.
        target : str
        """
        return f'/?websocket=ws://{host}/?token={self.token}' if self.may_steer(target) else '/'
