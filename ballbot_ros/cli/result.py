"""The result of a run as a table and as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence

from rich.console import Console
from rich.table import Column, Table
from rich.text import Text

from ballbot_ros.analysis.metrics import Judgement, PropertyJudgement, number, with_judgements
from ballbot_ros.analysis.recorded_controller import ControllerIdentity
from ballbot_ros.analysis.recorded_scenario import RecordedPush, outside_pushes
from ballbot_ros.cli.progress import Progress
from ballbot_ros.engine.scenario.metrics import label as metric_label
from ballbot_ros.engine.scenario.metrics import lacks_times
from ballbot_ros.errors import short_text
from ballbot_ros.files import next_steps
from ballbot_ros.parameters import ControllerParameters, GyroParameters
from ballbot_ros.process import stdout_to_stderr
from ballbot_ros.run.execution import execute
from ballbot_ros.run.node_process import ForkClient
from ballbot_ros.run.result import RunResult
from ballbot_ros.run.spec import RunOptions, RunSpec


def result_json(spec: RunSpec, result: RunResult) -> dict[str, object]:
    """Return the result as a JSON object; a missing number is None."""
    return {
        'scenario': spec.name,
        'processes': spec.processes.value,
        'engine': result.engine.value,
        'seed': _seed(spec),
        'controller': _controller(spec),
        'external': list(spec.external),
        'outcome': result.verdict.value,
        'reason': result.reason,
        'duty_sha256': result.duty_sha256,
        'ticks': result.ticks,
        'real_time_factor': result.real_time_factor,
        'late_ticks': result.late_ticks,
        'resends': result.resends,
        'round_trip_ms': result.round_trip._asdict() if result.round_trip else None,
        'participants': list(result.participants),
        'external_pushes': [push.as_json() for push in result.external_pushes],
        'parameter_changes': [each.as_json() for each in result.parameter_changes],
        'recording': None if result.recording is None else str(result.recording),
        'figure': None if result.figure is None else str(result.figure),
        'metrics': {name: number(value) for name, value in result.metrics.items()},
        'expectations': [
            {**each.as_json(), 'holds': each.holds if result.is_complete else None}
            for each in result.judgements
        ],
        'properties': [
            {**each.as_json(), 'holds': each.holds if result.is_complete else None}
            for each in result.properties
        ],
    }


def _controller(spec: RunSpec) -> dict[str, object]:
    """Return the controller of a run: its name, and of another than the document's what it is."""
    if spec.controller is None:
        name = spec.parameters.of(ControllerParameters).implementation
        return {'name': name, 'sha256': None, 'portable': True}
    identity = ControllerIdentity.of(spec.controller)
    return {
        'name': identity.reference,
        'sha256': identity.sha256,
        'portable': identity.portable,
    }


def _seed(spec: RunSpec) -> int:
    return spec.parameters.of(GyroParameters).seed


def print_table(spec: RunSpec, result: RunResult) -> None:
    """Print the result as a table, and the paths of the files."""
    console = Console(highlight=False, markup=False)
    table = Table(
        'metric', Column('value', justify='right'), 'expected', '',
        title=f'{spec.name}, seed {_seed(spec)}', title_justify='left',
    )  # fmt: skip
    if not all(map(math.isnan, result.metrics.values())):  # as before the release
        mode = spec.parameters.of(ControllerParameters).mode
        is_driven = bool(spec.scenario.segments) or mode == 'autonomous'
        for name, value, judgement in with_judgements(result.metrics, result.judgements):
            never_stands = is_driven and name == 'settling_time_s'
            if judgement or not (never_stands or lacks_times(name, value)):
                _add_metric(table, name, value, judgement, marked=result.is_complete)
    _add_properties(table, result.properties, marked=result.is_complete)
    _add_pushes(table, result.external_pushes)
    table.add_section()
    if result.real_time_factor:
        table.add_row('real-time factor', f'{result.real_time_factor:.1f}', '', '')
    if result.round_trip:
        text = ' / '.join(f'{trip_ms:.2f}' for trip_ms in result.round_trip)
        table.add_row('tick round trip p50 / p99 / max', f'{text} ms', '', '')
    table.add_row('ticks', str(result.ticks), '', '')
    table.add_row('late ticks', str(result.late_ticks or 0), '', '')
    console.print(table)
    colour = 'green' if result.exit_status == 0 else 'red'
    reason = f': {result.reason}' if result.reason else ''
    console.print(Text.assemble((result.verdict.value, colour), reason), soft_wrap=True)
    if outside := outside_pushes(result.external_pushes):
        console.print(outside, soft_wrap=True)
    if spec.controller:
        identity = ControllerIdentity.of(spec.controller)
        console.print(f'controller  {identity.description}', soft_wrap=True)
    for row in result.participants:
        if row['role'] in spec.external:
            since = f', since {row["since_s"]:.3f} s' if row['successor'] else ''
            program = short_text(str(row['implementation']))
            text = f'external  {row["role"]}: {row["node"]}{since}, {program}'
            console.print(text, soft_wrap=True)
    for label, path in (('recording', result.recording), ('picture', result.figure)):
        if path:
            console.print(f'{label}  {path}', soft_wrap=True)
    for line in next_steps(result.recording) if result.recording else ():
        console.print(line, soft_wrap=True)


def _add_pushes(table: Table, pushes: Sequence[RecordedPush]) -> None:
    if pushes:
        table.add_section()
    for push in pushes:
        words = f'{push.interval.name}, {push.start:.3f} s to {push.end:.3f} s'
        table.add_row(words, push.strength, '', '')


def _mark(judgement: Judgement | PropertyJudgement) -> Text:
    return Text('✓', 'green') if judgement.holds else Text('✗', 'red')


def _add_properties(table: Table, judged: Sequence[PropertyJudgement], *, marked: bool) -> None:
    if judged:
        table.add_section()
    for each in judged:
        space = '' if each.of.unit in ('', '°') else ' '
        value = f'{each.robustness:.3f}{space}{each.of.unit}'
        shown = value if math.isfinite(each.robustness) else '–'
        table.add_row(each.of.name, shown, each.outcome, _mark(each) if marked else '')


def _add_metric(
    table: Table, name: str, value: float, judgement: Judgement | None, *, marked: bool
) -> None:
    words, unit = metric_label(name)
    space = '' if unit in ('', '°') else ' '
    shown, expected, mark = f'{value:.3f}{space}{unit}', '', Text()
    if math.isnan(value):
        shown = 'never' if name == 'settling_time_s' else '–'
    if judgement:
        expected = str(judgement.expectation)
        if marked:
            mark = _mark(judgement)
        if judgement.expectation.window:
            words = f'{words}, {judgement.expectation.window}'
    table.add_row(words, shown, expected, mark)


def load_run(reference: str, options: RunOptions) -> RunSpec:
    """Return the run of a scenario, given by name or file."""
    with stdout_to_stderr():  # a controller may print while its class is loaded
        return RunSpec.of_scenario(reference, options)


def print_result(spec: RunSpec, result: RunResult, *, as_json: bool) -> None:
    """Print the result of a run, as a table or as one JSON object."""
    if as_json:
        print(json.dumps(result_json(spec, result), indent=2, allow_nan=False))
    else:
        print_table(spec, result)


def execute_and_print(
    spec: RunSpec, client: ForkClient | None = None, *, as_json: bool
) -> RunResult:
    """Execute a run with a progress bar, print its result and return it.

    `client` forks the nodes that are separate processes.
    """
    with Progress(spec.name, spec.plant.duration) as progress, stdout_to_stderr():
        result = execute(spec, progress, client=client)
        progress.release(result.reason)
    print_result(spec, result, as_json=as_json)
    return result
