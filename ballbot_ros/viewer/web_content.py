"""What the page's server delivers besides viser's own page."""

from __future__ import annotations

import gzip
from dataclasses import dataclass
from functools import cache
from html import escape
from http import HTTPStatus
from importlib.resources import files
from pathlib import Path

import viser
from websockets.datastructures import Headers
from websockets.http11 import Response

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


def html(document: bytes) -> Content:
    """Return an HTML document."""
    return Content(document, _TYPES['.html'])


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
