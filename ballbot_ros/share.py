"""Location of the package's files: in the source tree, or under an install prefix."""

from __future__ import annotations

from pathlib import Path

from ballbot_ros.errors import BallbotError


def share_directory() -> Path:
    """Return the folder that holds ``config`` and ``launch``.

    Raises
    ------
    BallbotError
        If the installation is incomplete.
    """
    for parent in Path(__file__).resolve().parents:
        for candidate in (parent, parent / 'share' / 'ballbot_ros'):
            if (candidate / 'package.xml').is_file() and (candidate / 'config').is_dir():
                return candidate
    raise BallbotError('share/ballbot_ros/config not found in the installation of ballbot_ros')
