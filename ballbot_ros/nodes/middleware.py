"""What the middleware is told before ROS begins in a process."""

from __future__ import annotations

import os

from ballbot_ros.share import share_directory

PROFILES = 'FASTRTPS_DEFAULT_PROFILES_FILE'
"""Environment variable: Fast DDS's profiles. Other middleware does not look at it."""


def prepare_middleware() -> None:
    """Have participants find each other soon, unless the user has profiles of their own."""
    os.environ.setdefault(PROFILES, str(share_directory() / 'config' / 'fastdds.xml'))
