"""The report of a study: a page, its figures and its numbers."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np

from ballbot_ros.errors import StudyError
from ballbot_ros.lab.studies.charts import histogram_edges, share_bins
from ballbot_ros.lab.studies.columns import PASSED
from ballbot_ros.lab.studies.manifest import StudyRecord
from ballbot_ros.lab.studies.maps import map_bins
from ballbot_ros.lab.studies.report_page import Findings, StudyReport
from ballbot_ros.lab.studies.sensitivity import MAX_SAMPLE, Sensitivity, analyse
from ballbot_ros.lab.studies.study import StudyText
from ballbot_ros.lab.studies.study_data import StudyData
from ballbot_ros.lab.studies.survey import Axis, Survey, tally

MAPPED_VARIABLES = 4
"""Largest number of variables, those with the most influence, of which all pairs have a map."""

WORST_SHOWN = 3


def study_report(data: StudyData) -> StudyReport:
    """Make the report of a study, finished or not.

    Rows are read part by part; the memory is that of one number a run. Sensitivities are those of
    at most :data:`~ballbot_ros.lab.studies.sensitivity.MAX_SAMPLE` runs, drawn by the study's seed.

    Raises
    ------
    BallbotError
        If there are no runs yet, a part is damaged, or SALib is not installed.
    """
    study = data.study
    text = StudyText.of(study.text)
    survey = Survey.of(data, MAX_SAMPLE, np.random.default_rng(study.seed))
    if not survey.totals.runs:
        raise StudyError(f'{data.path}: has no results yet')
    varied = {each.name: survey.sample[each.name] for each in study.varied}
    results = {each.name: survey.sample[each.name] for each in (*study.measures, PASSED)}
    found = analyse(varied, results, study.seed)
    summary = data.summary(WORST_SHOWN)
    axes = [_axis(study, each.name, text, survey, share_bins) for each in study.varied]
    pairs = _pairs(study, text, survey, found)
    edges = {
        each.name: histogram_edges(each, survey.extents[each.name], survey.sample[each.name])
        for each in study.measures
    }
    tallies = tally(data, pairs, axes, edges)
    findings = Findings(data, text, survey, summary, found, axes, pairs, edges, tallies)
    return findings.report()


def _pairs(
    study: StudyRecord, text: StudyText, survey: Survey, found: Sensitivity
) -> list[tuple[Axis, Axis]]:
    """Return the axes of each map, those of the most influential pair first."""
    names = found.most_influential(MAPPED_VARIABLES)
    axes = {name: _axis(study, name, text, survey, map_bins) for name in names}
    # In the order of the study, so that a variable is on the same side of all its maps.
    ranks = {each.name: place for place, each in enumerate(study.varied)}
    chosen = (sorted(pair, key=ranks.__getitem__) for pair in combinations(names, 2))
    return [(axes[x], axes[y]) for x, y in chosen]


def _axis(
    study: StudyRecord, name: str, text: StudyText, survey: Survey, bins: Callable[[int], int]
) -> Axis:
    column = next(each for each in study.varied if each.name == name)
    runs = survey.totals.runs
    return Axis.of(
        column,
        survey.extents[name],
        runs,
        bins(runs),
        is_grid=text.is_grid,
        is_log=name in text.logarithmic,
    )
