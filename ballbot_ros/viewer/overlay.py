"""The overlay on the scene: banner, transport bar, time line and stick."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import math
import queue
import time
from dataclasses import asdict, dataclass
from enum import Enum

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

_DRAWN = '{"drawn":true}'
_MAX_WAITING = 1000
"""Requests that wait at most; further ones are dropped, since nobody takes them."""


class _Client:
    """A connected page: the topics that it has not been sent yet."""

    def __init__(self, waiting: set[str]) -> None:
        self.waiting = waiting
        self.event = asyncio.Event()


MAX_HELD = 1.0
"""A stick at its end."""


class BannerKind(str, Enum):
    """What a banner is about; it determines the colour."""

    INFO = 'info'
    BUSY = 'busy'
    GOOD = 'good'
    BAD = 'bad'


class MarkKind(str, Enum):
    """Event that a mark on the time line stands for."""

    STATE = 'state'
    PUSH = 'push'
    HIT = 'hit'
    TONE = 'tone'
    PROPERTY = 'property'


@dataclass(frozen=True)
class Banner:
    """A notice above the scene, with a link if `link` is not empty; `details` are further lines."""

    text: str
    kind: BannerKind = BannerKind.INFO
    details: tuple[str, ...] = ()
    link: str = ''
    link_text: str = ''


@dataclass(frozen=True)
class Button:
    """A button of the transport bar.

    Attributes
    ----------
    name : str
        What :class:`Press` reports.
    label : str
        Text on the button; '' for a key without a button.
    key : str
        ``KeyboardEvent.key`` that presses it too, such as ``' '``; '' for none.
    tip : str
        What it does, for the tool tip.
    """

    name: str
    label: str
    key: str = ''
    tip: str = ''
    is_pressed: bool = False


@dataclass(frozen=True)
class Mark:
    """An event on the time line, at `time` [s]."""

    time: float
    kind: MarkKind
    text: str


_GROWTH_S = 10.0


@dataclass(frozen=True)
class Timeline:
    """A time line from 0 to `end` [s]."""

    end: float
    marks: tuple[Mark, ...] = ()

    @classmethod
    def reaching(
        cls, time: float, end: float = _GROWTH_S, marks: tuple[Mark, ...] = ()
    ) -> Timeline:
        """Return one that ends at `end`, or 10 s, 20 s ... later for a later `time` [s].

        A page draws a longer one again, so it does not grow with each tick.
        """
        return cls(end + math.ceil(max(0.0, time - end) / _GROWTH_S) * _GROWTH_S, marks)


@dataclass(frozen=True)
class OverlayState:
    """What the overlay shows, except for the position on the time line.

    Attributes
    ----------
    rates, rate : tuple of str, str
        The choices of speed, and the present one; '' for none of them.
    can_drive : bool
        Whether keys, stick and gamepad of the browser drive the robot.
    """

    banner: Banner | None = None
    buttons: tuple[Button, ...] = ()
    rates: tuple[str, ...] = ()
    rate: str = ''
    timeline: Timeline | None = None
    can_drive: bool = False


@dataclass(frozen=True)
class Press:
    """A button was pressed, by the pointer or its key."""

    name: str


@dataclass(frozen=True)
class ChooseRate:
    """A speed was chosen."""

    rate: str


@dataclass(frozen=True)
class Seek:
    """A time was chosen on the time line [s]."""

    time: float


@dataclass(frozen=True)
class Hold:
    """A page reports its stick: forward and rightward, each −1 ... 1, at `at_s` [s]."""

    page: int
    forward: float
    rightward: float
    at_s: float


Request = Press | ChooseRate | Seek | Hold


class Overlay:
    """Shows a state on all pages, and collects their requests.

    Pages get only what has changed, and a slow page skips values; only requests from pages with the
    token arrive. The server's event loop serves the connections; all other methods may be called
    from any thread.
    """

    def __init__(self) -> None:
        self._newest: dict[str, str] = {}
        self._clients: set[_Client] = set()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._drawn: set[_Client] = set()
        self._requests: queue.Queue[Request] = queue.Queue(_MAX_WAITING)
        self._numbers = itertools.count()
        self._state: OverlayState | None = None
        self._time = math.nan
        self.show(OverlayState())

    @property
    def is_drawn(self) -> bool:
        """Whether a connected page has drawn the robot, with or without the token."""
        return bool(self._drawn)

    def show(self, state: OverlayState) -> None:
        """Show a state."""
        if state != self._state:
            self._state = state
            self._publish('state', asdict(state))

    def move_playhead(self, time_s: float) -> None:
        """Move the position on the time line to `time_s` [s]."""
        if time_s != self._time:
            self._time = time_s
            self._publish('time', round(time_s, 3))

    def _publish(self, topic: str, value: object) -> None:
        """Send a JSON value to all pages, also to those that connect later."""
        self._newest[topic] = json.dumps({topic: value})
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # the server has ended
                self._loop.call_soon_threadsafe(self._wake, topic)

    def _wake(self, topic: str) -> None:
        for client in self._clients:
            client.waiting.add(topic)
            client.event.set()

    def take(self) -> list[Request]:
        """Return the requests since the last call, oldest first."""
        requests = []
        with contextlib.suppress(queue.Empty):
            while True:
                requests.append(self._requests.get_nowait())
        return requests

    async def serve(self, connection: ServerConnection, *, may_steer: bool) -> None:
        """Serve a page until it leaves; ignore its requests unless it `may_steer`."""
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
                elif (
                    may_steer
                    and isinstance(text, str)
                    and (request := parse_request(text, page, time.monotonic()))
                ):
                    with contextlib.suppress(queue.Full):
                        self._requests.put_nowait(request)
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


def parse_request(text: str, page: int, at_s: float) -> Request | None:
    """Return the request in a message; None if it has none, as from a foreign program.

    It arrived at `at_s` [s] by the connection with the number `page`.
    """
    try:
        content = json.loads(text, parse_int=float)
    except (ValueError, RecursionError):
        return None
    match content:
        case {'press': str(name)}:
            return Press(name)
        case {'rate': str(rate)}:
            return ChooseRate(rate)
        case {'seek': float(time)} if math.isfinite(time):
            return Seek(time)
        case {'forward': float(x), 'rightward': float(y)}:
            if all(abs(each) <= MAX_HELD for each in (x, y)):  # not if one is NaN
                return Hold(page, x, y, at_s)
    return None
