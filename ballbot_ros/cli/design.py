"""`ballbot design`: the model, its poles, and the servo gains next to the published ones."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ballbot_ros.cli.options import set_option
from ballbot_ros.cli.path_types import PATH
from ballbot_ros.codegen.implementation import compose_controller
from ballbot_ros.parameters import (
    CONTROLLER,
    ControllerParameters,
    ParameterSet,
    PlantParameters,
)
from ballbot_ros.parameters.assignment import assign
from ballbot_ros.parameters.files import format_parameters, read_parameter_file
from ballbot_ros.plant.model import Matrix, PhysicalParameters
from ballbot_ros.standard_streams import stdout_to_stderr

GAIN_NAMES = ('θ', 'ψ', 'θ̇', 'ψ̇', '∫θ')


@click.command('design')
@click.option(
    '--params',
    'parameter_file',
    type=PATH,
    help='Parameter file with physical values.',
)
@set_option
@click.option(
    '--controller',
    metavar='CONTROLLER',
    help='Design the gains of this controller instead, and print a parameter file for its node: '
    'the name of an installed one, package.module:Class, or FILE.py:Class.',
)
def command(
    parameter_file: Path | None, assignments: tuple[str, ...], controller: str | None
) -> None:
    """Print the model, its poles, and the servo gains next to the published ones."""
    parameters = read_parameter_file(parameter_file) if parameter_file else ParameterSet()
    for assignment in assignments:
        assign(parameters, assignment)
    if controller is None:
        _print_servo_design(parameters)
        return
    parameters.set(CONTROLLER, 'implementation', controller, '--controller')
    with stdout_to_stderr():  # it may print while its class is loaded
        compose_controller(parameters)
    click.echo(format_parameters(parameters, [CONTROLLER]), nl=False)


def _print_servo_design(parameters: ParameterSet) -> None:
    # Imported only here: it takes two seconds.
    from ballbot_ros.design.servo import PUBLISHED_GAIN, design_servo

    physical = PhysicalParameters.from_parameters(parameters.of(PlantParameters))
    design = design_servo(physical)
    console = Console(highlight=False, markup=False)

    title = Text('State equation (3.24)', 'bold')
    console.print(title + ', state θ ψ θ̇ ψ̇ in deg and deg/s, input in V')
    console.print(f'α = {physical.alpha:.6g} N·m/V   β = {physical.beta:.6g} N·m·s/rad')
    _print_matrix(console, 'A', design.a)
    _print_matrix(console, 'B', design.b)
    console.print(f'open-loop poles    {_poles(np.linalg.eigvals(design.a))} 1/s')
    console.print(f'closed-loop poles  {_poles(design.poles)} 1/s')
    lower, upper = design.gain_margins
    console.print(
        f'margins at the motor   gain {lower:.3g} … {"∞" if math.isinf(upper) else f"{upper:.3g}"}'
        f'   phase {design.phase_margin_deg:.1f}°   delay {design.delay_margin_s * 1e3:.0f} ms'
    )

    controller = parameters.of(ControllerParameters)
    in_use = (*controller.k_f, controller.k_i)
    table = Table(title='Servo gains', title_justify='left')
    for heading in ('', 'computed', 'published', 'in use'):
        table.add_column(heading, justify='right')
    rows = zip(GAIN_NAMES, design.gain, PUBLISHED_GAIN, in_use, strict=True)
    for name, computed, published, used in rows:
        table.add_row(name, f'{computed:.8f}', f'{published:g}', f'{used:.8f}')
    console.print(table)


def _print_matrix(console: Console, name: str, matrix: Matrix) -> None:
    for index, row in enumerate(matrix):
        label = f'{name} =' if index == 0 else ''
        console.print(f'{label:>4} ' + ' '.join(f'{value + 0.0:12.6g}' for value in row))


def _poles(poles: Iterable[complex]) -> str:
    """Return poles from slow to fast as text, with each conjugate pair as one word."""
    words = []
    for pole in sorted(poles, key=lambda p: (abs(p), p.imag)):
        if abs(pole.imag) < 1e-9:
            words.append(f'{pole.real + 0.0:.4g}')
        elif pole.imag > 0.0:
            words.append(f'{pole.real:.4g} ± {pole.imag:.4g}j')
    return '   '.join(words)
