"""`ballbot design`: the model, the servo gains, and what the loop can bear."""

from __future__ import annotations

import json
from pathlib import Path

import click

from ballbot_ros.cli.options import set_option
from ballbot_ros.cli.path_types import NEW_FILE, PATH
from ballbot_ros.codegen.implementation import compose_controller
from ballbot_ros.errors import BallbotError
from ballbot_ros.parameters import CONTROLLER, ParameterSet
from ballbot_ros.parameters.assignment import assign
from ballbot_ros.parameters.files import format_parameters, read_parameter_file
from ballbot_ros.standard_streams import stdout_to_stderr


@click.command('design')
@click.option(
    '--params',
    'parameter_file',
    type=PATH,
    help='Parameter file with physical values, dead times, gains and filters.',
)
@set_option
@click.option(
    '--plot',
    type=NEW_FILE,
    help='PNG to write: Bode and Nyquist diagram, poles, responses to the stick and to a push.',
)
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
@click.option(
    '--controller',
    metavar='CONTROLLER',
    help='Design the gains of this controller instead, and print a parameter file for its node: '
    'the name of an installed one, package.module:Class, or FILE.py:Class.',
)
def command(
    parameter_file: Path | None,
    assignments: tuple[str, ...],
    plot: Path | None,
    as_json: bool,
    controller: str | None,
) -> None:
    """Print the model, the servo gains, and what the loop can bear: ideal, and as it runs.

    The ideal loop is the document's: state feedback in continuous time. The loop that runs samples
    every 4 ms, filters, and has the dead times of motors and samples.
    """
    parameters = read_parameter_file(parameter_file) if parameter_file else ParameterSet()
    for assignment in assignments:
        assign(parameters, assignment)
    if controller is not None:
        if plot or as_json:
            raise click.UsageError('--controller prints a parameter file: omit --plot and --json')
        parameters.set(CONTROLLER, 'implementation', controller, '--controller')
        with stdout_to_stderr():  # it may print while its class is loaded
            compose_controller(parameters)
        click.echo(format_parameters(parameters, [CONTROLLER]), nl=False)
        return
    # Imported only here: it takes two seconds.
    from ballbot_ros.cli.design_output import DesignOutput

    output = DesignOutput(parameters)
    if plot:
        _write(plot, output.plot())
    if as_json:
        click.echo(json.dumps(output.as_json(), indent=2, allow_nan=False))
    else:
        output.print()
        if plot:
            click.echo(f'plot  {plot}')


def _write(path: Path, png: bytes) -> None:
    try:
        path.write_bytes(png)
    except OSError as error:
        raise BallbotError(f'--plot {path}: {error.strerror}') from None
