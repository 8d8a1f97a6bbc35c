"""Gamepads through SDL, whose database knows the layout of most gamepads."""

from __future__ import annotations

import os
from typing import Any

from ballbot_ros.teleop.errors import TeleopError
from ballbot_ros.teleop.gamepad import GamepadDevice, GamepadState

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
    """Finds and reads gamepads with pygame; raises TeleopError if it is not installed."""

    def __init__(self) -> None:
        os.environ.update(_SETTINGS)
        try:
            import pygame
            from pygame._sdl2 import controller
        except ImportError:
            raise TeleopError(INSTALL_HINT) from None
        self._pygame, self._controller = pygame, controller
        self._devices: list[GamepadDevice] = []

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
        self._devices = devices

    def devices(self) -> list[GamepadDevice]:
        """Return the connected devices."""
        return self._devices

    def open(self, device: GamepadDevice) -> _SdlPad:
        """Open a device that has a mapping."""
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
