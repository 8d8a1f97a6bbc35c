"""The connection between the overlays of all pages and the program."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import queue
import time
from typing import Any, NamedTuple

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

_DRAWN = '{"drawn":true}'
_MAX_WAITING = 1000
"""Requests that wait at most; further ones are dropped, since nobody takes them."""


class PageMessage(NamedTuple):
    """A message from a page, with the number of its connection and its time of arrival [s]."""

    page: int
    text: str
    at_s: float


class _Client:
    """A connected page: the topics that it has not been sent yet."""

    def __init__(self, waiting: set[str]) -> None:
        self.waiting = waiting
        self.event = asyncio.Event()


class PageLink:
    """Sends the newest value of each topic to all pages, and queues their messages.

    A slow page skips values. The server's event loop serves the connections; all other methods may
    be called from any thread.
    """

    def __init__(self) -> None:
        self._newest: dict[str, str] = {}
        self._clients: set[_Client] = set()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._drawn: set[_Client] = set()
        self._messages: queue.Queue[PageMessage] = queue.Queue(_MAX_WAITING)
        self._numbers = itertools.count()

    @property
    def is_drawn(self) -> bool:
        """Whether a connected page has drawn the robot."""
        return bool(self._drawn)

    def publish(self, topic: str, value: Any) -> None:
        """Send a JSON value to all pages, also to those that connect later."""
        self._newest[topic] = json.dumps({topic: value})
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # the server has ended
                self._loop.call_soon_threadsafe(self._wake, topic)

    def _wake(self, topic: str) -> None:
        for client in self._clients:
            client.waiting.add(topic)
            client.event.set()

    def take(self) -> list[PageMessage]:
        """Return the messages since the last call."""
        messages = []
        with contextlib.suppress(queue.Empty):
            while True:
                messages.append(self._messages.get_nowait())
        return messages

    async def serve(self, connection: ServerConnection, *, may_steer: bool) -> None:
        """Serve a page until it leaves; ignore its messages unless it `may_steer`."""
        self._loop = asyncio.get_running_loop()
        client = _Client(set(self._newest))
        client.event.set()
        self._clients.add(client)
        sender = asyncio.create_task(self._send(connection, client, may_steer=may_steer))
        page = next(self._numbers)
        try:
            async for text in connection:
                if text == _DRAWN:
                    self._drawn.add(client)
                elif may_steer and isinstance(text, str):
                    with contextlib.suppress(queue.Full):
                        self._messages.put_nowait(PageMessage(page, text, time.monotonic()))
        finally:
            self._clients.discard(client)
            self._drawn.discard(client)
            sender.cancel()
            await asyncio.gather(sender, return_exceptions=True)

    async def _send(
        self, connection: ServerConnection, client: _Client, *, may_steer: bool
    ) -> None:
        with contextlib.suppress(ConnectionClosed):
            await connection.send(json.dumps({'may_steer': may_steer}))
            while True:
                await client.event.wait()
                client.event.clear()
                while client.waiting:
                    await connection.send(self._newest[client.waiting.pop()])
