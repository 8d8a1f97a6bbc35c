"""viser's server with access control, the overlay and documents of our own."""

from __future__ import annotations

import asyncio
import gzip
import io
import logging
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from functools import cache
from html import escape
from http import HTTPStatus
from importlib.resources import files
from pathlib import Path
from typing import Any

import viser
import websockets.asyncio.server
from viser.infra import ClientId, Message, _infra
from viser.infra._async_message_buffer import AsyncMessageBuffer
from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from ballbot_ros.errors import ViewerError, one_line
from ballbot_ros.viewer.address import AccessPolicy
from ballbot_ros.viewer.overlay import Overlay

ASSETS = '/assets/'
_TYPES = {
    '.css': 'text/css; charset=utf-8',
    '.html': 'text/html; charset=utf-8',
    '.js': 'text/javascript; charset=utf-8',
    '.svg': 'image/svg+xml',
}
_HEAD = """<head>
    <link rel="icon" href="/assets/icon.svg" type="image/svg+xml" />
    <link rel="stylesheet" href="/assets/page.css" />
    <script src="/assets/start.js"></script>
    <script type="module" src="/assets/page.js"></script>"""


@dataclass(frozen=True)
class Content:
    """A document and its media type."""

    data: bytes
    media_type: str
    encoding: str = 'identity'

    def response(self) -> Response:
        """Return the response to a request for it."""
        headers = Headers()
        headers['Content-Type'] = self.media_type
        headers['Content-Encoding'] = self.encoding
        headers['Content-Length'] = str(len(self.data))
        headers['Cache-Control'] = 'no-cache'
        return Response(HTTPStatus.OK, 'OK', headers, self.data)


@cache
def asset(name: str) -> Content | None:
    """Return a file of the overlay; None if there is none of that name."""
    found = {each.name: each for each in files('ballbot_ros.viewer').joinpath('assets').iterdir()}
    media_type = _TYPES.get(Path(name).suffix)
    if name not in found or media_type is None:
        return None
    return Content(found[name].read_bytes(), media_type)


@cache
def index(title: str) -> Content:
    """Return viser's page with our title and icon, and the overlay."""
    page = (Path(viser.__file__).parent / 'client' / 'build' / 'index.html').read_text()
    icon_at = page.index('<link')
    icon = page[icon_at : page.index('/>', icon_at) + 2]
    for old, new in (
        (icon, ''),
        ('<head>', _HEAD),
        ('<title>Viser</title>', f'<title>{escape(title)}</title>'),
    ):
        page = page.replace(old, new, 1)
    return Content(gzip.compress(page.encode()), _TYPES['.html'], 'gzip')


ANSWER_S = 600.0
"""Time limit for a request and its answer [s]: the report of a long run takes some time."""

LINK = '/link'
"""Path of the overlay's connection."""

_log = logging.getLogger('ballbot_ros.viewer')
_REFUSAL = 'The viewer only answers at the address that it has printed.\n'

Answer = Callable[[ServerConnection, Request], Awaitable[Response | None] | Response | None]
Handler = Callable[[ServerConnection], Awaitable[None]]


class _OneLine(logging.Filter):
    """Shortens errors to one line: invalid input from a browser is not a fault of the program."""

    def filter(self, record: logging.LogRecord) -> bool:
        if record.exc_info and record.exc_info[1]:
            record.msg = f'viewer: {record.getMessage()}: {one_line(record.exc_info[1])}'
            record.args, record.exc_info = (), None
        return True


_log.addFilter(_OneLine())


class _LoopEvent(asyncio.Event):
    """An event that is only set in its event loop.

    viser also sets it directly in the thread that queues a message. That would wake waiters from
    outside their loop, and raise an error if a waiter is removed at that moment.
    """

    def set(self) -> None:
        """Wake the waiters, if called in the loop."""
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            return
        super().set()


class _MessageBuffer(AsyncMessageBuffer):
    """viser's queue of messages to browsers, made safe for several threads."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.message_event = _LoopEvent()


_infra.AsyncMessageBuffer = _MessageBuffer  # type: ignore[attr-defined]


class GuardedServer(viser.ViserServer):
    """Answers the requests that a policy allows, and lets pages with its token steer.

    viser has no hooks for this, so internals are replaced: its call of ``serve`` gets other
    handlers of requests and connections, and messages about shared elements pass a check. Messages
    about a browser's own state, such as its camera, are not affected. The message queues are
    replaced by thread-safe ones. It raises ViewerError if another version of viser starts its
    server differently.
    """

    def __init__(self, policy: AccessPolicy, port: int, title: str) -> None:
        self._policy = policy
        self._title = title
        self.overlay = Overlay()
        self._documents: dict[str, Callable[[], bytes]] = {}
        self._is_guarded = False
        with _instead_of_serve(self._serve), redirect_stdout(io.StringIO()):  # viser's greeting
            super().__init__(policy.host, port, label=title, verbose=False)
        buffer = self._websock_server._broadcast_buffer
        if not (self._is_guarded and isinstance(buffer, _MessageBuffer)):
            self.stop()
            raise ViewerError(
                f'access control does not support viser {viser.__version__}: install viser 1.1'
            )

    def stop(self) -> None:
        """Stop the server, without a message."""
        with redirect_stdout(io.StringIO()):
            super().stop()

    def may_steer(self, client_id: int) -> bool:
        """Return whether a browser has the token."""
        connection = self._websock_server._live_connections.get(client_id)
        if connection is None or connection.request is None:
            return False
        return self._policy.may_steer(connection.request.path)

    def serve_document(self, path: str, make: Callable[[], bytes]) -> None:
        """Serve an HTML document, which `make` returns in a worker thread for each request."""
        self._documents[path] = make

    def _serve(
        self, handler: Handler, *arguments: Any, process_request: Answer, **options: Any
    ) -> serve:
        """Start the server as viser does, but refuse requests that the policy does not allow."""
        dispatch = self._websock_server._handle_incoming_message

        async def dispatch_steering(client_id: ClientId, message: Message) -> None:
            if self.may_steer(client_id):
                await dispatch(client_id, message)

        self._websock_server._handle_incoming_message = dispatch_steering  # type: ignore[method-assign]

        def answer(
            connection: ServerConnection, request: Request
        ) -> Awaitable[Response | None] | Response | None:
            return self._answer(connection, request) or process_request(connection, request)

        async def handle(connection: ServerConnection) -> None:
            request = connection.request
            if request is not None and _path(request) == LINK:
                may_steer = self._policy.may_steer(request.path)
                await self.overlay.serve(connection, may_steer=may_steer)
            else:
                await handler(connection)

        self._is_guarded = True
        options |= {'process_request': answer, 'open_timeout': ANSWER_S, 'logger': _log}
        return serve(handle, *arguments, **options)

    def _answer(
        self, connection: ServerConnection, request: Request
    ) -> Awaitable[Response] | Response | None:
        """Return the answer to a request that viser must not handle, else None."""
        hosts = request.headers.get_all('Host')
        origins = request.headers.get_all('Origin')
        address, port = connection.local_address[:2]
        if not self._policy.allows(hosts, origins, (address, port)):
            return connection.respond(HTTPStatus.FORBIDDEN, _REFUSAL)
        if 'Upgrade' in request.headers:
            return None
        path = _path(request)
        if path in self._documents:
            return self._make(self._documents[path])
        if path.startswith(ASSETS):
            content = asset(path.removeprefix(ASSETS))
            return content.response() if content else connection.respond(HTTPStatus.NOT_FOUND, '')
        if self._policy.is_page(request.path):
            return index(self._title).response()
        if '?' not in request.path:
            return None
        response = connection.respond(HTTPStatus.FOUND, '')
        response.headers['Location'] = '/'
        return response

    @staticmethod
    async def _make(make: Callable[[], bytes]) -> Response:
        return Content(await asyncio.to_thread(make), _TYPES['.html']).response()


def _path(request: Request) -> str:
    return request.path.partition('?')[0]


@contextmanager
def _instead_of_serve(replacement: Callable[..., serve]) -> Iterator[None]:
    module: Any = websockets.asyncio.server
    module.serve = replacement
    try:
        yield
    finally:
        module.serve = serve
