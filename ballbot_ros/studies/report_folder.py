"""The report of a study as files."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ballbot_ros.analysis.page import ReportError, check_folder, write_folder
from ballbot_ros.analysis.run_figures import RenderedFigure

REPORT = 'report'
"""Name of the report's folder in that of its study."""

_SUFFIXES = {'.html', '.png', '.csv'}


@dataclass(frozen=True)
class StudyReport:
    """A report, ready to be written.

    Attributes
    ----------
    page : str
        The HTML.
    figures : list of RenderedFigure
    files : mapping of str to bytes
        Other files, by name.
    """

    page: str
    figures: list[RenderedFigure]
    files: Mapping[str, bytes]

    def write(self, folder: Path) -> None:
        """Write it into a folder, which is new, empty, or has an earlier report of a study.

        Raises
        ------
        ReportError
            If the folder can't be written.
        """
        _remove_report(folder)
        write_folder(folder, self.page, self.figures, self.files)


def check_output(study: Path, output: Path | None) -> Path:
    """Return the folder of the report of a study, by default in the folder of the study.

    Raises
    ------
    ReportError
        If it has files that are not those of an earlier report, or can't be written.
    """
    folder = output or study / REPORT
    if not _is_report(folder):
        check_folder(folder)
    existing = next(each for each in (folder, *folder.absolute().parents) if each.exists())
    if not existing.is_dir():
        raise ReportError(f'{existing}: not a folder; choose another --output')
    if not os.access(existing, os.W_OK | os.X_OK):
        raise ReportError(f'{existing}: Permission denied; choose another --output')
    return folder


def _is_report(folder: Path) -> bool:
    """Return whether a folder has a page, and nothing but the files of a report."""
    if not (folder / 'index.html').is_file():
        return False
    return all(each.is_file() and each.suffix in _SUFFIXES for each in folder.iterdir())


def _remove_report(folder: Path) -> None:
    if _is_report(folder):
        try:
            shutil.rmtree(folder)
        except OSError as error:
            raise ReportError(f'{folder}: {error.strerror}') from None
