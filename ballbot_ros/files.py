"""Access to files, those of the package, and commands to paste; errors fit on one line."""

from __future__ import annotations

import errno
import os
import shlex
import shutil
import stat
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BufferedReader, FileIO, TextIOWrapper
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile

from ballbot_ros.errors import BallbotError, did_you_mean

OUR_PACKAGE = __name__.partition('.')[0]


def open_regular(path: str | os.PathLike[str]) -> FileIO:
    """Open a regular file for reading.

    Other kinds of file are refused without opening them: opening a FIFO waits for a writer, and a
    device may have no end.

    Raises
    ------
    OSError
        If `path` is not a regular file or can't be opened; `strerror` has the reason.
    """
    mode = Path(path).stat().st_mode
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, 'not a regular file', os.fspath(path))
    return FileIO(os.fspath(path))


def read_bytes(path: str | os.PathLike[str]) -> bytes:
    """Read a regular file; raises as :func:`open_regular` does."""
    with open_regular(path) as file:
        return file.readall()


def read_text(path: str | os.PathLike[str]) -> str:
    """Read a regular file of UTF-8 text; raises as :func:`open_regular` does, or UnicodeError."""
    with TextIOWrapper(BufferedReader(open_regular(path)), encoding='utf-8') as file:
        return file.read()


def make_folder(folder: Path) -> None:
    """Create a folder, unless it exists; raise OSError if no file can be created in it."""
    folder.mkdir(parents=True, exist_ok=True)
    TemporaryFile(dir=folder).close()


def temporary_folder() -> TemporaryDirectory[str]:
    """Return a new temporary folder, which is removed at the end of its context.

    Raises
    ------
    BallbotError
        If no folder can be created, or its path is not UTF-8.
    """
    remedy = 'set TMPDIR to a writable folder'
    try:
        folder = TemporaryDirectory(prefix='ballbot_')
    except OSError as error:
        where = Path(error.filename).parent if error.filename else 'temporary files'
        raise BallbotError(f'{where}: {error.strerror}; {remedy}') from None
    try:
        folder.name.encode()
    except UnicodeEncodeError:
        folder.cleanup()
        raise BallbotError(f'{folder.name!r}: not UTF-8; {remedy}') from None
    return folder


@contextmanager
def replacing(output: Path, kind: type[BallbotError] = BallbotError) -> Iterator[Path]:
    """Give a path to write to; the file replaces `output` once it is complete.

    Yields
    ------
    pathlib.Path

    Raises
    ------
    BallbotError
        Of this kind, if the file can't be written.
    """
    try:
        with TemporaryDirectory(prefix='.ballbot_', dir=output.parent) as folder:
            unfinished = Path(folder) / output.name
            yield unfinished
            unfinished.replace(output)
    except (OSError, ImportError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or ' '.join(str(error).split())
        raise kind(f'{output}: {reason}') from None


def write_temporary(path: Path, data: bytes) -> None:
    """Write a file in a temporary folder, or in a new folder in it.

    Raises
    ------
    BallbotError
        If it can't be written.
    """
    try:
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)
    except OSError as error:
        raise BallbotError(
            f'{path}: {error.strerror}; set TMPDIR to another folder for temporary files'
        ) from None


def shown_path(path: str | Path) -> str:
    """Return a path as shown to the user: relative to the current folder if it is below it."""
    path = Path(path)
    try:
        return str(path.relative_to(Path.cwd()))
    except (ValueError, OSError):
        return str(path)


def share_directory() -> Path:
    """Return the folder that holds ``config`` and ``launch``.

    Raises
    ------
    BallbotError
        If the installation is incomplete.
    """
    for parent in Path(__file__).resolve().parents:
        for candidate in (parent, parent / 'share' / OUR_PACKAGE):
            if (candidate / 'package.xml').is_file() and (candidate / 'config').is_dir():
                return candidate
    raise BallbotError('share/ballbot_ros/config not found in the installation of ballbot_ros')


def shipped_names(folder: str, suffix: str = '.yaml') -> list[str]:
    """Return the names of the files that are shipped in a folder of ``config``."""
    return sorted(path.stem for path in (share_directory() / 'config' / folder).glob(f'*{suffix}'))


def shipped_file(
    name: str, folder: str, what: str, kind: type[BallbotError], endings: Sequence[str] = ('.yaml',)
) -> Path:
    """Return a shipped file by its name; raise an error of a kind if there is none.

    `what` is the word for such a file, of which the user's own can have any of the endings.
    """
    names = shipped_names(folder, endings[0])
    if name not in names:
        raise kind(
            f'unknown {what} {name!r}{did_you_mean(name, names)}; shipped: {", ".join(names)} '
            f'(for your own {what}, give the path of its file, ending in {" or ".join(endings)})'
        )
    return share_directory() / 'config' / folder / f'{name}{endings[0]}'


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
