"""The report of a run: a page, its figures and its numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from ballbot_ros.analysis.assessment import Assessment, shown_metrics
from ballbot_ros.analysis.figure_parts import csv_text
from ballbot_ros.analysis.interactive import MISSING, InteractiveFigures, interactive_figures
from ballbot_ros.analysis.limit_cycle import render_spectrum
from ballbot_ros.analysis.loop_summary import (
    MarginRow,
    PredictedFrequency,
    findings,
    margin_rows,
    neglected,
    predictions,
)
from ballbot_ros.analysis.metrics import ExpectationVerdict
from ballbot_ros.analysis.observations import limit_cycle_sentences, offset_reasons
from ballbot_ros.analysis.page import number_text, render_template, write_folder
from ballbot_ros.analysis.parent import Parent
from ballbot_ros.analysis.processor_figures import ProcessorSection, processor_of
from ballbot_ros.analysis.recorded_scenario import outside_pushes
from ballbot_ros.analysis.run_data import RunData
from ballbot_ros.analysis.run_figures import RenderedFigure, draw_figures, figure_contents
from ballbot_ros.analysis.run_metrics import RUN_METRICS
from ballbot_ros.analysis.run_setup import parameter_rows
from ballbot_ros.engine.scenario.metrics import METRICS, label
from ballbot_ros.errors import printable
from ballbot_ros.parameters import CONTROLLER, GyroParameters, PlantParameters, value_text

_MARKS = {
    ExpectationVerdict.MET: '✓ ',
    ExpectationVerdict.NOT_MET: '✗ ',
    ExpectationVerdict.NOT_JUDGED: '',
}

MEANINGS: Mapping[str, str] = {**METRICS.meanings, **RUN_METRICS.meanings}


def report_document(assessment: Assessment) -> str:
    """Return the report of a run as one HTML document, without links to other files."""
    return _page_and_figures(assessment, None, linked=False)[0]


def write_report(assessment: Assessment, folder: Path, earlier: RunData | None = None) -> None:
    """Write the report of a run into `folder`, as `page.write_folder` does.

    It also shows the `earlier` run of a branch.
    """
    page, figures = _page_and_figures(assessment, earlier, linked=True)
    metrics = csv_text(
        ('metric', 'value', 'meaning'),
        (
            (name, '' if math.isnan(value) else repr(value), MEANINGS[name])
            for name, value in assessment.metrics.items()
        ),
    )
    write_folder(folder, page, figures, {'metrics.csv': metrics})


def _page_and_figures(
    assessment: Assessment, earlier: RunData | None, *, linked: bool
) -> tuple[str, list[RenderedFigure]]:
    """Return the page, and the pictures: without links to them, only those that the page shows."""
    run = assessment.run
    loop, contents, processor = loop_of(run), figure_contents(run, earlier), processor_of(run)
    interactive = interactive_figures(run, contents, processor.descriptions)
    figures = draw_figures(run, contents) if linked or not interactive else []
    spectrum = render_spectrum(run, loop.predictions if loop else [])
    shown = [*figures, *(each for each in (spectrum, loop.figure if loop else None) if each)]
    page = report_page(assessment, shown, loop, interactive, processor, linked=linked)
    return page, shown + processor.figures


@dataclass(frozen=True)
class LoopSection:
    """What the report says about the loop with the parameters at the start of the run."""

    margins: list[MarginRow]
    findings: list[str]
    neglected: list[str]
    predictions: list[PredictedFrequency]
    figure: RenderedFigure


def loop_of(run: RunData) -> LoopSection | None:
    """Return the loop of a run; None if it is unknown, as that of another controller."""
    if run.is_real or not run.has_documents_program:
        return None
    # Imported only here: python-control takes two seconds.
    from ballbot_ros.analysis.loop_figure import render_loop
    from ballbot_ros.controllers.design.linear_model import DesignError
    from ballbot_ros.controllers.design.loop_analysis import analyse_ideal, analyse_sampled

    parameters = run.attached.parameters
    try:
        sampled = analyse_sampled(parameters)
    except DesignError:
        return None
    return LoopSection(
        margin_rows(analyse_ideal(parameters), sampled),
        list(findings(sampled)),
        neglected(parameters),
        predictions(sampled),
        render_loop(parameters, sampled),
    )


def report_page(
    assessment: Assessment,
    figures: list[RenderedFigure],
    loop: LoopSection | None = None,
    interactive: InteractiveFigures | None = None,
    processor: ProcessorSection | None = None,
    *,
    linked: bool = True,
) -> str:
    """Return the report as HTML.

    It shows the interactive figures instead of the pictures of the same content. With `linked`, it
    has links to the files next to it.
    """
    run = assessment.run
    scenario = run.attached.scenario
    predicted = loop.predictions if loop else []
    statuses = {status.node: status for _, status in run.statuses}
    return render_template(
        'report.html',
        title=f'{run.name}, run {run.number}' if run.count > 1 else run.name,
        purpose=scenario.purpose if scenario else '',
        assessment=assessment,
        banner=banner(run),
        facts=_facts(run),
        extent='' if run.complete else f'Only ticks up to {run.end:.3f} s count.',
        marks=_MARKS,
        metric_text=metric_text,
        metrics=[
            (metric_text(name, value), MEANINGS[name])
            for name, value in shown_metrics(assessment).items()
        ],
        figures=figures,
        interactive=interactive,
        loop=loop,
        processor=processor or ProcessorSection(),
        missing=MISSING,
        linked=linked,
        pushes=run.pushes,
        outside=outside_pushes(run.pushes),
        observations=[*limit_cycle_sentences(run, predicted), *offset_reasons(run)],
        topic_statistics=run.topic_statistics,
        statuses=statuses,
        problems=_problems(run),
        parameters=sorted(parameter_rows(run), key=lambda row: not row.is_changed),
        parameter_changes=[
            (each.time, each.tick, printable(each.name), printable(value_text(each.value)))
            for each in run.parameter_changes
        ],
        versions=run.attached.versions,
    )


def banner(run: RunData) -> list[str]:
    """Return the warnings that a reader needs before any number."""
    lines = list(run.notices)
    if run.damage:
        lines.insert(0, f'This recording is not complete: {run.damage}. The report covers what it '
                        f'has, up to {run.end:.3f} s.')  # fmt: skip
    if run.missing_ticks:
        lines.append(f'{run.missing_ticks} ticks are missing.')
    if not run.reached_end:
        duration = run.attached.parameters.of(PlantParameters).duration
        lines.append(f'The run ends at {run.end:.3f} s; its duration is {duration:g} s.')
    return lines


class MetricText(NamedTuple):
    """Name, value and unit of a metric as text."""

    label: str
    value: str
    unit: str


def metric_text(name: str, value: float) -> MetricText:
    """Return a metric as text."""
    words, unit = label(name)
    missing = 'never' if name == 'settling_time_s' else '–'
    return MetricText(words, number_text(value, missing), unit)


def _facts(run: RunData) -> list[tuple[str, str]]:
    attached = run.attached
    facts = [
        ('Recording', run.path.name),
        ('Run', f'{run.number} of {run.count}'),
        ('Length', f'{run.end:.3f} s'),
        ('Packets' if run.is_real else 'Ticks', str(len(run.motion.time))),
    ]
    if attached.scenario:
        facts.append(('Profile', attached.scenario.profile))
    if attached.controller and not run.is_real:
        facts.append(('Controller', attached.controller))
    if attached.has_parameters and not run.is_real:
        facts.append(('Plant model', str(run.plant.plant_model)))
        facts.append(('Seed', str(attached.parameters.of(GyroParameters).seed)))
    if parent := Parent.decode(attached.files):
        facts.append(('Branch of', str(parent)))
    facts += [
        (f'External {role}', program)
        for role, program in attached.external.items()
        if role != CONTROLLER
    ]
    return facts


def _problems(run: RunData) -> dict[tuple[str, str], float]:
    """Return node and text of each warning and error, with the time of its first report."""
    problems: dict[tuple[str, str], float] = {}
    for time, status in run.statuses:
        if status.level in (1, 2):
            problems.setdefault((status.node, status.message), time)
    return problems
