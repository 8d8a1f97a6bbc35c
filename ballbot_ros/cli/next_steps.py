"""What to do with a recording, for the end of a command's output."""

from __future__ import annotations

import os
import shlex
from pathlib import Path

COMMAND_ENV = 'BALLBOT_COMMAND'
"""Environment variable with the words that call this program, if not ``ballbot``."""


def next_steps(recording: Path) -> list[str]:
    """Return the lines that name the commands for a recording."""
    program = os.environ.get(COMMAND_ENV, 'ballbot')
    file = shlex.quote(str(recording))
    return [
        f'report it  {program} report {file}',
        f'watch it   {program} view {file}',
    ]
