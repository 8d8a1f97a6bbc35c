"""Requests the start of a run that is paused at its start."""

from __future__ import annotations

from std_srvs.srv import Trigger

from ballbot_ros.nodes.base import AnyNode
from ballbot_ros.parameters import PLANT

SEND_PERIOD_S = 0.1


class StartRequest:
    """Sends a request as soon as the plant can receive it."""

    def __init__(self, node: AnyNode) -> None:
        self._client = node.create_client(Trigger, f'{PLANT}/start')
        self._is_requested = False
        node.create_wall_timer(SEND_PERIOD_S, self._send)

    def request(self) -> None:
        """Request the start; may be called from any thread."""
        self._is_requested = True

    def _send(self) -> None:
        if self._is_requested and self._client.service_is_ready():
            self._is_requested = False
            self._client.call_async(Trigger.Request())
