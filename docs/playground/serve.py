"""Serves the page on this machine, and opens it in the browser, if there is one.

python docs/playground/serve.py FOLDER
"""

from __future__ import annotations

import functools
import sys
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

from ballbot_ros.cli.web_page import open_browser


class QuietHandler(SimpleHTTPRequestHandler):
    """Serves files and says nothing about it."""

    def log_message(self, format: str, *arguments: object) -> None:  # noqa: A002
        """Say nothing."""


def main() -> None:
    """Serve a folder until Ctrl-C."""
    handler = functools.partial(QuietHandler, directory=sys.argv[1])
    with ThreadingHTTPServer(('127.0.0.1', 0), handler) as server:
        address = f'http://127.0.0.1:{server.server_port}/'
        print(f'the robot in your browser: {address}  (Ctrl-C ends it)', flush=True)
        open_browser(address)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            print()


if __name__ == '__main__':
    main()
