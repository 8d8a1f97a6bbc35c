"""A scene in a headless browser, which draws exactly the frames that it is asked for."""

from __future__ import annotations

import base64
import io
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib.resources import files
from itertools import count
from typing import TYPE_CHECKING

import numpy as np
import PIL.Image
import viser
from numpy.typing import NDArray
from viser import _messages

from ballbot_ros.errors import ViewerError, one_line
from ballbot_ros.viewer.address import AccessPolicy
from ballbot_ros.viewer.browser import browser_page
from ballbot_ros.viewer.guarded_server import GuardedServer
from ballbot_ros.viewer.scene import Scene
from ballbot_ros.viewer.views import Camera

if TYPE_CHECKING:
    from playwright.sync_api import Page

HOST = '127.0.0.1'

_CONNECT_S = 60.0
_PICTURE_S = 60.0
_PNG = 'data:image/png;base64,'

Image = NDArray[np.uint8]
"""Shape (height, width, 3)."""


class OffscreenScene:
    """A scene that only one browser shows, and its pictures.

    The browser gets all messages in one queue, at the end of which is the number of the picture.
    The page draws once, when it has processed that number: a picture never shows an earlier state,
    and nothing is drawn in vain.
    """

    def __init__(self, browser: Page, client: viser.ClientHandle) -> None:
        self._browser = browser
        self._client = client
        self._numbers = count(1)
        self._frame = client.gui.add_html('')
        self.scene = Scene(client.scene)

    def picture(self, camera: Camera) -> Image:
        """Return a picture of the scene; ViewerError if the browser fails."""
        number = next(self._numbers)
        self._point(camera)
        self._frame.content = f'<p id="frame">{number}</p>'
        self._client.flush()
        url = self._browser.evaluate(f'takePicture({number}, {_PICTURE_S})')
        png = io.BytesIO(base64.b64decode(url.removeprefix(_PNG)))
        return np.asarray(PIL.Image.open(png).convert('RGB'))

    def _point(self, camera: Camera) -> None:
        """Point the camera.

        viser's attributes for this drop a value that the browser has reported; a report may be
        older than the last value.
        """
        for message in (
            _messages.SetCameraUpDirectionMessage(camera.up),
            _messages.SetCameraPositionMessage(camera.position),
            _messages.SetCameraLookAtMessage(camera.look_at),
            _messages.SetCameraFovMessage(camera.fov),
        ):
            self._client._websock_connection.queue_message(message)


@contextmanager
def offscreen_scene(width: int, height: int) -> Iterator[OffscreenScene]:
    """Open an empty scene, whose pictures have this size [px].

    Yields
    ------
    OffscreenScene

    Raises
    ------
    ViewerError
        Without Chromium or Playwright, or if the browser fails, also later.
    """
    policy = AccessPolicy(HOST)
    with browser_page(width, height) as browser, ExitStack() as stack:
        from playwright.sync_api import Error

        server = GuardedServer(policy, 0, '')
        stack.callback(server.stop)
        script = files('ballbot_ros.viewer').joinpath('assets', 'offscreen.js').read_text()
        try:
            browser.add_init_script(script)
            browser.goto(policy.address(server.get_port()))
            yield OffscreenScene(browser, _client(browser, server))
        except Error as error:
            raise ViewerError(f'the browser failed: {one_line(error)}') from None


def _client(browser: Page, server: GuardedServer) -> viser.ClientHandle:
    """Draw until the page has connected and reported its camera."""
    deadline = time.monotonic() + _CONNECT_S
    while time.monotonic() < deadline:
        browser.evaluate('drawFrame()')
        for client in server.get_clients().values():
            return client
        browser.wait_for_timeout(50)
    raise ViewerError(f'the browser did not show the page within {_CONNECT_S:g} s')
