"""Opening a page in the user's browser."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from threading import Thread

_PROGRAM = 'import sys, webbrowser; webbrowser.open(sys.argv[1])'


def has_browser(environment: Mapping[str, str], platform: str) -> bool:
    """Return whether there is a browser with windows: a desktop, or the user's ``BROWSER``."""
    names = ('BROWSER', 'DISPLAY', 'WAYLAND_DISPLAY')
    return platform == 'darwin' or any(environment.get(name) for name in names)


def open_browser(address: str) -> None:
    """Open a page in the browser, if there is one; return at once, and report no failure."""
    if has_browser(os.environ, sys.platform):
        Thread(target=_open, args=(address,), name='browser', daemon=True).start()


def _open(address: str) -> None:
    # Without TERM and a terminal, no text browser can take over the terminal.
    environment = {name: value for name, value in os.environ.items() if name != 'TERM'}
    with suppress(OSError):
        subprocess.run(
            [sys.executable, '-I', '-c', _PROGRAM, address],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            check=False,
        )
