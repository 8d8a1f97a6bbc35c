"""`ballbot new`: projects of your own."""

from __future__ import annotations

import shlex
import shutil
import sys
from pathlib import Path

import click

from ballbot_ros.cli.path_types import PATH
from ballbot_ros.controllers.loading import shown_path
from ballbot_ros.controllers.new_package import SCENARIO, write_package


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
    for path in write_package(output, name):
        print(f'wrote  {path}')
    folder = output / name
    scenario = folder / SCENARIO.format(name=name)
    ballbot, python = _program('ballbot'), _program(Path(sys.executable).name)
    print()
    for purpose, words in (
        ('run it', [ballbot, 'run', str(scenario)]),
        ('install it', [python, '-m', 'pip', 'install', '-e', f'{folder}[test]']),
        ('use its name', [ballbot, 'run', 'stationary', '--controller', name]),
        ('test it', [python, '-m', 'pytest', str(folder)]),
    ):
        print(f'{purpose + ":":<13} {shlex.join(words)}')


def _program(name: str) -> str:
    """Return how to call a program of this environment: by its name, if that is enough."""
    path = Path(sys.executable).with_name(name)
    return name if shutil.which(name) == str(path) or not path.exists() else shown_path(path)
