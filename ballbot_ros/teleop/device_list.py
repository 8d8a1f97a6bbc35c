"""Lists the gamepads, and shows their input."""

from __future__ import annotations

import sys
import time

from ballbot_ros.teleop.gamepad import NO_MAPPING, Backend, GamepadDevice, OpenGamepad
from ballbot_ros.teleop.sdl import SdlBackend

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


def wait_for_devices(backend: Backend) -> list[GamepadDevice]:
    """Return the connected devices, after enough time to find them."""
    deadline = time.monotonic() + SCAN_S
    while not backend.devices() and time.monotonic() < deadline:
        backend.pump()
        time.sleep(REFRESH_S)
    return backend.devices()


def describe(devices: list[GamepadDevice]) -> list[str]:
    """Return a line for each device."""
    if not devices:
        return ['no gamepad found']
    return [
        f'{device.number}  {device.name}  {"mapping known" if device.has_mapping else NO_MAPPING}'
        for device in devices
    ]


def input_line(device: GamepadDevice, pad: OpenGamepad) -> str:
    """Return the current input of a gamepad on one line."""
    if not pad.attached():
        return f'{device.number}  unplugged'
    state = pad.read()
    axes = ' '.join(f'{value:+.2f}' for value in state.axes)
    pressed = ' '.join(str(number) for number, on in enumerate(state.buttons) if on)
    return f'{device.number}  axes {axes}  buttons {pressed or "-"}'


def _show_input(backend: Backend, devices: list[GamepadDevice]) -> None:
    pads = [(device, backend.open(device)) for device in devices if device.has_mapping]
    while True:
        backend.pump()
        lines = [input_line(device, pad) for device, pad in pads]
        print('\n'.join(f'\033[K{line}' for line in lines))
        time.sleep(REFRESH_S)
        print(f'\033[{len(lines)}A', end='')
