"""A gamepad that is read directly: found by its name, opened when connected, polled."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from threading import Event, Thread
from typing import NamedTuple, Protocol

from ballbot_ros.teleop.errors import TeleopError

ANY = 'any'
POLL_S = 0.008

NO_MAPPING = 'SDL has no mapping for it: set SDL_GAMECONTROLLERCONFIG'


class GamepadDevice(NamedTuple):
    """A connected device: number, name, and whether its layout is known."""

    number: int
    name: str
    has_mapping: bool


class GamepadState(NamedTuple):
    """Axes and buttons in the order of :class:`~ballbot_ros.teleop.joy_mapping.JoyMapping`."""

    axes: Sequence[float]
    buttons: Sequence[int]


class OpenGamepad(Protocol):
    """An open gamepad."""

    def attached(self) -> bool:
        """Return whether it is still connected."""

    def read(self) -> GamepadState:
        """Return its current state."""


class Backend(Protocol):
    """The library that reads gamepads; used from one thread only."""

    def start(self) -> None:
        """Start looking for devices."""

    def pump(self) -> None:
        """Process the events since the last call."""

    def devices(self) -> list[GamepadDevice]:
        """Return the connected devices."""

    def open(self, device: GamepadDevice) -> OpenGamepad:
        """Open a device that has a mapping; TeleopError if that fails."""

    def stop(self) -> None:
        """Close everything."""


class Gamepad:
    """Polls one gamepad on its own thread: ``any``, one by its number, or by a part of its name.

    Parameters
    ----------
    on_state : callable
        Receives the state at every poll.
    on_disconnected : callable
        Called when the gamepad is disconnected, and at the end.
    on_problem : callable
        Receives one line about a device that can't be used.
    """

    def __init__(
        self,
        wanted: str,
        backend: Backend,
        *,
        on_state: Callable[[GamepadState], None],
        on_disconnected: Callable[[], None],
        on_problem: Callable[[str], None],
    ) -> None:
        self._wanted = wanted
        self._backend = backend
        self._on_state, self._on_disconnected = on_state, on_disconnected
        self._on_problem = on_problem
        self._pad: OpenGamepad | None = None
        self._refused: set[GamepadDevice] = set()
        self.name = ''
        self._stop = Event()
        self._thread = Thread(target=self._run, name='gamepad', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._stop.set()
        self._thread.join(2.0)

    def _run(self) -> None:
        try:
            self._backend.start()
            while not self._stop.wait(POLL_S):
                self._backend.pump()
                self._poll()
        except TeleopError as error:
            self._on_problem(str(error))
        finally:
            self._on_disconnected()
            self._backend.stop()

    def _poll(self) -> None:
        if self._pad is not None and not self._pad.attached():
            self._pad, self.name = None, ''
            self._on_disconnected()
        if self._pad is None:
            self._scan()
        if self._pad is not None:
            self._on_state(self._pad.read())

    def _scan(self) -> None:
        present = self._backend.devices()
        self._refused.intersection_update(present)
        for device in present:
            if not self._is_wanted(device) or device in self._refused:
                continue
            try:
                if not device.has_mapping:
                    raise TeleopError(NO_MAPPING)
                self._pad = self._backend.open(device)
            except TeleopError as error:
                self._refused.add(device)
                self._on_problem(f'{device.name}: {error}')
                continue
            self.name = device.name
            return

    def _is_wanted(self, device: GamepadDevice) -> bool:
        if self._wanted.isdecimal():
            return device.number == int(self._wanted)
        return self._wanted == ANY or self._wanted.lower() in device.name.lower()
