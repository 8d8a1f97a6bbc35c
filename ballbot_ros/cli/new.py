"""`ballbot new`: start something of your own."""

from __future__ import annotations

import shlex
import shutil
import sys
from pathlib import Path

import click

from ballbot_ros.cli.path_types import PATH


@click.group('new')
def command() -> None:
    """Start something of your own, from files that run as they are."""


@command.command('controller')
@click.argument('name')
@click.option(
    '--output', type=PATH, default=Path(), help="The package's folder is DIR/NAME.  [default: .]"
)
def controller(name: str, output: Path) -> None:
    """Write the package NAME with a controller that balances, its scenario and its tests.

    NAME has lower case letters, digits and single underscores, such as my_pid. It is also the name
    of the controller.
    """
    from ballbot_ros.controllers.new_package import SCENARIO, write_package

    for path in write_package(output, name):
        print(f'wrote  {path}')
    folder = output / name
    scenario = folder / SCENARIO.format(name=name)
    python = _python()
    print()
    for purpose, words in (
        ('run it', ['ballbot', 'run', str(scenario)]),
        ('install it', [python, '-m', 'pip', 'install', '-e', f'{folder}[test]']),
        ('then', ['ballbot', 'run', 'stationary', '--controller', name]),
        ('test it', [python, '-m', 'pytest', str(folder)]),
    ):
        print(f'{purpose + ":":<11} {shlex.join(words)}')


def _python() -> str:
    """Return how to call this Python: by its name, if that is enough."""
    return 'python' if shutil.which('python') == sys.executable else sys.executable
