"""What to do with a recording, for the end of a command's output."""

from __future__ import annotations

from pathlib import Path

from ballbot_ros.own_command import own_command


def next_steps(recording: Path) -> list[str]:
    """Return the lines that name the commands for a recording."""
    return [
        f'report it  {own_command("report", recording)}',
        f'watch it   {own_command("view", recording)}',
    ]
