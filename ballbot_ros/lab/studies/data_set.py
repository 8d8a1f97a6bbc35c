"""The folder of a study's results while the study runs.

::

    DIR/manifest.json               what the results are results of
    DIR/parts/part-000000.parquet   a row a run
    DIR/parts/...
    DIR/damaged/...                 files that were moved aside, if any
    DIR/.lock                       locked by the command that runs the study

A part counts if its file is there: it gets its name when it is complete. So a study that was
interrupted at any moment needs no repair.
"""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from ballbot_ros.errors import StudyError
from ballbot_ros.files import read_bytes
from ballbot_ros.lab.studies.manifest import Manifest, PartSummary, StudyRecord
from ballbot_ros.lab.studies.part_file import (
    PARTS,
    TEMPORARY_SUFFIX,
    DamagedPartError,
    check_part,
    sync_folder,
    write_atomically,
    writing,
)

MANIFEST = 'manifest.json'
DAMAGED = 'damaged'
LOCK = '.lock'

_REMEDY = 'choose another --output'


class PartCheck(NamedTuple):
    """Which parts of a study are there.

    Attributes
    ----------
    missing : list of int
        The parts that have to be done, in order.
    summary : PartSummary
        Numbers of runs of the parts that are there.
    notices : list of str
        A line for each damaged or foreign file that was moved aside.
    """

    missing: list[int]
    summary: PartSummary
    notices: list[str]


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Lock a folder against other commands of this machine."""
    with (folder / LOCK).open('ab') as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise StudyError(
                f'{folder}: in use by another command, or by its last workers; '
                f'wait for their end, or {_REMEDY}'
            ) from None
        try:
            yield
        finally:
            # Forked workers have inherited the open file, so closing it does not unlock it.
            with suppress(OSError):
                fcntl.flock(file, fcntl.LOCK_UN)


class StudyFolder:
    """A study's folder, which had been begun before if it is `resumed`."""

    def __init__(self, path: Path, manifest: Manifest, *, resumed: bool) -> None:
        self.path = path
        self.manifest = manifest
        self.resumed = resumed

    @property
    def study(self) -> StudyRecord:
        """The study."""
        return self.manifest.study

    @property
    def is_finished(self) -> bool:
        """Whether all parts had been written once; a part may be missing again."""
        return bool(self.manifest.finished)

    def check_parts(self) -> PartCheck:
        """Read all parts completely; move aside those that are damaged, and foreign files.

        It raises StudyError if the folder can't be read or written, or pyarrow is not installed.
        """
        with writing(self.path):
            there = {each.name for each in (self.path / PARTS).iterdir()}
            names = [self.study.part_name(part) for part in range(self.study.parts)]
            notices = [
                self._move_aside(name, 'not a part of this study')
                for name in sorted(there.difference(names))
                if not name.endswith(TEMPORARY_SUFFIX)
            ]
            missing, summary = [], PartSummary()
            for part, name in enumerate(names):
                if name in there:
                    try:
                        summary += check_part(self.path / PARTS / name, self.study, part)
                    except DamagedPartError as error:
                        notices.append(self._move_aside(name, error.reason))
                        missing.append(part)
                else:
                    missing.append(part)
        return PartCheck(missing, summary, notices)

    def finish(self, now: datetime) -> PartCheck:
        """Check all parts; if none is missing, the manifest records that the study is finished.

        It raises StudyError if the folder can't be read or written.
        """
        check = self.check_parts()
        if not check.missing:
            finished = now.isoformat(timespec='seconds')
            self._write(replace(self.manifest, finished=finished, totals=check.summary))
        return check

    def restart(self, now: datetime) -> None:
        """Remove all parts and begin again.

        It raises StudyError if the folder can't be written.
        """
        # First the manifest: a finished one promises all parts.
        self._write(Manifest(self.study, now.isoformat(timespec='seconds')))
        with writing(self.path):
            for each in (self.path / PARTS).iterdir():
                each.unlink()

    def _write(self, manifest: Manifest) -> None:
        _write_manifest(self.path, manifest)
        self.manifest = manifest

    def _move_aside(self, name: str, reason: str) -> str:
        folder = self.path / DAMAGED
        folder.mkdir(exist_ok=True)
        target, number = folder / name, 1
        while target.exists():
            number += 1
            target = folder / f'{name}.{number}'
        (self.path / PARTS / name).rename(target)
        return f'{self.path / PARTS / name}: {reason}; moved to {target}'


@contextmanager
def begin_or_resume(folder: Path, study: StudyRecord, now: datetime) -> Iterator[StudyFolder]:
    """Begin a study in a new or empty folder, or resume it in its own, which is locked meanwhile.

    Temporary files of dead processes are removed. A finished study is left as it is. It raises
    StudyError if the folder has another study, or the study of another version of the code, or
    other files, is in use by another command, or can't be written.
    """
    with writing(folder):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError):
            raise StudyError(f'{folder}: not a folder; {_REMEDY}') from None
    with ExitStack() as stack:
        with writing(folder):
            # Foreign folders get no lock file.
            _check_contents(folder)
            stack.enter_context(_locked(folder))
            begun = _begin_or_resume(folder, study, now)
        yield begun


def read_manifest(folder: Path) -> Manifest:
    """Read the manifest of a study's folder.

    It raises StudyError if there is none, or it is damaged.
    """
    path = folder / MANIFEST
    try:
        return Manifest.from_json(read_bytes(path))
    except (FileNotFoundError, NotADirectoryError):
        raise StudyError(f'{folder}: not the folder of a study, has no {MANIFEST}') from None
    except OSError as error:
        raise StudyError(f'{path}: {error.strerror}') from None
    except StudyError as error:
        raise StudyError(f'{path}: {error}') from None


def _begin_or_resume(folder: Path, study: StudyRecord, now: datetime) -> StudyFolder:
    # Again, since another command may have begun or finished a study before the lock.
    begun = _check_contents(folder)
    if not begun:
        (folder / PARTS).mkdir(exist_ok=True)
        sync_folder(folder.parent)
        manifest = Manifest(study, now.isoformat(timespec='seconds'))
        _write_manifest(folder, manifest)
    else:
        try:
            manifest = read_manifest(folder)
        except StudyError as error:
            raise StudyError(f'{error}; {_REMEDY}') from None
        (folder / PARTS).mkdir(exist_ok=True)
        if difference := manifest.study.difference(study):
            if any(each.suffix == '.parquet' for each in (folder / PARTS).iterdir()):
                raise StudyError(f'{folder}: has another study: {difference}; {_REMEDY}')
            # Nothing is lost: it ended before its first part.
            manifest = Manifest(study, now.isoformat(timespec='seconds'))
            _write_manifest(folder, manifest)
    _remove_temporary(folder)
    return StudyFolder(folder, manifest, resumed=begun)


def _check_contents(folder: Path) -> bool:
    """Return whether a study has begun in a folder; StudyError if it has other files."""
    names = {each.name for each in folder.iterdir()}
    if MANIFEST in names:
        return True
    parts = folder / PARTS
    foreign = {each for each in names - {LOCK, PARTS} if not _is_temporary(each)}
    if foreign or (PARTS in names and (not parts.is_dir() or any(parts.iterdir()))):
        raise StudyError(f'{folder}: has files, but no {MANIFEST} of a study; {_REMEDY}')
    return False


def _write_manifest(folder: Path, manifest: Manifest) -> None:
    with writing(folder / MANIFEST):
        write_atomically(folder / MANIFEST, manifest.to_json().encode())


def _is_temporary(name: str) -> bool:
    return name.startswith('.') and name.endswith(TEMPORARY_SUFFIX)


def _remove_temporary(folder: Path) -> None:
    for each in (*folder.iterdir(), *(folder / PARTS).iterdir()):
        if _is_temporary(each.name):
            each.unlink(missing_ok=True)
