"""The recorded run that another one has branched off."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from ballbot_ros.errors import printable
from ballbot_ros.files import open_regular
from ballbot_ros.parameters.yaml_document import parse_data, yaml_text
from ballbot_ros.recording.reader import AttachedFile
from ballbot_ros.recording.rosbag2 import PARENT

_KINDS: dict[str, Any] = {'file': str, 'sha256': str, 'run': int, 'at': float, 'changes': list}


@dataclass(frozen=True)
class Parent:
    """What identifies the earlier run of a branch, as attached to its recording.

    Attributes
    ----------
    file : str
        Its recording: the path from the folder of the branch if both are below the same folder,
        else only the name, since other paths are private.
    run : int
        Number of the run in it, from 1.
    at : float
        Time of the branch, from the start of the run [s].
    changes : tuple of str
        What is different from then on.
    """

    file: str
    sha256: str
    run: int
    at: float
    changes: tuple[str, ...]

    @classmethod
    def of(
        cls, recording: Path, run: int, at: float, changes: tuple[str, ...], folder: Path
    ) -> Parent:
        """Return the parent of a branch whose recording will be in `folder`."""
        path = Path(os.path.relpath(recording.resolve(), folder.resolve())).as_posix()
        file = path if _is_near(path) else recording.name
        return cls(file, file_sha256(recording), run, at, changes)

    def __str__(self) -> str:
        name = PurePosixPath(self.file).name
        told = '; '.join(self.changes) or 'nothing changed'
        return printable(f'{name}, run {self.run}, at {self.at:g} s: {told}')

    def encode(self) -> bytes:
        """Return the attachment."""
        return yaml_text({**asdict(self), 'changes': list(self.changes)}).encode()

    @classmethod
    def decode(cls, files: Mapping[str, AttachedFile]) -> Parent | None:
        """Return the parent that is attached to a recording; None if none is that can be read."""
        content = parse_data(files[PARENT].data) if PARENT in files else None
        values: dict[str, Any] = content if isinstance(content, dict) else {}
        if not all(isinstance(values.get(name), kind) for name, kind in _KINDS.items()):
            return None
        changes = tuple(map(str, values['changes']))
        return cls(values['file'], values['sha256'], values['run'], values['at'], changes)

    def find(self, branch: Path) -> Path | None:
        """Return the parent's file next to the recording of the branch; None if it is not there."""
        for name in dict.fromkeys((self.file, PurePosixPath(self.file).name)):
            path = branch.resolve().parent / name
            if _is_near(name) and path.is_file() and file_sha256(path) == self.sha256:
                return Path(os.path.relpath(path))
        return None


def file_sha256(path: Path) -> str:
    """Return the hash of a file; OSError if it can't be read."""
    found = hashlib.sha256()
    with open_regular(path) as file:
        while block := file.read(_BLOCK):
            found.update(block)
    return found.hexdigest()


_BLOCK = 2**20


def _is_near(path: str) -> bool:
    """Return whether a relative path stays below the folder above its start."""
    parts = PurePosixPath(path).parts
    return parts[:1] != ('/',) and '..' not in parts[1:]
