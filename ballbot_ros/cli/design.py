"""`ballbot design`: the model, the servo gains, and what the loop can bear."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from ballbot_ros.cli.options import (
    NEW_FILE,
    Choice,
    FloatRange,
    heading,
    params_option_like,
    set_option,
    write_file,
)
from ballbot_ros.controllers.codegen.implementation import compose_controller
from ballbot_ros.controllers.design.redesign import LIMITS, OPTIONS, SIGNALS, Method, Redesign
from ballbot_ros.parameters import CONTROLLER, ParameterSet
from ballbot_ros.parameters.files import assign, format_parameters, read_parameter_file
from ballbot_ros.parameters.timing import TICK_MS
from ballbot_ros.process import stdout_to_stderr

LOOP_PARAMETERS = ('k_f', 'k_i', 'a_d', 'a_gd')
"""What makes the loop of the document's program."""


def _redesign(method: str | None, **options: Any) -> Redesign | None:
    """Return the design that options ask for; None without a method.

    It raises click.UsageError if the method needs another option, or does not take one of them.
    """
    given = {name: value for name, value in options.items() if value is not None}
    if method is None:
        if given:
            raise click.UsageError(f'--{min(given)} needs --method')
        return None
    redesign = Redesign(Method(method), **given)
    takes = OPTIONS[redesign.method]
    for option in given:
        if option not in takes:
            names = ', '.join(f'--{each}' for each in takes)
            raise click.UsageError(f'--{option}: --method {method} takes {names}')
    if redesign.method is Method.PLACE and redesign.poles is None:
        raise click.UsageError('--method place needs --poles')
    if redesign.method is Method.LQG and redesign.q and min(redesign.q) <= 0.0:
        raise click.UsageError('--q: --method lqg needs weights above 0')
    return redesign


Callback = Callable[[click.Context, click.Parameter, str | None], Any]


def _number_callback(
    kind: type[Any], wanted: str, is_allowed: Callable[[Any], bool], count: int = 0
) -> Callback:
    """Return a callback for an option whose value is a number, or some of them at commas.

    Parameters
    ----------
    kind : type
        Of a number: float or complex.
    wanted : str
        What is allowed, for messages.
    is_allowed : callable
        Whether a number is allowed.
    count : int
        How many numbers the value has; 0 if it is a single one.
    """

    def number(word: str) -> Any:
        try:
            converted = kind(word.replace(' ', ''))
        except ValueError:
            converted = None
        if converted is None or not is_allowed(converted):
            raise click.BadParameter(f'{word!r} is not {wanted}')
        return converted

    def callback(context: click.Context, option: click.Parameter, value: str | None) -> Any:
        if value is None:
            return None
        if not count:
            return number(value)
        words = value.split(',')
        if len(words) != count:
            raise click.BadParameter(f'{value!r}: {count} numbers are needed, not {len(words)}')
        return tuple(map(number, words))

    return callback


positive_weight = _number_callback(float, *LIMITS['r'])
delay_ms = _number_callback(float, *LIMITS['delay'])
five_weights = _number_callback(float, *LIMITS['q'], count=SIGNALS)
five_poles = _number_callback(
    complex, 'a pole, such as -7+5j', lambda value: math.isfinite(abs(value)), count=5
)


@click.command('design')
@params_option_like('Parameter file with physical values, dead times, gains and filters.')
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
    '--period',
    type=FloatRange(1.0, 20.0),
    metavar='MS',
    help='Analyse the loop as if task_ts1 had this period, 1 … 20 ms, with the same gains and time '
    'constants.  [default: 4]',
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
    period: float | None,
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
    redesign = _redesign(method, q=q, r=r, poles=poles, delay=delay)
    if redesign and controller:
        raise click.UsageError('--controller has a design of its own: omit --method')
    if output and not (redesign or controller):
        raise click.UsageError('--output needs --method or --controller')
    if period and (redesign or controller or plot):
        raise click.UsageError('--period only analyses: omit --method, --controller and --plot')
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
        text = heading(context) + format_parameters(parameters, [CONTROLLER])
        if output:
            write_file('--output', output, text.encode())
        else:
            click.echo(text, nl=False)
        return
    # Imported only here: it takes two seconds.
    from ballbot_ros.cli.design_output import DesignOutput

    period_ms = period or float(TICK_MS)
    design = DesignOutput(parameters, is_redesigned=redesign is not None, period_ms=period_ms)
    written = []
    if plot:
        write_file('--plot', plot, design.plot())
        written.append(f'plot  {plot}')
    if output:  # last, so that a command that failed has written no gains
        set_too = [name for node, name, _ in parameters if node == CONTROLLER]
        names = dict.fromkeys((*LOOP_PARAMETERS, *set_too))
        text = heading(context) + format_parameters(parameters, [CONTROLLER], names)
        write_file('--output', output, text.encode())
        written.append(f'gains  {output}')
    if as_json:
        click.echo(json.dumps(design.as_json(), indent=2, allow_nan=False))
        return
    design.print()
    for line in written:
        click.echo(line)
