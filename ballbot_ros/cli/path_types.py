"""The paths that commands are given."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import click


class _File(click.Path):
    """A file, where a command can tell from the words alone that a folder is meant.

    Parameters
    ----------
    is_folder : callable
        Tells it of what was given.
    wanted : str
        What is to be given instead.
    """

    def __init__(self, is_folder: Callable[[str], bool], wanted: str) -> None:
        super().__init__(path_type=Path)
        self._is_folder, self._wanted = is_folder, wanted

    def convert(
        self,
        value: str | os.PathLike[str],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> str | bytes | os.PathLike[str]:
        if self._is_folder(str(value)):
            self.fail(f'{value}: a folder, not {self._wanted}', param, ctx)
        return super().convert(value, param, ctx)


PATH = click.Path(path_type=Path)
"""A file to read, or a folder."""

RECORDING = _File(lambda value: not Path(value).name, 'a recording')
"""A recording to read. What a command writes is called after it, so it has a name."""

NEW_FILE = _File(lambda value: value.endswith('/'), 'a file to write')
"""A file to write. ``x/`` names a folder, and a path would forget the slash."""
