"""Types of path arguments."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import click


class _Path(click.Path):
    """A path; rejects an empty word, as of an unset variable, which a Path takes for ``.``.

    If an argument can only mean a folder, it is rejected, too, and the message says what is
    `wanted`.
    """

    def __init__(
        self, is_folder: Callable[[str], bool] = lambda value: False, wanted: str = ''
    ) -> None:
        super().__init__(path_type=Path)
        self._is_folder, self._wanted = is_folder, wanted

    def convert(
        self,
        value: str | os.PathLike[str],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> str | bytes | os.PathLike[str]:
        word = str(value)
        if not word:
            self.fail('names nothing', param, ctx)
        if self._is_folder(word):
            self.fail(f'{word}: is a folder; name {self._wanted}', param, ctx)
        return super().convert(value, param, ctx)


PATH = _Path()
"""A file to read, or a folder."""

RECORDING = _Path(lambda value: not Path(value).name, 'a recording')
"""A recording to read. Output files are named after it, so it must have a name."""

NEW_FILE = _Path(lambda value: value.endswith('/'), 'a file to write')
"""A file to write. ``x/`` means a folder, but a Path would drop the slash."""
