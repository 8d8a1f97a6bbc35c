"""`ballbot commission`: a profile of a robot from logs of the commissioning program."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ballbot_ros.cli.options import NEW_FILE, RECORDING, heading, known_profile_option, write_file
from ballbot_ros.errors import BallbotError, printable
from ballbot_ros.parameters import (
    CONTROLLER,
    GyroParameters,
    ParameterSet,
    PlantParameters,
    parameters_of,
)
from ballbot_ros.parameters.files import values_text

if TYPE_CHECKING:
    from ballbot_ros.analysis.identification.commissioning import Commissioning, MeasuredParameter

_DIGITS = 6


@click.command('commission')
@click.argument('logs', nargs=-1, required=True, type=RECORDING, metavar='LOG...')
@known_profile_option
@click.option(
    '--output',
    type=NEW_FILE,
    default='robot.yaml',
    show_default=True,
    help='Profile to write, for --profile of other commands; the picture is next to it, as PNG. '
    'Neither may exist.',
)
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
@click.pass_context
def command(
    context: click.Context, logs: tuple[Path, ...], profile: str, output: Path, as_json: bool
) -> None:
    """Measure gyros and motors of a robot from LOGs of the commissioning program.

    Each LOG is a recording of `ballbot brick drive`, or a data log, of one robot. Two with
    different battery voltages tell all of equation (6.1). Prints the parameters with 95 %
    intervals, and whether cables and signs are right, and writes a profile with a picture.

    Exit status: 0 if something was measured; 2 if nothing was, or for invalid arguments.
    """
    # Imported only here: it takes half a second.
    from ballbot_ros.analysis.identification.commissioning import commission
    from ballbot_ros.analysis.identification.commissioning_figure import render_commissioning
    from ballbot_ros.engine.scenario.reader import load_profile

    if output.suffix not in ('.yaml', '.yml'):
        raise BallbotError(f'--output {output}: must end in .yaml, so that --profile takes it')
    picture = output.with_suffix('.png')
    for path in (output, picture):
        if path.exists():
            raise BallbotError(f'--output {path}: exists; choose another name')
    if len({path.resolve() for path in logs}) < len(logs):
        raise click.UsageError('a log is given twice: it would count twice')
    known = load_profile(profile)
    found = commission(logs, known.of(PlantParameters), known.of(GyroParameters))
    measured = ParameterSet(known)
    for each in found.parameters:
        measured.set(each.node, each.name, _allowed(each))
    text = heading(context) + _profile_text(measured)
    write_file('--output', picture, render_commissioning(found))
    write_file('--output', output, text.encode())
    if as_json:
        click.echo(json.dumps(_as_json(found, known), indent=2, allow_nan=False))
    else:
        _print(found, known)
        click.echo(f'picture  {picture}\nprofile  {output}')


def _print(found: Commissioning, known: ParameterSet) -> None:
    """Print logs, values, checks and notes."""
    from rich.console import Console
    from rich.table import Table

    from ballbot_ros.cli.identify_output import typeset, with_interval
    from ballbot_ros.cli.options import print_whole

    console = Console(highlight=False, markup=False)
    for log in found.logs:
        low, high = float(log.battery.min()), float(log.battery.max())
        console.print(
            f'{printable(str(log.path))}  {log.time[-1]:.1f} s, battery {low:.2f} to {high:.2f} V',
            soft_wrap=True,
        )
    table = Table(title='Measured, with 95 % intervals', title_justify='left')
    table.add_column('parameter', no_wrap=True)
    for name in ('value', 'unit', 'x, B', 'y, C', 'profile'):
        table.add_column(name, justify='left' if name == 'unit' else 'right', no_wrap=True)
    for each in found.parameters:
        of_devices = [typeset(f'{part.value:.4g}') for part in each.of_devices.values()]
        if len(of_devices) < 2:  # an offset
            of_devices = ['', '']
        table.add_row(
            f'{each.node}.{each.name}',
            with_interval(*each.estimate),
            parameters_of(each.node)[each.name].unit,
            *of_devices,
            typeset(f'{getattr(known.of_node(each.node), each.name):.6g}'),
        )
    print_whole(console, table)
    for line in found.checks:
        console.print(line, soft_wrap=True)
    for line in found.notes:
        console.print(f'note: {line}', soft_wrap=True)


def _as_json(found: Commissioning, known: ParameterSet) -> dict[str, object]:
    return {
        'parameters': {
            f'{each.node}.{each.name}': {
                'value': each.estimate.value,
                'half_width': each.estimate.half_width,
                'unit': parameters_of(each.node)[each.name].unit,
                'profile': getattr(known.of_node(each.node), each.name),
                'of_devices': {name: part._asdict() for name, part in each.of_devices.items()},
            }
            for each in found.parameters
        },
        'checks': found.checks,
        'notes': found.notes,
    }


def _allowed(each: MeasuredParameter) -> float:
    """Return the value, or the bound that it is beyond: of nothing, slightly less can be found."""
    low, high = parameters_of(each.node)[each.name].bounds or (each.estimate.value,) * 2
    return float(f'{min(max(each.estimate.value, low), high):.{_DIGITS}g}')


def _profile_text(parameters: ParameterSet) -> str:
    values: dict[str, dict[str, Any]] = {}
    own = [(CONTROLLER, *each) for each in parameters.undeclared.items()]
    for node, name, value in (*parameters, *own):
        values.setdefault(node, {})[name] = value
    return values_text(values)
