"""The paths that commands are given."""

from __future__ import annotations

import os
from pathlib import Path

import click


class _NewFile(click.Path):
    """A file to write. ``x/`` names a folder, and a path would forget the slash."""

    def convert(
        self,
        value: str | os.PathLike[str],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> str | bytes | os.PathLike[str]:
        if str(value).endswith('/'):
            self.fail(f'{value}: a folder, not a file to write', param, ctx)
        return super().convert(value, param, ctx)


class _Recording(click.Path):
    """A recording to read. What a command writes is called after it, so it has a name."""

    def convert(
        self,
        value: str | os.PathLike[str],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> str | bytes | os.PathLike[str]:
        if not Path(value).name:
            self.fail(f'{value}: a folder, not a recording', param, ctx)
        return super().convert(value, param, ctx)


PATH = click.Path(path_type=Path)
"""A file to read, or a folder."""

RECORDING = _Recording(path_type=Path)

NEW_FILE = _NewFile(path_type=Path)
