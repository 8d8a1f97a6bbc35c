"""Gamepads that are read directly: found by name, opened when connected, polled."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from threading import Event, Thread
from typing import Any, NamedTuple

from ballbot_ros.errors import TeleopError


class InputErrors:
    """The current error of each input.

    An error stays until its input works again and the error has been reported at least once. A
    single bad message among many good ones is therefore visible, and an input has one error at a
    time.
    """

    def __init__(self) -> None:
        self._texts: dict[str, str] = {}
        self._cleared: set[str] = set()

    def add(self, source: str, text: str) -> bool:
        """Store the newest error of a source; return whether the source had none before."""
        self._cleared.discard(source)
        is_first = source not in self._texts
        self._texts[source] = f'{source}: {text}'
        return is_first

    def clear(self, source: str) -> None:
        """Note that the source works again."""
        if source in self._texts:
            self._cleared.add(source)

    def remove_cleared(self) -> None:
        """Drop the errors of working sources, which have now been reported."""
        while self._cleared:
            self._texts.pop(self._cleared.pop(), None)

    def __str__(self) -> str:
        """Return all errors on one line."""
        return '; '.join(list(self._texts.values()))


ANY = 'any'
POLL_S = 0.008

NO_MAPPING = 'SDL has no mapping for it: set SDL_GAMECONTROLLERCONFIG'


class GamepadDevice(NamedTuple):
    """A connected device: number, name, and whether its layout is known."""

    number: int
    name: str
    has_mapping: bool


class GamepadState(NamedTuple):
    """Axes and buttons in the order of :class:`~ballbot_ros.nodes.teleop.sticks.JoyMapping`."""

    axes: Sequence[float]
    buttons: Sequence[int]


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
        backend: SdlBackend,
        *,
        on_state: Callable[[GamepadState], None],
        on_disconnected: Callable[[], None],
        on_problem: Callable[[str], None],
    ) -> None:
        self._wanted = wanted
        self._backend = backend
        self._on_state, self._on_disconnected = on_state, on_disconnected
        self._on_problem = on_problem
        self._pad: _SdlPad | None = None
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
        present = self._backend.devices
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


INSTALL_HINT = 'pygame not found: install it with `pip install "ballbot_ros[drive]"`'

_SETTINGS = {
    'SDL_VIDEODRIVER': 'dummy',
    'SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS': '1',
    # Leave the signals to the node.
    'SDL_NO_SIGNAL_HANDLERS': '1',
    'PYGAME_HIDE_SUPPORT_PROMPT': '1',
}
_FULL = 32767.0
_STICK_AXES = 4
_AXES = 6
_BUTTONS = 15


class SdlBackend:
    """Finds and reads gamepads with pygame; raises TeleopError if it is not installed.

    `devices` are those that are connected.
    """

    def __init__(self) -> None:
        os.environ.update(_SETTINGS)
        try:
            import pygame
            from pygame._sdl2 import controller
        except ImportError:
            raise TeleopError(INSTALL_HINT) from None
        self._pygame, self._controller = pygame, controller
        self.devices: list[GamepadDevice] = []

    def start(self) -> None:
        """Start looking for devices; everything else must happen on the same thread."""
        try:
            self._pygame.display.init()
            self._pygame.joystick.init()
            self._controller.init()
        except self._pygame.error as error:
            raise TeleopError(f'SDL failed to start: {error}') from None
        self._scan()

    def pump(self) -> None:
        """Let SDL read the devices, and detect new and removed ones."""
        events = self._pygame.event.get()
        changes = (self._pygame.JOYDEVICEADDED, self._pygame.JOYDEVICEREMOVED)
        if any(event.type in changes for event in events):
            self._scan()

    def _scan(self) -> None:
        devices = []
        for index in range(self._controller.get_count()):
            try:
                name = self._pygame.joystick.Joystick(index).get_name()
            except self._pygame.error:
                continue  # The device is gone again, or may not be read.
            devices.append(GamepadDevice(index, name, self._controller.is_controller(index)))
        self.devices = devices

    def open(self, device: GamepadDevice) -> _SdlPad:
        """Open a device that has a mapping; TeleopError if that fails."""
        try:
            return _SdlPad(self._controller.Controller(device.number))
        except self._pygame.error as error:
            raise TeleopError(str(error)) from None

    def stop(self) -> None:
        """Close everything."""
        self._controller.quit()
        self._pygame.joystick.quit()
        self._pygame.display.quit()


class _SdlPad:
    """An open gamepad; SDL counts right and down positive, joy left and up."""

    def __init__(self, controller: Any) -> None:
        self._controller = controller

    def attached(self) -> bool:
        return bool(self._controller.attached())

    def read(self) -> GamepadState:
        values = [max(-1.0, self._controller.get_axis(axis) / _FULL) for axis in range(_AXES)]
        axes = [*(-value for value in values[:_STICK_AXES]), *values[_STICK_AXES:]]
        return GamepadState(axes, [int(self._controller.get_button(b)) for b in range(_BUTTONS)])


SCAN_S = 0.3
"""Time for SDL to find all devices."""

REFRESH_S = 0.05


def list_devices() -> None:
    """Print the gamepads, one per line; on a terminal, show their input until Ctrl-C."""
    backend = SdlBackend()
    backend.start()
    try:
        devices = wait_for_devices(backend)
        print('\n'.join(describe(devices)))
        if any(device.has_mapping for device in devices) and sys.stdout.isatty():
            print('Move the sticks, press buttons; Ctrl-C ends.')
            _show_input(backend, devices)
    except KeyboardInterrupt:
        print()
    finally:
        backend.stop()


def wait_for_devices(backend: SdlBackend) -> list[GamepadDevice]:
    """Return the connected devices, after enough time to find them."""
    deadline = time.monotonic() + SCAN_S
    while not backend.devices and time.monotonic() < deadline:
        backend.pump()
        time.sleep(REFRESH_S)
    return backend.devices


def describe(devices: list[GamepadDevice]) -> list[str]:
    """Return a line for each device."""
    if not devices:
        return ['no gamepad found']
    return [
        f'{device.number}  {device.name}  {"mapping known" if device.has_mapping else NO_MAPPING}'
        for device in devices
    ]


def input_line(device: GamepadDevice, pad: _SdlPad) -> str:
    """Return the current input of a gamepad on one line."""
    if not pad.attached():
        return f'{device.number}  unplugged'
    state = pad.read()
    axes = ' '.join(f'{value:+.2f}' for value in state.axes)
    pressed = ' '.join(str(number) for number, on in enumerate(state.buttons) if on)
    return f'{device.number}  axes {axes}  buttons {pressed or "-"}'


def _show_input(backend: SdlBackend, devices: list[GamepadDevice]) -> None:
    pads = [(device, backend.open(device)) for device in devices if device.has_mapping]
    while True:
        backend.pump()
        lines = [input_line(device, pad) for device, pad in pads]
        print('\n'.join(f'\033[K{line}' for line in lines))
        time.sleep(REFRESH_S)
        print(f'\033[{len(lines)}A', end='')
