"""Commands of this installation as the user can paste them."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from pathlib import Path

from ballbot_ros.files import shown_path

COMMAND_ENV = 'BALLBOT_COMMAND'
"""Environment variable with the words that call the command ``ballbot``, such as scripts/run."""


def program(name: str = 'ballbot', folder: Path | None = None) -> str:
    """Return the words that call a program of this environment here, or in another folder."""
    path = Path(sys.executable).with_name(name)
    found = shutil.which(name) == str(path) or not path.exists()
    words = shlex.quote(name if found else shown_path(path))
    if name == 'ballbot':
        words = os.environ.get(COMMAND_ENV) or words
    first, *others = shlex.split(words)
    if folder and '/' in first and not first.startswith('/'):
        first = os.path.relpath(first, os.path.realpath(folder))
    return shlex.join([first, *others])


def own_command(*words: object) -> str:
    """Return a command of ``ballbot``."""
    return f'{program()} {shlex.join(map(str, words))}'


def next_steps(recording: Path) -> list[str]:
    """Return the lines that name the commands for a recording."""
    report, view = (own_command(each, recording) for each in ('report', 'view'))
    return [f'report it  {report}', f'watch it   {view}']
