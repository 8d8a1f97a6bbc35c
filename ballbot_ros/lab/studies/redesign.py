"""Gains of the document's program that are designed for the robot of each run of a study."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ballbot_ros.controllers.design.redesign import Redesign
from ballbot_ros.engine.rows import Column
from ballbot_ros.errors import BallbotError
from ballbot_ros.lab.studies.programs import naming_run, with_values
from ballbot_ros.lab.studies.variables import SEED
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, ParameterSet

K_F, K_I = f'{CONTROLLER}.k_f', f'{CONTROLLER}.k_i'

GAINS = (*(f'{K_F}.{number}' for number in range(1, 5)), K_I)
"""What is designed, by its names in samples and results."""


def designed_gains(
    redesign: Redesign,
    parameters: ParameterSet,
    values: Mapping[str, Column],
    count: int,
    first: int,
) -> dict[str, Column]:
    """Return the :data:`GAINS` of consecutive runs; they are 0 for a robot that has no design.

    Parameters
    ----------
    parameters : ParameterSet
        Those of the run that all are like.
    values : mapping of str to ndarray
        The values of the parameters that vary, one for each run.
    count, first : int
        Number of runs, and the number of the first one.

    Raises
    ------
    StudyError
        If a value is not allowed.
    """
    columns = {name: column.tolist() for name, column in values.items() if name != SEED}
    known: dict[tuple[object, ...], tuple[float, ...]] = {}
    rows = []
    for run in range(count):
        of_run = {name: column[run] for name, column in columns.items()}
        key = tuple(of_run.values())
        if key not in known:
            with naming_run(first + run):
                known[key] = _gains(redesign, with_values(parameters, of_run))
        rows.append(known[key])
    return dict(zip(GAINS, np.array(rows).reshape(count, len(GAINS)).T, strict=True))


def _gains(redesign: Redesign, parameters: ParameterSet) -> tuple[float, ...]:
    try:
        redesign.apply(parameters)
    except BallbotError:
        return (0.0,) * len(GAINS)
    own = parameters.of(ControllerParameters)
    return (*own.k_f, own.k_i)
