"""Checks of this machine: what every command needs, and what only some need."""

from __future__ import annotations

import os
import platform
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path

from ballbot_ros.controllers.codegen.toolchain import ARM, HOST, Target, missing_tool
from ballbot_ros.engine.compilation import REMEDY, can_compile, has_kept_code
from ballbot_ros.engine.golden import arithmetic_sha256, duty_sha256, load_golden
from ballbot_ros.engine.scenario.reader import load_scenario
from ballbot_ros.errors import BallbotError
from ballbot_ros.files import share_directory
from ballbot_ros.nodes.discovery_probe import LIMIT_S
from ballbot_ros.nodes.middleware import (
    DISCOVERY_RANGE,
    DOMAIN,
    PORT_BASE,
    PORTS_PER_DOMAIN,
    RMW,
    own_profiles,
    require_discovery,
    require_middleware,
    ros_domain,
)
from ballbot_ros.nodes.processes import END_WITH_PARENT
from ballbot_ros.nodes.teleop.gamepad import SdlBackend, describe, wait_for_devices
from ballbot_ros.nodes.transports import rfcomm
from ballbot_ros.parameters import ParameterSet, ViewerParameters
from ballbot_ros.run.requirements import require_viewer
from ballbot_ros.viewer.browser import browser_program

MIN_PYTHON = (3, 10)
MIN_FREE_BYTES = 200e6
GOLDEN_SCENARIOS = ('stationary', 'hardware_autonomous')


def _python() -> str:
    if sys.version_info < MIN_PYTHON:
        raise BallbotError(f'{platform.python_version()} is too old: install Python 3.10 or later')
    return platform.python_version()


def _files() -> str:
    try:
        return str(share_directory())
    except BallbotError as error:
        raise BallbotError(f'{error}: reinstall the package') from None


def _rclpy() -> str:
    found = find_spec('rclpy')
    if found is None or found.origin is None:
        raise BallbotError(
            'rclpy not found: source ROS 2 Jazzy, or run `pip install "ballbot_ros[ros]"`'
        )
    return str(Path(found.origin).parent)


def _rmw() -> str:
    require_middleware()
    try:
        from rclpy.utilities import get_rmw_implementation_identifier

        profiles = own_profiles()
        suffix = f', with your profiles in {profiles}' if profiles else ''
        return f'{get_rmw_implementation_identifier()}{suffix}'
    except Exception as error:
        wanted = os.environ.get(RMW, '')
        hint = f'unset {RMW} ({wanted})' if wanted else 'install rmw_fastrtps_cpp'
        raise BallbotError(
            f'no middleware loads: {hint} ({" ".join(str(error).split())})'
        ) from None


def _domain() -> str:
    require_discovery()
    reach = os.environ.get(DISCOVERY_RANGE, 'not set: runs use LOCALHOST')
    return f'{DOMAIN} {ros_domain()}, {DISCOVERY_RANGE} {reach}'


def _ports() -> str:
    port = PORT_BASE + PORTS_PER_DOMAIN * ros_domain()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        # Participants share the multicast port of discovery; another program may not.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(('', port))
        except OSError as error:
            raise BallbotError(f'UDP {port}: {error.strerror}: use another ROS_DOMAIN_ID') from None
    return f'UDP {port} and above are free for discovery'


def _discovery() -> str:
    """Test discovery in a separate process, since the middleware can hang and ignore signals."""
    process = subprocess.Popen(
        [sys.executable, '-W', 'ignore', '-m', 'ballbot_ros.nodes.discovery_probe'],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        # The probe also ends with this process: an interrupt may arrive before `process` is
        # assigned.
        env={**os.environ, END_WITH_PARENT: str(os.getpid())},
    )  # fmt: skip
    try:
        output, _ = process.communicate()
    finally:
        # Wait for the killed process, too, which subprocess.run does not at an interrupt.
        process.kill()
        process.wait()
    if process.returncode == -signal.SIGALRM:
        raise BallbotError(
            f'the middleware did not respond within {LIMIT_S} s: try another {DOMAIN}'
        )
    if process.returncode:
        raise BallbotError(' '.join(output.split()) or f'ended with {process.returncode}')
    # The middleware may have logged something before, such as a port that is taken.
    return output.strip().rpartition('\n')[2]


def _arithmetic() -> str:
    """Compare hashes of the arithmetic, and of the duties in a linear and a nonlinear run."""
    golden = load_golden()
    results = [('the arithmetic', golden.arithmetic, arithmetic_sha256())]
    for name in GOLDEN_SCENARIOS:
        wanted = golden.scenarios.get(name, '')
        results.append((f'the scenario {name}', wanted, duty_sha256(load_scenario(name))))
    for what, wanted, got in results:
        if got != wanted:
            raise BallbotError(
                f'{what} has the hash {got[:8]}… here, but {wanted[:8]}… on other machines: '
                'their recordings will not replay as identical. Unless you edited config/, '
                'report this with your processor and your versions of Python and numpy'
            )
    return f'{" and ".join(GOLDEN_SCENARIOS)} have the same duty_sha256 as on every machine'


def _disk() -> str:
    folder = Path('runs') if Path('runs').is_dir() else Path()
    if not os.access(folder, os.W_OK):
        raise BallbotError(f'{folder.resolve()} is not writable: use --output DIR')
    free = shutil.disk_usage(folder).free
    if free < MIN_FREE_BYTES:
        raise BallbotError(f'{free / 1e6:.0f} MB free: a minute of recording takes about 6 MB')
    return f'{free / 1e9:.1f} GB free in {folder.resolve()}'


CHECKS: Mapping[str, Callable[[], str]] = {
    'Python': _python,
    'files': _files,
    'arithmetic': _arithmetic,
    'rclpy': _rclpy,
    'RMW': _rmw,
    'domain': _domain,
    'ports': _ports,
    'discovery': _discovery,
    'disk': _disk,
}
"""Checks by name. Each returns its findings, or raises BallbotError with what to do."""


def _viewer() -> str:
    parameters = ParameterSet()
    require_viewer(parameters)
    return f'{parameters.of(ViewerParameters).host} can serve the page'


def _gamepads() -> str:
    backend = SdlBackend()
    backend.start()
    try:
        return ', '.join(describe(wait_for_devices(backend)))
    finally:
        backend.stop()


def _bluetooth() -> str:
    """Look for an adapter, for sockets, and for serial devices that may not be opened."""
    adapters = rfcomm.describe_adapters()
    for device in sorted(Path('/dev').glob('rfcomm*')):
        if not os.access(device, os.R_OK | os.W_OK):
            raise BallbotError(f'{device}: permission denied: join its group, {device.group()}')
    rfcomm.require_sockets()
    return adapters


def _compiler(target: Target) -> str:
    if reason := missing_tool(target):
        raise BallbotError(reason)
    return ' and '.join(dict.fromkeys(tool.command for tool in target.tools))


def _compiled_code() -> str:
    if not can_compile():
        raise BallbotError(f'numba not found: {REMEDY}')
    state = 'ready' if has_kept_code() else 'compiled at their first use, in about 20 s'
    return f'compiled runs by numba: {state}'


OPTIONAL_CHECKS: Mapping[str, tuple[Callable[[], str], str]] = {
    'viewer': (_viewer, 'run --viewer, drive --viewer, view'),
    'browser': (browser_program, 'render'),
    'gamepads': (_gamepads, 'drive'),
    'Bluetooth': (_bluetooth, 'brick drive'),
    'C': (lambda: _compiler(HOST), 'codegen --check, --controller c, brick emulate'),
    'ARM': (lambda: _compiler(ARM), 'codegen --check, --controller arm'),
    'compiled': (_compiled_code, 'study'),
}
"""Such checks by name, and the commands that need what they find."""
