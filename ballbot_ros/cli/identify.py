"""`ballbot identify`: physical parameters of the robot from recordings or data logs of its runs."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.table import Table

from ballbot_ros.analysis.identification.identification import (
    MAX_HALF_WIDTH,
    ExperimentSummary,
    Identifiability,
    Identification,
    IdentifiedParameter,
)
from ballbot_ros.cli.options import (
    NEW_FILE,
    PATH,
    RECORDING,
    command_line,
    heading,
    split_at_commas,
    write_file,
)
from ballbot_ros.cli.progress import file_progress
from ballbot_ros.errors import BallbotError, printable
from ballbot_ros.parameters import PLANT, ParameterSet, Value, parameters_of
from ballbot_ros.parameters.files import assign, format_parameters, read_parameter_file

if TYPE_CHECKING:
    from ballbot_ros.analysis.identification.experiment import Experiment


@click.command('identify')
@click.argument(
    'recordings', nargs=-1, required=True, type=RECORDING, metavar='RUN.mcap|LOG.csv...'
)
@click.option(
    '--fit',
    'names',
    multiple=True,
    callback=split_at_commas,
    metavar='NAME,NAME...',
    help='Parameters of plant_sim to identify, the most wanted first; can be repeated.  [default: '
    'those that are hard to measure]',
)
@click.option(
    '--check',
    'checks',
    multiple=True,
    type=RECORDING,
    metavar='RUN.mcap|LOG.csv',
    help='Recording or data log that is not fitted, to check the result with; can be repeated.',
)
@click.option(
    '--truth',
    is_flag=True,
    help="Use the plant's true states instead of the readings of the sensors.",
)
@click.option(
    '--params',
    'parameter_file',
    type=PATH,
    help='Parameter file with what is known of the robot: its values of plant_sim replace the '
    'recorded ones. Identified parameters start from them.',
)
@click.option(
    '--set',
    'assignments',
    multiple=True,
    metavar='NODE.PARAM=VALUE',
    help='Set one value as --params does, such as plant_sim.body_mass=0.75; can be repeated.',
)
@click.option(
    '--run',
    'number',
    type=click.IntRange(1),
    help='Number of the run in a file with several, from 1.  [default: the last]',
)
@click.option(
    '--output',
    type=NEW_FILE,
    help='Parameter file to write or replace, with the identified parameters, for the option '
    '--params of a run.',
)
@click.option(
    '--plot',
    type=NEW_FILE,
    help='PNG to write or replace: the values with their intervals, and the correlations of their '
    'errors.',
)
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
@click.pass_context
def command(
    context: click.Context,
    recordings: tuple[Path, ...],
    names: list[str],
    checks: tuple[Path, ...],
    truth: bool,
    parameter_file: Path | None,
    assignments: tuple[str, ...],
    number: int | None,
    output: Path | None,
    plot: Path | None,
    as_json: bool,
) -> None:
    """Identify physical parameters of the robot from recordings of its runs.

    Prints which parameters the recordings can tell apart, their values with 95 % intervals, and
    how well the model then describes the readings.

    A data log of the brick, LOG.csv, can take the place of a recording. It has no duties, and tells
    little but the height of the body.

    Exit status: 0 if a parameter was identified; 2 if none was, for invalid arguments or a file
    that is neither a recording of a ballbot nor a data log.
    """
    # Imported only here: it takes half a second.
    from ballbot_ros.analysis.identification.identification import (
        HARD_TO_MEASURE,
        check_names,
        identify,
    )
    from ballbot_ros.cli.identify import IdentifyOutput

    if number and (len(recordings) > 1 or _is_log(recordings[0])):
        raise click.UsageError('--run needs exactly one recording')
    names = names or list(HARD_TO_MEASURE)
    check_names(names)
    _require_different(recordings, checks)
    known = _known(parameter_file, assignments)
    experiments = [_read(path, number, known, truth) for path in recordings]
    further = [_read(path, None, known, truth) for path in checks]
    start = {name: value for name in names if isinstance(value := known.get(name), float)}
    with file_progress('identifying') as progress:
        found = identify(experiments, names, start, further, progress)
    result = IdentifyOutput(found)
    if as_json:
        click.echo(json.dumps(result.as_json(), indent=2, allow_nan=False))
    else:
        result.print()
    if not result.identified:
        raise BallbotError(
            'nothing was identified: record a run in which the robot is driven, such as the '
            'scenario `excitation`'
        )
    written = []
    if plot:
        from ballbot_ros.analysis.identification.figure import render_identification

        write_file('--plot', plot, render_identification(found))
        written.append(f'plot  {plot}')
    if output:  # last, so that a command that failed has written no parameters
        text = heading(command_line(context)) + result.parameter_file()
        write_file('--output', output, text.encode())
        written += [f'parameters  {output}', *result.corrections]
    if not as_json:
        for line in written:
            click.echo(line)


def _require_different(recordings: Sequence[Path], checks: Sequence[Path]) -> None:
    """Raise an error if a file is given twice: it would count twice, or check itself."""
    fitted, checked = _resolved(recordings), _resolved(checks)
    for path, file in zip(recordings, fitted, strict=True):
        if fitted.count(file) > 1:
            raise click.UsageError(f'{path}: is given twice')
    for path, file in zip(checks, checked, strict=True):
        if file in fitted:
            raise click.UsageError(
                f'--check {path}: is fitted, too; check with a recording that is not'
            )
        if checked.count(file) > 1:
            raise click.UsageError(f'--check {path}: is given twice')


def _is_log(path: Path) -> bool:
    return path.suffix.lower() == '.csv'


def _resolved(paths: Sequence[Path]) -> list[Path]:
    return [path.resolve() for path in paths]


def _known(parameter_file: Path | None, assignments: Sequence[str]) -> dict[str, Value]:
    """Return the values of the plant that were given, by name."""
    parameters = read_parameter_file(parameter_file) if parameter_file else ParameterSet()
    for assignment in assignments:
        given = ParameterSet()
        assign(given, assignment)
        if not _of_plant(given):
            raise click.UsageError(f'--set {assignment}: identify takes parameters of {PLANT} only')
        parameters.update(given)
    return _of_plant(parameters)


def _of_plant(parameters: ParameterSet) -> dict[str, Value]:
    return {name: value for node, name, value in parameters if node == PLANT}


def _read(path: Path, number: int | None, known: Mapping[str, Value], truth: bool) -> Experiment:
    from ballbot_ros.analysis.identification.experiment import (
        logged_experiment,
        recorded_experiment,
    )
    from ballbot_ros.analysis.run_data import read_run

    if _is_log(path):
        if truth:
            raise click.UsageError(f'{path}: a data log has no true states, which --truth uses')
        return logged_experiment(path, known)
    with file_progress(path.name) as progress:
        run = read_run(path, number, progress)
    experiment = recorded_experiment(run, known, truth=truth)
    for line in run.notices:
        click.echo(f'note: {path}: {line}', err=True)
    return experiment


MAX_RATIO = 1.5
"""Residuals of a check, relative to those of the fit, from which the values do not describe it: the
root mean square over the channels. Of two runs of one robot, a single channel can differ more: what
gear play adds to the encoder's residual depends on a few segments."""

MAX_TABLE_WIDTH = 2000

_DIGITS = 2
"""Significant digits of half an interval."""

_EXACT = 1e-6
"""Half an interval, relative to the value, below which the value's digits are not all written."""

_WIDEST = 10.0
"""Half an interval, relative to the value, beyond which its width does not matter."""

_FIXED = 1e-3
"""Values from here on are written without an exponent."""


class IdentifyOutput:
    """An identification as text, JSON and parameter file."""

    def __init__(self, found: Identification) -> None:
        self._found = found

    @property
    def identified(self) -> tuple[IdentifiedParameter, ...]:
        """The parameters whose intervals are narrow enough to rely on."""
        return tuple(
            row for row in self._found.estimated if row.verdict is Identifiability.IDENTIFIED
        )

    def print(self) -> None:
        """Print recordings, verdicts, values and residuals."""
        console = Console(highlight=False, markup=False)
        found = self._found
        for number, (role, each) in enumerate(self._recordings, 1):
            console.print(_recording_line(number, role, each), soft_wrap=True)
            for note in each.notes:
                console.print(f'   {printable(note)}', soft_wrap=True)
        console.print(_verdict_table(found.parameters))
        if found.estimated:
            _print_whole(console, _value_table(found.estimated))
            console.print(_residual_table(self._recordings))
        for line in self.warnings:
            console.print(f'warning: {line}', soft_wrap=True)

    @property
    def warnings(self) -> list[str]:
        """The checks that the values do not describe."""
        if not self._found.estimated:
            return []
        fits = self._found.experiments
        lines = []
        for check in self._found.checks:
            ratios = [
                residual / fitted
                for channel, residual in check.after.items()
                if (fitted := max(each.after.get(channel, 0.0) for each in fits)) > 0.0
            ]
            ratio = math.sqrt(sum(each**2 for each in ratios) / max(1, len(ratios)))
            if ratio > MAX_RATIO:
                lines.append(
                    f'the residuals of {printable(check.name)} are {ratio:.2g} times those of the '
                    f'fit, more than {MAX_RATIO:g}: the values do not describe this recording'
                )
        return lines

    @property
    def corrections(self) -> list[str]:
        """What the parameter file has instead of a value out of bounds."""
        return [
            f'{row.name} is below its bound: the file has {_number(_allowed(row))}'
            for row in self.identified
            if _allowed(row) != row.value
        ]

    def parameter_file(self) -> str:
        """Return a parameter file with the identified parameters, within their bounds."""
        parameters = ParameterSet()
        for row in self.identified:
            parameters.set(PLANT, row.name, _allowed(row))
        return format_parameters(parameters, [PLANT], [row.name for row in self.identified])

    def as_json(self) -> dict[str, object]:
        """Return the content as JSON; a number that is not finite or does not exist is null."""
        found = self._found
        return {
            'parameters': {row.name: _parameter_json(row) for row in found.parameters},
            'recordings': [_recording_json(each) for each in found.experiments],
            'checks': [_recording_json(each) for each in found.checks],
            'warnings': self.warnings,
            'correlation': {
                'names': [row.name for row in found.estimated],
                'matrix': [[_finite(value) for value in row] for row in found.correlation.tolist()],
            },
        }

    @property
    def _recordings(self) -> list[tuple[str, ExperimentSummary]]:
        return [
            *(('fitted', each) for each in self._found.experiments),
            *(('checked with', each) for each in self._found.checks),
        ]


def _recording_line(number: int, role: str, each: ExperimentSummary) -> str:
    segments = 'segment' if each.segments == 1 else 'segments'
    dropped = f', {each.dropped} dropped' if each.dropped else ''
    return (
        f'{number}  {printable(each.name)}  {role}: {each.seconds:.1f} s in {each.segments} '
        f'{segments}{dropped}'
    )


def _verdict_table(rows: Sequence[IdentifiedParameter]) -> Table:
    table = Table(title='What the recordings tell', title_justify='left')
    table.add_column('parameter', no_wrap=True)
    table.add_column('verdict', no_wrap=True)
    table.add_column('why')
    if any(row.value is None for row in rows):
        # The values of the others depend on it.
        table.add_column('kept at', justify='right', no_wrap=True)
    for row in rows:
        kept = [_number(row.start)] if row.value is None else []
        table.add_row(row.name, str(row.verdict), _reason(row), *kept)
    return table


def _reason(row: IdentifiedParameter) -> str:
    interval = f'{_percent(row.relative)} %'
    if row.verdict is Identifiability.NOT_TOLD_APART:
        return f'acts like {", ".join(row.alike) or "several together"}'
    if row.verdict is Identifiability.NOT_SEEN and not math.isfinite(row.relative):
        return 'no trace in the readings'
    if row.verdict is Identifiability.NOT_SEEN and row.relative > _WIDEST:
        return f'> ± {100.0 * _WIDEST:g} % as the only unknown'
    if row.verdict is Identifiability.NOT_SEEN:
        return f'{interval} as the only unknown'
    if row.verdict is Identifiability.UNCERTAIN:
        return f'{interval}, more than {100.0 * MAX_HALF_WIDTH:g} %'
    return interval


def _value_table(rows: Sequence[IdentifiedParameter]) -> Table:
    has_recorded = any(row.recorded is not None for row in rows)
    table = Table(title='Values with 95 % intervals', title_justify='left')
    table.add_column('parameter', no_wrap=True)
    table.add_column('value', justify='right', no_wrap=True)
    table.add_column('[%]', justify='right', no_wrap=True)
    table.add_column('unit', no_wrap=True)
    table.add_column('start', justify='right', no_wrap=True)
    if has_recorded:
        table.add_column('recorded', justify='right', no_wrap=True)
    for row in rows:
        assert row.value is not None
        cells = [
            row.name, with_interval(row.value, row.half_width), _percent(row.relative), row.unit,
            _number(row.start),
        ]  # fmt: skip
        if has_recorded:
            cells.append(_recorded(row))
        table.add_row(*cells, style='dim' if row.verdict is Identifiability.UNCERTAIN else None)
    return table


def with_interval(value: float, half_width: float) -> str:
    """Return value ± half width: two significant digits of the latter, the value as far as it.

    A value with an interval that is infinite or tiny has six digits.
    """
    if not _EXACT * abs(value) < half_width < math.inf:
        return f'{_number(value)} ± {_number(float(f"{half_width:.{_DIGITS - 1}e}"))}'
    exponent = 0
    if (largest := max(abs(value), half_width)) < _FIXED:
        exponent = math.floor(math.log10(largest))
    scale = 10.0**-exponent
    # Rounded first: 0.0996 has the two digits 0.10.
    half = float(f'{half_width * scale:.{_DIGITS - 1}e}')
    places = max(0, _DIGITS - 1 - math.floor(math.log10(half)))
    text = f'{value * scale + 0.0:.{places}f} ± {half:.{places}f}'.replace('-', '−')
    return f'({text})e{exponent}'.replace('e-', 'e−') if exponent else text


def _recorded(row: IdentifiedParameter) -> str:
    if row.recorded is None or row.value is None:
        return '–'
    return f'{_number(row.recorded)} {"✓" if row.covers_recorded else "✗"}'


def _residual_table(recordings: Sequence[tuple[str, ExperimentSummary]]) -> Table:
    table = Table(title='Residuals, RMS', title_justify='left')
    table.add_column('recording', no_wrap=True)
    table.add_column('channel', no_wrap=True)
    for column in ('at the start', 'with the values'):
        table.add_column(column, justify='right', no_wrap=True)
    table.add_column('unit', no_wrap=True)
    for number, (role, each) in enumerate(recordings, 1):
        if not each.segments:
            continue
        label = f'{number} {role}'
        for channel, before in each.before.items():
            after = each.after[channel]
            table.add_row(
                label, channel, _three_digits(before), _three_digits(after), each.units[channel]
            )  # fmt: skip
            label = ''
        table.add_section()
    return table


def _allowed(row: IdentifiedParameter) -> float:
    """Return the value, or the bound that it is below: estimates may come out slightly negative."""
    bounds = parameters_of(PLANT)[row.name].bounds
    assert bounds
    assert row.value is not None
    return max(row.value, bounds[0])


def _parameter_json(row: IdentifiedParameter) -> dict[str, object]:
    return {
        'verdict': str(row.verdict),
        'alike': list(row.alike),
        'value': _finite(row.value),
        'half_width': _finite(row.half_width),
        'relative': _finite(row.relative),
        'unit': row.unit,
        'start': _finite(row.start),
        'recorded': _finite(row.recorded),
        'recorded_inside': row.covers_recorded,
        'allowed': None if row.value is None else _allowed(row),
    }


def _recording_json(each: ExperimentSummary) -> dict[str, object]:
    return {
        'recording': each.name,
        'seconds': each.seconds,
        'segments': each.segments,
        'dropped': each.dropped,
        'notes': list(each.notes),
        'residuals': {
            channel: {
                'before': _finite(each.before[channel]),
                'after': _finite(each.after[channel]),
                'unit': each.units[channel],
            }
            for channel in each.before
        },
    }


def _finite(value: float | None) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None


def _number(value: float) -> str:
    return _typeset(f'{value:.6g}')


def _typeset(number: str) -> str:
    return number.replace('inf', '∞').replace('e-0', 'e-').replace('-', '−')


def _three_digits(value: float) -> str:
    return _typeset(f'{value:#.3g}'.removesuffix('.'))


def _percent(relative: float) -> str:
    """Return a half width in percent."""
    percent = 100.0 * relative
    return _typeset(f'± {percent:.3g}' if percent >= 10.0 else f'± {percent:.2g}')


def _print_whole(console: Console, table: Table) -> None:
    """Print a table; let the terminal wrap its lines rather than truncate numbers."""
    options = console.options.update(max_width=MAX_TABLE_WIDTH)
    console.width = max(console.width, console.measure(table, options=options).maximum)
    console.print(table)
