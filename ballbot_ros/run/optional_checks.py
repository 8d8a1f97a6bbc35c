"""Checks of what some commands need: browser, viewer, gamepads, compilers, emulator."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from ballbot_ros.codegen.toolchain import ARM, HOST, Target, missing_tool
from ballbot_ros.errors import BallbotError
from ballbot_ros.parameters import ParameterSet, ViewerParameters
from ballbot_ros.teleop.device_list import describe, wait_for_devices
from ballbot_ros.viewer.address import check_address, require_viser
from ballbot_ros.viewer.browser import browser_program


def _viewer() -> str:
    require_viser()
    parameters = ParameterSet().of(ViewerParameters)
    check_address(parameters.host, parameters.port)
    return f'{parameters.host} can serve the page'


def _gamepads() -> str:
    # Imported only here: it needs an optional package.
    from ballbot_ros.teleop.sdl import SdlBackend

    backend = SdlBackend()
    backend.start()
    try:
        return ', '.join(describe(wait_for_devices(backend)))
    finally:
        backend.stop()


def _compiler(target: Target) -> str:
    if reason := missing_tool(target):
        raise BallbotError(reason)
    return ' and '.join(dict.fromkeys(tool.command for tool in target.tools))


OPTIONAL_CHECKS: Mapping[str, Callable[[], str]] = {
    'viewer': _viewer,
    'browser': browser_program,
    'gamepads': _gamepads,
    'C': lambda: _compiler(HOST),
    'ARM': lambda: _compiler(ARM),
}
"""Checks by name. Each returns its findings, or raises BallbotError with what to do."""

NEEDED_FOR: Mapping[str, str] = {
    'viewer': 'run --viewer, drive --viewer, view',
    'browser': 'render',
    'gamepads': 'drive',
    'C': 'codegen --check, --controller c',
    'ARM': 'codegen --check, --controller arm',
}
"""The commands that need what a check finds."""
