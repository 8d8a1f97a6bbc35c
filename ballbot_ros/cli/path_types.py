"""Types of path arguments."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import click


class _Path(click.Path):
    """A path; rejects an empty word, as of an unset variable, which a Path takes for ``.``."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(
        self,
        value: str | os.PathLike[str],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> str | bytes | os.PathLike[str]:
        if not str(value):
            self.fail('names nothing', param, ctx)
        return super().convert(value, param, ctx)


class _File(_Path):
    """A file path; rejects an argument that can only mean a folder, and says what is `wanted`."""

    def __init__(self, is_folder: Callable[[str], bool], wanted: str) -> None:
        super().__init__()
        self._is_folder, self._wanted = is_folder, wanted

    def convert(
        self,
        value: str | os.PathLike[str],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> str | bytes | os.PathLike[str]:
        if str(value) and self._is_folder(str(value)):
            self.fail(f'{value}: is a folder; name {self._wanted}', param, ctx)
        return super().convert(value, param, ctx)


PATH = _Path()
"""A file to read, or a folder."""

RECORDING = _File(lambda value: not Path(value).name, 'a recording')
"""A recording to read. Output files are named after it, so it must have a name."""

NEW_FILE = _File(lambda value: value.endswith('/'), 'a file to write')
"""A file to write. ``x/`` means a folder, but a Path would drop the slash."""
