"""Chapter 10's first challenge: the document's gains, LQR redesigns and tuned gains."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

import ballbot_ros as bb
from ballbot_ros.controllers.design.gain_design import GainDesign
from ballbot_ros.controllers.design.linear_model import Q_DIAGONAL, R_WEIGHT
from ballbot_ros.controllers.design.loop_analysis import dead_time_margin_ms
from ballbot_ros.engine.scenario.reader import load_profile, scenario_names
from ballbot_ros.lab.search.tune import WITH_GAINS
from ballbot_ros.lab.studies.execution import StudyObserver, run_study
from ballbot_ros.lab.studies.job import job_of
from ballbot_ros.lab.studies.programs import with_values
from ballbot_ros.lab.studies.reader import read_study
from ballbot_ros.lab.studies.study_data import StudyData
from ballbot_ros.parameters import CONTROLLER, ParameterSet
from ballbot_ros.parameters.files import format_parameters, read_parameter_file
from benchmark.tables import print_table

GAINS = Path(__file__).parents[3] / 'config/gains'
ROBOTS = 10_000
NAMES = (*WITH_GAINS, 'pwm_offset')
SHOWN = {'steady_pitch_rms_deg': '°', 'duty_rms_percent': '%', 'peak_position_m': 'm'}

Values = Mapping[str, object]
"""Gains, filters and friction compensation by ``node.param``."""


def challenge() -> None:
    """Compare the document's gains, LQR redesigns and tuned gains on many robots."""
    gains = _gains()
    print_table(['', *(f'`{name}`' for name in gains)], _scenarios(gains))
    print_table(['study `robustness`', *(f'`{name}`' for name in gains)], _robots(gains))


def _gains() -> dict[str, Values]:
    """Return the gains by name: those of files, and a redesign with the document's weights."""
    found = {}
    for path in sorted(GAINS.glob('*.yaml')):
        of_file = read_parameter_file(path)
        values = of_file.of_node(CONTROLLER).values()
        found[path.stem] = {f'{CONTROLLER}.{name}': values[name] for name in NAMES}
    document = found.pop('document')
    design = GainDesign(with_values(load_profile('hardware'), document))
    *k_f, k_i = design.regulator(Q_DIAGONAL, R_WEIGHT)
    redesigned = {**document, f'{CONTROLLER}.k_f': tuple(k_f), f'{CONTROLLER}.k_i': k_i}
    return {'document': document, 'dlqr': redesigned, **found}


def _scenarios(gains: Mapping[str, Values]) -> list[list[str]]:
    """Return for each scenario the duty with each of the gains, and whether it passes."""
    rows = []
    for name in scenario_names():
        runs = [bb.simulate(name, parameters=values) for values in gains.values()]
        cells = (
            f'{run.metrics["duty_rms_percent"]:.1f} %{"" if run.passed else ", fails"}'
            for run in runs
        )
        rows.append([f'`{name}`', *cells])
    return rows


def _robots(gains: Mapping[str, Values]) -> list[list[str]]:
    """Return what becomes of the robots of the study `robustness` with each of the gains."""
    columns: list[list[str]] = []
    for values in gains.values():
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            file = folder / 'gains.yaml'
            own = with_values(ParameterSet(), values)
            file.write_text(format_parameters(own, [CONTROLLER], NAMES), encoding='utf-8')
            study = read_study('robustness', runs=ROBOTS, parameter_file=file)
            run_study(job_of(study, folder / 'results'), StudyObserver())
            summary = StudyData.open(folder / 'results').summary()
        shown = {each.column.name: each for each in summary.measures}
        margin = dead_time_margin_ms(with_values(load_profile('hardware'), values))
        columns.append([
            f'{100.0 * summary.share_passed:.1f} %',
            f'{summary.totals.fallen:,}',
            *(
                f'{each.quantiles[2]:.3g} … {each.quantiles[4]:.3g} {unit}'
                for name, unit in SHOWN.items()
                for each in [shown[name]]
            ),
            f'{margin:.1f} ms',
        ])  # fmt: skip
    heads = [
        'passed',
        'fallen',
        *(f'`{name}`, median … 95 %' for name in SHOWN),
        'dead-time margin',
    ]
    return [[head, *cells] for head, cells in zip(heads, zip(*columns, strict=True), strict=True)]
