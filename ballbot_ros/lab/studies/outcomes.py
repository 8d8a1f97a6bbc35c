"""How the runs of studies ended, by the words that vary: survived, fell or hit a wall."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ballbot_ros.lab.studies.columns import FALLEN, NUMBER, OUTCOME, ColumnKind
from ballbot_ros.lab.studies.data_set import MANIFEST
from ballbot_ros.lab.studies.study import CASE
from ballbot_ros.lab.studies.study_data import StudyData
from ballbot_ros.lockstep.run_actions import Outcome


class Ending(NamedTuple):
    """How runs with the same words ended; the worst failed, else fell, else measures worst."""

    words: Mapping[str, str]
    runs: int
    failed: int
    fallen: int
    worst: int
    text: str


def endings_of(data: StudyData) -> list[Ending]:
    """Return how the runs of a study ended, for each of the words that vary, in their order."""
    study, measure = data.study, data.study.measures[0]
    names = [each.name for each in study.varied if each.kind is ColumnKind.TEXT]
    found: dict[tuple[str, ...], list[tuple[bool, bool, float, int]]] = {}
    for part in data.parts([*names, measure.name, OUTCOME.name, FALLEN.name, NUMBER.name]):
        part[measure.name] = np.nan_to_num(measure.badness(part[measure.name]), nan=-np.inf)
        columns: Any = zip(*(each.tolist() for each in part.values()), strict=True)
        for *key, badness, outcome, has_fallen, number in columns:
            failed = outcome == Outcome.FAILED
            row = failed, has_fallen and not failed, badness, -number
            found.setdefault(tuple(key), []).append(row)
    # Without walls only an error of its controller makes a run fail.
    failure = 'failed' if "map: ''" in study.parameters else 'hit a wall'
    endings = []
    for key, rows in found.items():
        failed, fallen = sum(row[0] for row in rows), sum(row[1] for row in rows)
        counts = {'fell': fallen, failure: failed}
        told = [f'{what} {count} of {len(rows)}' for what, count in counts.items() if count]
        case = dict(zip(names, key, strict=True))
        text = ', '.join(told) or 'survived'
        endings.append(Ending(case, len(rows), failed, fallen, -max(rows)[3], text))
    return endings


def endings_below(folder: Path) -> list[Ending]:
    """Return the endings of the studies of a folder, one for each scenario and controller."""
    found = []
    for path in sorted(folder.glob(f'*/*/{MANIFEST}')):
        case = dict(zip(reversed(CASE), path.parts[-2:-4:-1], strict=True))
        endings = endings_of(StudyData.open(path.parent))
        found += [each._replace(words={**each.words, **case}) for each in endings]
    return found


def ending_table(endings: Sequence[Ending]) -> list[list[str]]:
    """Return a table with its head: a row for each of the other words, a column for each scenario.

    The number of the worst run is in parentheses.
    """
    words = {
        name: [*dict.fromkeys(each.words[name] for each in endings)] for name in endings[0].words
    }
    cells = {tuple(each.words.values()): f'{each.text} ({each.worst})' for each in endings}
    columns = words.pop(CASE[0], ['outcome'])
    return [[*words, *columns]] + [
        [*row, *(cells.get((*row, each), cells.get(row, 'not possible')) for each in columns)]
        for row in product(*words.values())
    ]
