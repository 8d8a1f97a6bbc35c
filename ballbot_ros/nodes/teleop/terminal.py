"""Driving from the keyboard of a terminal: reads keys and shows a small panel."""

from __future__ import annotations

import asyncio
import math
import os
import re
import select
import signal
import sys
import termios
import time
import tty
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any

from ballbot_ros.errors import TeleopError
from ballbot_ros.nodes.teleop.sticks import KEYBOARD, Arbiter
from ballbot_ros.robot.brick.bluetooth import Sticks
from ballbot_ros.robot.brick.sensors import quantise

if TYPE_CHECKING:
    from prompt_toolkit.application import Application

STDIN = 0


def can_read_keys() -> bool:
    """Return whether standard input is a terminal, and this process in its foreground."""
    try:
        return os.tcgetpgrp(STDIN) == os.getpgrp()
    except OSError:
        return False


class KeyPress:
    """Calls `on_key` on its own thread when a key is pressed for the first time.

    Until then or until it is closed, the terminal shows no keys that are typed; Ctrl-C remains.
    Nothing happens without a terminal.
    """

    def __init__(self, on_key: Callable[[], None]) -> None:
        self._on_key = on_key
        self._lock = Lock()
        self._modes: list[Any] | None = None
        self._end, self._end_side = os.pipe()
        self._thread = Thread(target=self._wait, name='key press', daemon=True)
        if can_read_keys():
            self._modes = termios.tcgetattr(STDIN)
            # Not the default, which would drop a key that was pressed a moment before.
            tty.setcbreak(STDIN, termios.TCSADRAIN)
            self._thread.start()

    def _wait(self) -> None:
        readable, _, _ = select.select([STDIN, self._end], [], [])
        if self._end in readable:
            return
        with suppress(OSError):  # the terminal has disappeared
            if os.read(STDIN, 1024):
                self._on_key()
        self._restore()

    def _restore(self) -> None:
        with self._lock, suppress(termios.error):
            if self._modes is not None:
                termios.tcsetattr(STDIN, termios.TCSADRAIN, self._modes)
            self._modes = None

    def close(self) -> None:
        """Stop waiting, and restore the terminal."""
        if self._end_side < 0:
            return
        os.close(self._end_side)
        self._end_side = -1
        if self._thread.is_alive():
            self._thread.join()
        os.close(self._end)
        self._restore()


HELD_S = 0.5
"""Time for which a key counts as held after its last repetition."""

SPEED_STEP_PERCENT = 10

_ARROWS = {'up': (0, -1), 'down': (0, 1), 'left': (1, -1), 'right': (1, 1)}
"""The stick that each arrow moves, and its sign."""


class KeyboardSticks:
    """The sticks that the arrow keys move, by `speed_percent` of a full stick (``gp_max``).

    Arrows for different sticks combine to a diagonal while both count as held. All times are from
    one monotonic clock [s].
    """

    def __init__(self, full: int) -> None:
        self.full = full
        self.speed_percent = 50
        self._signs = [0, 0]
        self._until = [-math.inf, -math.inf]

    @property
    def holds(self) -> bool:
        """Whether the current direction is held without a key."""
        return math.inf in self._until

    def arrow(self, name: str, now_s: float) -> None:
        """Process an arrow key: ``up``, ``down``, ``left`` or ``right``."""
        if self.holds:
            self.stop()
        stick, sign = _ARROWS[name]
        self._signs[stick], self._until[stick] = sign, now_s + HELD_S

    def hold(self, now_s: float) -> None:
        """Hold the current direction until the next arrow or :meth:`stop`."""
        self._until = [math.inf if now_s <= until else until for until in self._until]

    def stop(self) -> None:
        """Return the sticks to neutral."""
        self._signs = [0, 0]
        self._until = [-math.inf, -math.inf]

    def change_speed(self, steps: int) -> None:
        """Change the share of the full stick for a key by `steps`, within one step ... full."""
        speed = self.speed_percent + steps * SPEED_STEP_PERCENT
        self.speed_percent = min(100, max(SPEED_STEP_PERCENT, speed))

    def sticks(self, now_s: float) -> Sticks:
        """Return the sticks at `now_s`."""
        value = quantise(self.full * self.speed_percent / 100)
        vertical, horizontal = (
            sign * value if now_s <= until else 0
            for sign, until in zip(self._signs, self._until, strict=True)
        )
        return vertical, horizontal


_INFO = re.compile(r'\[INFO\] \[[^]]*\] \[([^]]*)\]: (.*)')


def info_message(line: str) -> str:
    """Return node and text of a line of level INFO, which passes; '' for all other lines."""
    found = _INFO.fullmatch(line.strip())
    return f'{found[1]}: {found[2]}' if found else ''


INSTALL_HINT = 'prompt_toolkit not found: install it with `pip install "ballbot_ros[drive]"`'

HELP = 'arrows or w a s d drive   space stop   h hold   + - key speed   {}q quit'
RESET_HELP = 'r reset   '
_ARROW_KEYS = {'up': 'up w W', 'left': 'left a A', 'down': 'down s S', 'right': 'right d D'}
"""The keys of each direction."""

_MESSAGES = 2

REPORT_S = 0.02
REDRAW_S = 0.1


def keyboard_unavailable_reason() -> str:
    """Return why the keyboard can't drive here; empty if it can."""
    if not (os.isatty(0) and os.isatty(1)):
        return 'standard input and output are not a terminal'
    try:
        import prompt_toolkit  # noqa: F401
    except ImportError:
        return INSTALL_HINT
    return ''


class Terminal:
    """Drives from the keyboard, on its own thread, until the terminal disappears (`is_closed`).

    While it runs, other output of the process to the terminal appears above the panel; only the
    newest lines of level INFO are shown, in the panel, so that they do not pile up. At the end the
    terminal is restored. It raises TeleopError if there is no terminal, or prompt_toolkit is not
    installed.

    Parameters
    ----------
    sources : Arbiter
        Gets the sticks, 50 times a second.
    command : callable
        Returns the input in command, and its sticks.
    lines : callable
        Returns what the panel shows above them, as names and texts.
    on_quit : callable
        Called for the quit key.
    on_reset : callable or None
        Called for the reset key; None if the robot has no reset.

    Attributes
    ----------
    on_key : callable
        Called for every key, on the keyboard's thread.
    """

    def __init__(
        self,
        keys: KeyboardSticks,
        sources: Arbiter,
        command: Callable[[], tuple[str, Sticks]],
        lines: Callable[[], Mapping[str, str]],
        *,
        on_quit: Callable[[], None],
        on_reset: Callable[[], None] | None = None,
    ) -> None:
        if obstacle := keyboard_unavailable_reason():
            raise TeleopError(f'keyboard: {obstacle}')
        # Ignore SIGHUP: a node that loses its terminal loses an input, but must not end.
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        self.keys, self._sources = keys, sources
        self._command, self._lines = command, lines
        self._on_quit, self._on_reset = on_quit, on_reset
        self.on_key: Callable[[], None] = lambda: None
        self.is_closed = False
        self._app: Application[None] | None = None
        self._messages: deque[str] = deque(maxlen=_MESSAGES)
        self._thread = Thread(target=self._run, name='keyboard', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread and restore the terminal."""
        app = self._app
        if app is not None and app.loop is not None and app.is_running:
            app.loop.call_soon_threadsafe(_exit, app)
        self._thread.join(1.0)

    def _run(self) -> None:
        try:
            with _Redirected() as others:
                self._app = self._application(others.terminal)

                def begin() -> None:
                    assert self._app is not None
                    self._app.create_background_task(self._report())
                    self._app.create_background_task(self._show_output(others))

                self._app.run(pre_run=begin, handle_sigint=False, set_exception_handler=False)
        except (EOFError, OSError, termios.error):
            pass  # The terminal has disappeared.
        finally:
            self._sources.release(KEYBOARD)
            self.is_closed = True

    def _application(self, terminal: Any) -> Application[None]:
        from prompt_toolkit.application import Application
        from prompt_toolkit.input import create_input
        from prompt_toolkit.layout import FormattedTextControl, Layout, Window
        from prompt_toolkit.output.vt100 import Vt100_Output

        class Output(Vt100_Output):
            def flush(self) -> None:
                # Ignore errors: the end of the input shows that the terminal has disappeared, and
                # an error here, in the middle of a line above the panel, would make the
                # application wait for the line forever.
                with suppress(OSError):
                    super().flush()

        output = Output.from_pty(terminal)
        output.enable_cpr = False  # The panel needs no cursor position; a query would show.
        return Application(
            layout=Layout(
                Window(FormattedTextControl(self._panel), dont_extend_height=True, wrap_lines=True)
            ),
            key_bindings=self._bindings(),
            input=create_input(sys.stdin),
            output=output,
            refresh_interval=REDRAW_S,
            erase_when_done=True,
        )

    def _bindings(self) -> Any:
        from prompt_toolkit.key_binding import KeyBindings

        keys, bindings = self.keys, KeyBindings()

        def bind(names: str, act: Callable[[], None]) -> None:
            def handle(_: object) -> None:
                self.on_key()
                act()

            for name in names.split():
                bindings.add(name)(handle)

        for name, names in _ARROW_KEYS.items():
            bind(names, lambda name=name: keys.arrow(name, time.monotonic()))  # type: ignore[misc]
        bind('space', keys.stop)
        bind('h H', lambda: keys.hold(time.monotonic()))
        bind('+ =', lambda: keys.change_speed(1))
        bind('-', lambda: keys.change_speed(-1))
        if on_reset := self._on_reset:
            bind('r R', lambda: self._reset(on_reset))
        bind('q Q c-c', self._quit)

        @bindings.add('<any>')
        def _(event: object) -> None:
            self.on_key()
            self._messages.append(f'key {_key_name(event)} does nothing')

        return bindings

    def _reset(self, on_reset: Callable[[], None]) -> None:
        self.keys.stop()
        on_reset()

    def _quit(self) -> None:
        self.keys.stop()
        assert self._app is not None
        _exit(self._app)
        self._on_quit()

    async def _report(self) -> None:
        while True:
            now_s = time.monotonic()
            self._sources.report(KEYBOARD, self.keys.sticks(now_s), now_s)
            await asyncio.sleep(REPORT_S)

    def _panel(self) -> str:
        source, (vertical, horizontal) = self._command()
        shown = {
            **self._lines(),
            'in command': source,
            # The document's vertical stick is negative forward.
            'sticks': f'forward {-vertical:+d}   rightward {horizontal:+d}',
            'key speed': f'{self.keys.speed_percent} %{"  held" * self.keys.holds}',
        }
        lines = [f'{name:<11} {text}' for name, text in shown.items()]
        known = HELP.format(RESET_HELP * (self._on_reset is not None))
        return '\n'.join([*lines, known, *self._messages])

    async def _show_output(self, others: _Redirected) -> None:
        """Show other output to the terminal above the panel, or briefly in it."""
        from prompt_toolkit.application import run_in_terminal

        reader = asyncio.StreamReader()
        loop = asyncio.get_running_loop()
        await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), others.pipe)
        while text := await reader.readline():
            if message := info_message(text.decode(errors='replace')):
                self._messages.append(message)
            else:
                await run_in_terminal(lambda: others.show(text))


def _exit(app: Application[None]) -> None:
    if app.is_running and app.future is not None and not app.future.done():
        app.exit()


def _key_name(event: Any) -> str:
    """Return a key as the user knows it."""
    key = event.key_sequence[0].key
    return repr(key) if len(key) == 1 else str(getattr(key, 'value', key))


class _Redirected:
    """Captures the process's output, except the panel, to the terminal: `pipe` has the output."""

    def __enter__(self) -> _Redirected:
        sys.stdout.flush()
        self._kept = {fd: os.dup(fd) for fd in (1, 2) if os.isatty(fd)}
        self.terminal = os.fdopen(os.dup(1), 'w', encoding='utf-8')
        end, begin = os.pipe()
        self.pipe = os.fdopen(end, 'rb', buffering=0)
        self._left = os.dup(end)
        for fd in self._kept:
            os.dup2(begin, fd)
        os.close(begin)
        return self

    def __exit__(self, *error: object) -> None:
        for fd, kept in self._kept.items():
            os.dup2(kept, fd)
            os.close(kept)
        os.set_blocking(self._left, False)
        with suppress(OSError):  # Nothing is left, or the terminal has disappeared.
            self.show(os.read(self._left, 2**16))
        os.close(self._left)
        with suppress(OSError):
            self.terminal.close()

    def show(self, text: bytes) -> None:
        """Write to the terminal."""
        self.terminal.write(text.decode(errors='replace'))
        self.terminal.flush()
