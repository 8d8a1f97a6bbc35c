"""How the page of a run is opened in the user's browser, and how the run begins."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from threading import Thread

from ballbot_ros.run.observer import RunObserver
from ballbot_ros.viewer.address import address_in

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


@dataclass(frozen=True)
class PageOptions:
    """Whether to open the page in a browser, and whether the run waits for a page or a key."""

    opens_browser: bool = True
    waits: bool = True


class PageOpening:
    """Shows the lines of a viewer; opens its page, and says what the run waits for.

    With `can_press_key`, a key in the terminal begins the run, too.
    """

    def __init__(
        self, options: PageOptions, show: Callable[[str], None], *, can_press_key: bool
    ) -> None:
        self._options, self._show, self._can_press_key = options, show, can_press_key
        self.address = ''

    def on_line(self, line: str) -> None:
        """Show a line; if it has the address of the page, open the page."""
        self._show(line)
        address = address_in(line)
        if not address:
            return
        if self._options.opens_browser:
            open_browser(address)
        if self._options.waits:
            otherwise = 'press a key' if self._can_press_key else 'use --no-wait'
            self._show(f'the run begins when its page is open: open the address, or {otherwise}')
        self.address = address


class PageObserver:
    """The observer of a run that has a viewer among its nodes."""

    def __init__(self, observer: RunObserver, opening: PageOpening) -> None:
        self.update = observer.update
        self.notice = opening.on_line
