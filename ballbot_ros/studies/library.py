"""The shipped studies, and studies from the user's files."""

from __future__ import annotations

from pathlib import Path

from ballbot_ros.share import share_directory
from ballbot_ros.studies.errors import StudyError
from ballbot_ros.studies.reader import StudyReader
from ballbot_ros.studies.study import Study
from ballbot_ros.suggestions import did_you_mean
from ballbot_ros.yaml_document import YamlDocument

_FOLDER = 'config/studies'


def study_names() -> list[str]:
    """Return the names of the shipped studies."""
    return sorted(path.stem for path in (share_directory() / _FOLDER).glob('*.yaml'))


def read_study(reference: str, *, runs: int | None = None, seed: int | None = None) -> Study:
    """Read a shipped study by its name, or a file by its path.

    Parameters
    ----------
    runs : int or None
        Number of runs in place of the file's; for a grid about this number, by other levels.
    seed : int or None
        Seed of the samples in place of the file's.

    Raises
    ------
    BallbotError
        The message is one line that names file, line, key, and what is allowed.
    """
    if reference in study_names():
        path = share_directory() / _FOLDER / f'{reference}.yaml'
    elif reference.endswith(('.yaml', '.yml')) or '/' in reference:
        path = Path(reference)
    else:
        raise StudyError(
            f'unknown study {reference!r}{did_you_mean(reference, study_names())}; '
            f'shipped: {", ".join(study_names())} '
            '(for your own study, give the path of its file, ending in .yaml)'
        )
    return StudyReader(YamlDocument(path), runs, seed).study()
