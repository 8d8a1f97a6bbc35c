"""`ballbot design`: the model, the servo gains, and what the loop can bear."""

from __future__ import annotations

import json
from pathlib import Path

import click

from ballbot_ros.cli.options import set_option
from ballbot_ros.cli.path_types import NEW_FILE, PATH
from ballbot_ros.cli.redesign import (
    Method,
    Redesign,
    delay_ms,
    five_poles,
    five_weights,
    format_gains,
    positive_weight,
)
from ballbot_ros.cli.value_types import Choice
from ballbot_ros.cli.written_file import command_line, heading, write_file
from ballbot_ros.codegen.implementation import compose_controller
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
    '--method',
    type=Choice([str(each) for each in Method]),
    help='Design other gains: lqr for the ideal loop; dlqr or place for the loop as it runs, with '
    'its filters and dead times; lqg for the controller of this name.',
)
@click.option(
    '--q',
    callback=five_weights,
    metavar='Q,Q,Q,Q,Q',
    help='Weights of θ, ψ, θ˙, ψ˙ and the integral of θ, with angles in degrees.  '
    "[default: section 4.2; lqg: the controller's]",
)
@click.option(
    '--r',
    callback=positive_weight,
    metavar='R',
    help="Weight of the motor voltage in V.  [default: section 4.2; lqg: the controller's]",
)
@click.option(
    '--poles',
    callback=five_poles,
    metavar='P,P,P,P,P',
    help='Poles of the loop in 1/s, such as -0.3,-0.6+0.6j,-0.6-0.6j,-5,-7; it has others, which '
    'follow from them.',
)
@click.option(
    '--delay',
    callback=delay_ms,
    metavar='MS',
    help='Dead time of the motors to design for, 0 … 100 ms.  [default: plant_sim.actuator_delay]',
)
@click.option(
    '--output',
    type=NEW_FILE,
    help='Parameter file to write or replace, with the designed gains, for the option --params of '
    'a run.',
)
@click.option(
    '--plot',
    type=NEW_FILE,
    help='PNG to write or replace: Bode and Nyquist diagram, poles, responses to the stick and to '
    'a push.',
)
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
@click.option(
    '--controller',
    metavar='CONTROLLER',
    help='Design the gains of this controller instead, and print a parameter file for its node: '
    'the name of an installed one, package.module:Class, or FILE.py:Class.',
)
@click.pass_context
def command(
    context: click.Context,
    parameter_file: Path | None,
    assignments: tuple[str, ...],
    method: str | None,
    q: tuple[float, ...] | None,
    r: float | None,
    poles: tuple[complex, ...] | None,
    delay: float | None,
    output: Path | None,
    plot: Path | None,
    as_json: bool,
    controller: str | None,
) -> None:
    """Print the model, the servo gains, and what the loop can bear: ideal, and as it runs.

    The ideal loop is the document's: state feedback in continuous time. The loop that runs samples
    every 4 ms, filters, and has the dead times of motors and samples.

    With --method, the gains are designed first.
    """
    redesign = Redesign.of(method, q=q, r=r, poles=poles, delay=delay)
    if redesign and controller:
        raise click.UsageError('--controller has a design of its own: omit --method')
    if output and not (redesign or controller):
        raise click.UsageError('--output needs --method or --controller')
    parameters = read_parameter_file(parameter_file) if parameter_file else ParameterSet()
    for assignment in assignments:
        assign(parameters, assignment)
    if controller:
        parameters.set(CONTROLLER, 'implementation', controller, '--controller')
    if redesign:
        redesign.apply(parameters)
    if controller or (redesign and redesign.method is Method.LQG):
        if plot or as_json:
            option = '--controller' if controller else '--method lqg'
            raise click.UsageError(f'{option} prints a parameter file: omit --plot and --json')
        with stdout_to_stderr():  # it may print while its class is loaded
            compose_controller(parameters)
        text = heading(command_line(context)) + format_parameters(parameters, [CONTROLLER])
        if output:
            write_file('--output', output, text.encode())
        else:
            click.echo(text, nl=False)
        return
    # Imported only here: it takes two seconds.
    from ballbot_ros.cli.design_output import DesignOutput

    design = DesignOutput(parameters, is_redesigned=redesign is not None)
    written = []
    if plot:
        write_file('--plot', plot, design.plot())
        written.append(f'plot  {plot}')
    if output:  # last, so that a command that failed has written no gains
        write_file('--output', output, format_gains(parameters, command_line(context)).encode())
        written.append(f'gains  {output}')
    if as_json:
        click.echo(json.dumps(design.as_json(), indent=2, allow_nan=False))
        return
    design.print()
    for line in written:
        click.echo(line)
