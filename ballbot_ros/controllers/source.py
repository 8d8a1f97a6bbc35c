"""The source of a controller, as attached to a recording."""

from __future__ import annotations

import hashlib
import io
import zipfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from ballbot_ros.files import read_bytes

_EPOCH = (1980, 1, 1, 0, 0, 0)
"""The time of every file in an archive, so that the same files always give the same bytes."""


@dataclass(frozen=True)
class Source:
    """The source of a controller: a file, or the archive of a package.

    Attributes
    ----------
    suffix : str
        ``.py`` or ``.zip``.
    """

    suffix: str
    data: bytes

    @cached_property
    def sha256(self) -> str:
        """The hash that identifies it."""
        return hashlib.sha256(self.data).hexdigest()

    @classmethod
    def of_file(cls, path: Path) -> Source:
        """Read a file; OSError if it can't be read."""
        return cls('.py', read_bytes(path))

    @classmethod
    def of_package(cls, folder: Path) -> Source:
        """Read the Python files of a package; OSError if one can't be read.

        The archive is not compressed, so it does not depend on the version of a compressor.
        """
        archive = io.BytesIO()
        with zipfile.ZipFile(archive, 'w', zipfile.ZIP_STORED) as content:
            for path in sorted(folder.rglob('*.py')):
                name = path.relative_to(folder.parent).as_posix()
                content.writestr(zipfile.ZipInfo(name, _EPOCH), read_bytes(path))
        return cls('.zip', archive.getvalue())
