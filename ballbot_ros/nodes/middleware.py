"""What the middleware is told before ROS begins in a process."""

from __future__ import annotations

import os
import re
import subprocess
import sys

from ballbot_ros.errors import BallbotError, one_line
from ballbot_ros.nodes.processes import END_WITH_PARENT
from ballbot_ros.nodes.shared_memory import clear_shared_memory
from ballbot_ros.share import share_directory

PROFILES = 'FASTRTPS_DEFAULT_PROFILES_FILE'
"""Environment variable: Fast DDS's profiles. Other middleware does not look at it."""

DISCOVERY_RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
DEFAULT_RMW = 'rmw_fastrtps_cpp'
DOMAIN = 'ROS_DOMAIN_ID'
LARGEST_DOMAIN = 232
"""Beyond it there are no ports, and the middleware ends the process."""


def ros_domain() -> int:
    """Return the number of the ROS domain.

    Raises
    ------
    BallbotError
        If the environment variable :data:`DOMAIN` is no number of a domain.
    """
    text = os.environ.get(DOMAIN) or '0'
    if not re.fullmatch('0|[1-9][0-9]{0,2}', text) or int(text) > LARGEST_DOMAIN:
        raise BallbotError(f'{DOMAIN}={text}: set a number within 0 … {LARGEST_DOMAIN}')
    return int(text)


def require_middleware() -> None:
    """Find out whether what ``RMW_IMPLEMENTATION`` names loads; else rcl ends this process.

    Raises
    ------
    BallbotError
        If it does not.
    """
    name = os.environ.get('RMW_IMPLEMENTATION', DEFAULT_RMW)
    if name in ('', DEFAULT_RMW):
        return
    script = 'import importlib.util as u; u.find_spec("rclpy") and __import__("rclpy")'
    if subprocess.run([sys.executable, '-c', script], capture_output=True, check=False).returncode:
        raise BallbotError(
            f'RMW_IMPLEMENTATION={name} does not load: install it, or unset the variable'
        )


def require_discovery() -> None:
    """Find out whether the environment lets nodes find each other.

    Raises
    ------
    BallbotError
        If it does not.
    """
    if os.environ.get(DISCOVERY_RANGE) == 'OFF':
        raise BallbotError(f'{DISCOVERY_RANGE}=OFF: no node finds another; unset it')


def prepare_middleware() -> None:
    """Clear what killed processes left, and have participants find each other soon.

    A command clears for the nodes that it starts.

    Raises
    ------
    BallbotError
        If there is no such ROS domain, or something that can't be cleared would hold up the node.
    """
    ros_domain()
    if END_WITH_PARENT not in os.environ:
        clear_shared_memory()
    use_profiles()


def use_profiles() -> None:
    """Have participants find each other soon, unless the user has profiles of their own."""
    os.environ.setdefault(PROFILES, str(share_directory() / 'config' / 'fastdds.xml'))


def start_failure(error: RuntimeError | UnicodeError) -> str:
    """Return what `rclpy.init` has raised, with what to do if there is no folder for logs."""
    hint = '; set ROS_LOG_DIR to a folder that can be written to' if 'log' in str(error) else ''
    return one_line(error) + hint
