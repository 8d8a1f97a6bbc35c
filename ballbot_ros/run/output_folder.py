"""The folder of a run's recording and figure."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from ballbot_ros.errors import BallbotError
from ballbot_ros.files import make_folder
from ballbot_ros.parameters import RECORDER
from ballbot_ros.run.spec import RunSpec


class OutputFiles(NamedTuple):
    """The output files of a run."""

    recording: Path | None = None
    figure: Path | None = None


@contextmanager
def output_files(spec: RunSpec) -> Iterator[OutputFiles]:
    """Create the folder of a run; remove it in the end if it is still empty.

    It raises BallbotError if the folder is not writable, or has a recording of this name.
    """
    if spec.output is None and not spec.record:
        yield OutputFiles()
        return
    folder = spec.output or _new_folder(spec.name)
    if spec.output is not None:
        _make_folder(folder)
    try:
        recording = folder / f'{spec.name}.mcap' if RECORDER in spec.nodes else None
        if recording and recording.exists():
            raise BallbotError(f'{recording}: already exists; choose another --output')
        yield OutputFiles(recording, folder / f'{spec.name}.png')
    finally:
        _remove_if_empty(folder)


def _remove_if_empty(folder: Path) -> None:
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()


def _make_folder(folder: Path) -> None:
    try:
        make_folder(folder)
    except (FileExistsError, NotADirectoryError):
        raise BallbotError(f'--output {folder}: not a folder; choose another --output') from None
    except OSError as error:
        raise BallbotError(f'--output {folder}: {error.strerror}') from None


def _new_folder(name: str) -> Path:
    stem = f'{datetime.now():%Y-%m-%d_%H-%M-%S}_{name}'
    for suffix in ('', *(f'_{number}' for number in range(2, 1000))):
        folder = Path('runs') / (stem + suffix)
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise BallbotError(f'{folder}: {error.strerror}') from None
        return folder
    raise BallbotError(f'runs/{stem}: already exists')
