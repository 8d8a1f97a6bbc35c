"""What the middleware is told before ROS begins in a process."""

from __future__ import annotations

import os

from ballbot_ros.errors import BallbotError
from ballbot_ros.share import share_directory

PROFILES = 'FASTRTPS_DEFAULT_PROFILES_FILE'
"""Environment variable: Fast DDS's profiles. Other middleware does not look at it."""

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
"""Environment variable: how far nodes look for each other."""

LOCALHOST = 'LOCALHOST'
STATIC_PEERS = 'ROS_STATIC_PEERS'
MIDDLEWARE = 'RMW_IMPLEMENTATION'

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
    if not text.isdecimal() or int(text) > LARGEST_DOMAIN:
        raise BallbotError(f'{DOMAIN}={text}: set a number within 0 … {LARGEST_DOMAIN}')
    return int(text)


def stay_on_this_machine() -> None:
    """Have nodes look for each other on this machine, unless the environment says otherwise."""
    os.environ.setdefault(RANGE, LOCALHOST)


def prepare_middleware() -> None:
    """Have participants find each other soon, and talk over UDP.

    Profiles of the user's own stay as they are.

    Raises
    ------
    BallbotError
        If there is no such ROS domain.
    """
    ros_domain()
    if os.environ.get(PROFILES):
        return
    name = 'fastdds.xml'
    if _is_local():
        # With that range rmw_fastrtps adds shared memory to what the profiles say.
        os.environ[RANGE] = 'SYSTEM_DEFAULT'
        name = 'fastdds_localhost.xml'
    os.environ[PROFILES] = str(share_directory() / 'config' / name)


def _is_local() -> bool:
    """Return whether profiles of Fast DDS can say all that the environment asks for."""
    return (
        os.environ.get(RANGE) == LOCALHOST
        and not os.environ.get(STATIC_PEERS)
        and os.environ.get(MIDDLEWARE, '') in ('', 'rmw_fastrtps_cpp')
    )
