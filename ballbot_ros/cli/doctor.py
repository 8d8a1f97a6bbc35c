"""`ballbot doctor`: is this machine ready? Each check says OK, or what to do."""

from __future__ import annotations

import os
import platform
import shutil
import socket
import sys
import time
import uuid
from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from ballbot_ros.errors import BallbotError
from ballbot_ros.nodes.middleware import prepare_middleware, ros_domain
from ballbot_ros.scenario.library import load_scenario
from ballbot_ros.share import share_directory
from ballbot_ros.simulation.golden import arithmetic_sha256, duty_sha256, load_golden

OLDEST_PYTHON = (3, 10)
LEAST_FREE_BYTES = 200e6
GOLDEN_SCENARIOS = ('stationary', 'hardware_autonomous')
DISCOVERY_S = 5.0
DDS_PORT_BASE, PORTS_PER_DOMAIN = 7400, 250


class _FailedCheckError(BallbotError):
    """A check that failed, and what to do."""


def examine() -> int:
    """Run every check; return 0 if all are OK, else 1."""
    console = Console(highlight=False)
    sick = False
    for name, check in _CHECKS.items():
        try:
            console.print(f'[green]OK  [/] {name:<10} {check()}', soft_wrap=True)
        except BallbotError as problem:
            sick = True
            console.print(f'[red]FAIL[/] {name:<10} {problem}', soft_wrap=True)
    return int(sick)


def _python() -> str:
    if sys.version_info < OLDEST_PYTHON:
        raise _FailedCheckError(
            f'{platform.python_version()} is too old: install Python 3.10 or later'
        )
    return platform.python_version()


def _files() -> str:
    try:
        return str(share_directory())
    except BallbotError as error:
        raise _FailedCheckError(f'{error}: install the package again') from None


def _rclpy() -> str:
    try:
        import rclpy
    except ImportError as error:
        raise _FailedCheckError(
            f'{error}: source ROS 2 Jazzy, or install "ballbot_ros[ros]"'
        ) from None
    return str(Path(rclpy.__file__).parent)


def _rmw() -> str:
    try:
        from rclpy.utilities import get_rmw_implementation_identifier

        return str(get_rmw_implementation_identifier())
    except Exception as error:
        wanted = os.environ.get('RMW_IMPLEMENTATION', '')
        hint = f'unset RMW_IMPLEMENTATION ({wanted})' if wanted else 'install rmw_fastrtps_cpp'
        raise _FailedCheckError(
            f'no middleware loads: {hint} ({" ".join(str(error).split())})'
        ) from None


def _domain() -> str:
    reach = os.environ.get('ROS_AUTOMATIC_DISCOVERY_RANGE', 'not set: runs use LOCALHOST')
    return f'ROS_DOMAIN_ID {ros_domain()}, ROS_AUTOMATIC_DISCOVERY_RANGE {reach}'


def _ports() -> str:
    port = DDS_PORT_BASE + PORTS_PER_DOMAIN * ros_domain()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        # Discovery shares its multicast port among participants; another program may not.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(('', port))
        except OSError as error:
            raise _FailedCheckError(
                f'UDP {port}: {error.strerror}: use another ROS_DOMAIN_ID'
            ) from None
    return f'UDP {port} and above are free for discovery'


def _discovery() -> str:
    """Send a message from one context of this process to another."""
    try:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from std_msgs.msg import String
    except ImportError as error:
        raise _FailedCheckError(str(error)) from None
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    prepare_middleware()
    token = uuid.uuid4().hex
    heard: list[float] = []
    contexts = [rclpy.Context(), rclpy.Context()]
    try:
        for context in contexts:
            rclpy.init(context=context)
        talker, listener = (
            rclpy.create_node(f'doctor_{token}_{index}', context=context)
            for index, context in enumerate(contexts)
        )
        topic = f'doctor_{token}'
        publisher = talker.create_publisher(String, topic, 1)
        listener.create_subscription(String, topic, lambda m: heard.append(time.monotonic()), 1)
        executor = SingleThreadedExecutor(context=contexts[1])
        executor.add_node(listener)
        begun = time.monotonic()
        while not heard and time.monotonic() - begun < DISCOVERY_S:
            publisher.publish(String())
            executor.spin_once(timeout_sec=0.05)
    except RuntimeError as error:
        raise _FailedCheckError(' '.join(str(error).split())) from None
    finally:
        for context in contexts:
            context.try_shutdown()
    if not heard:
        raise _FailedCheckError(
            f'no message within {DISCOVERY_S:g} s: allow UDP multicast on the loopback interface '
            '(firewall, container network)'
        )
    return f'a message went from one participant to another after {heard[0] - begun:.2f} s'


def _arithmetic() -> str:
    """Compare the arithmetic itself, and the duties of a linear and of a nonlinear run."""
    golden = load_golden()
    results = [('the arithmetic', golden.arithmetic, arithmetic_sha256())]
    for name in GOLDEN_SCENARIOS:
        wanted = golden.scenarios.get(name, '')
        results.append((f'the run {name}', wanted, duty_sha256(load_scenario(name))))
    for what, wanted, got in results:
        if got != wanted:
            raise _FailedCheckError(
                f'{what} has the hash {got[:8]}… here and {wanted[:8]}… elsewhere, so recordings '
                'of other machines will not replay as identical. Unless config/ was edited, '
                'report this with the processor and the versions of Python and numpy'
            )
    return f'{" and ".join(GOLDEN_SCENARIOS)} have the duty_sha256 of every machine'


def _disk() -> str:
    folder = Path('runs') if Path('runs').is_dir() else Path()
    if not os.access(folder, os.W_OK):
        raise _FailedCheckError(f'{folder.resolve()} is not writable: go elsewhere or use --output')
    free = shutil.disk_usage(folder).free
    if free < LEAST_FREE_BYTES:
        raise _FailedCheckError(f'{free / 1e6:.0f} MB free: a minute of recording takes about 6 MB')
    return f'{free / 1e9:.1f} GB free in {folder.resolve()}'


_CHECKS: dict[str, Callable[[], str]] = {
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
