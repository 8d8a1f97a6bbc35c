"""Studies from Python: ``bb.study``."""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from ballbot_ros.controllers.class_reference import reference_to
from ballbot_ros.controllers.controller import Controller
from ballbot_ros.controllers.loading import MAIN
from ballbot_ros.errors import BallbotError, short_repr
from ballbot_ros.files import temporary_folder
from ballbot_ros.lab.studies.execution import StudyObserver, StudyStoppedError, run_study
from ballbot_ros.lab.studies.job import job_of
from ballbot_ros.lab.studies.reader import read_studies
from ballbot_ros.lab.studies.study_data import StudyData
from ballbot_ros.parameters.files import plain_value
from ballbot_ros.parameters.yaml_document import yaml_text

if TYPE_CHECKING:
    import pandas

_log = logging.getLogger(__name__)
_PATHS = ('scenario', 'controller')


def study(
    study: str | os.PathLike[str] | Mapping[str, object],
    *,
    runs: int | None = None,
    seed: int | None = None,
    output: str | os.PathLike[str] | None = None,
) -> pandas.DataFrame:
    """Run a scenario very many times, with values that vary from run to run, on all cores.

    Runs of the document's control program are compiled. Those of other controllers are as slow as
    by ``bb.simulate``.

    Parameters
    ----------
    study : str or path-like or mapping
        Name of a shipped study, a study file, or the content of one, such as ``{'scenario': 'push',
        'runs': 1000, 'vary': {'plant_sim.body_mass': {'uniform': [0.6, 0.8]}}}``. In the content,
        ``controller`` may also be the class of a controller that is defined in a file.
    runs : int or None
        Number of runs; None for that of the study. A grid gets the levels that fit it best.
    seed : int or None
        Seed of the samples; None for that of the study.
    output : path-like or None
        Folder for the results, in which an interrupted study goes on and a finished one is not run
        again; None to keep only what is returned.

    Returns
    -------
    pandas.DataFrame
        A row a run: number, seed, varied values, measures (NaN without a value), whether it passed,
        outcome, and the hash of its duties.

    Raises
    ------
    BallbotError
        If the study is not valid, or the folder is another study's; the message is one line.
    KeyboardInterrupt
        If it is interrupted.
    """
    with temporary_folder() as name:
        scratch = Path(name)
        reference = _reference(study, scratch)
        place = scratch / 'results' if output is None else Path(output)
        frames = []
        try:
            for each in list(read_studies(reference, plain_value(runs), plain_value(seed))):
                folder = place.joinpath(*each.case.values())
                run_study(job_of(each, folder), _Log())
                frames.append(StudyData.open(folder).frame().assign(**each.case))
        except StudyStoppedError as error:
            stopped = error.signal
        else:
            import pandas

            return pandas.concat(frames, ignore_index=True)
    signal.raise_signal(stopped)  # now with its usual effect
    raise KeyboardInterrupt


class _Log(StudyObserver):
    """Writes notices to the log."""

    def notice(self, text: str) -> None:
        """Log a line."""
        _log.warning(text)


def _reference(study: str | os.PathLike[str] | Mapping[str, object], scratch: Path) -> str:
    """Return the name or file of a study; a content is written to a file in a folder."""
    if isinstance(study, str):
        return study
    if isinstance(study, os.PathLike):
        return str(Path(study).absolute())
    if not isinstance(study, Mapping):
        raise BallbotError(f'study: {short_repr(study)} is neither a name, a path nor a mapping')
    content: dict[str, Any] = {'purpose': 'a study from Python', **_plain(study)}
    controller = content.get('controller')
    if isinstance(controller, type) and issubclass(controller, Controller):
        if controller.__module__ == MAIN:
            raise BallbotError(
                f'study: the class {controller.__name__} is defined in the notebook or program '
                'itself, which the processes of a study do not have: write it to a file'
            )
        content['controller'] = reference_to(controller)
    for key in _PATHS:
        # A path is relative to where the program runs, not to the file.
        reference = content.get(key)
        if isinstance(reference, str) and Path(reference.partition(':')[0]).is_file():
            content[key] = str(Path.cwd() / reference)
    path = scratch / 'study.yaml'
    try:
        text = yaml_text(content)
    except yaml.YAMLError:
        raise BallbotError(
            'study: a value is neither a number, a text, a list nor a mapping'
        ) from None
    path.write_text(text, encoding='utf-8')
    return str(path)


def _plain(content: Mapping[str, object]) -> dict[str, object]:
    """Return a mapping of mappings without numpy's types."""
    return {
        str(key): _plain(value) if isinstance(value, Mapping) else plain_value(value)
        for key, value in content.items()
    }
