"""`ballbot new`: projects of your own."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from ballbot_ros.cli.options import PATH
from ballbot_ros.controllers.new_package import SCENARIO, write_package
from ballbot_ros.files import own_command, program


@click.group('new')
def command() -> None:
    """Create a project of your own that runs right away."""


@command.command('controller')
@click.argument('name')
@click.option(
    '--output',
    type=PATH,
    default=Path(),
    metavar='DIR',
    help="The package's folder is DIR/NAME.  [default: .]",
)
def controller(name: str, output: Path) -> None:
    """Write the package NAME, with a controller that balances.

    The package has a scenario and tests, and runs as it is. NAME has lower case letters, digits and
    single underscores, such as my_pid; it is also the name of the controller.
    """
    folder = output / name
    for path in write_package(output, name):
        print(f'wrote  {path}')
    scenario = folder / SCENARIO.format(name=name)
    print()
    for purpose, command in (
        ('run it', own_command('run', scenario)),
        ('install it', f'{program("python")} -m pip install -e {shlex.quote(f"{folder}[test]")}'),
        ('use its name', own_command('run', 'stationary', '--controller', name)),
        ('test it', f'{program("python")} -m pytest {shlex.quote(str(folder))}'),
    ):
        print(f'{purpose + ":":<13} {command}')
