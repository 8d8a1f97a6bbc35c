"""`ballbot install`: the packages that commands need beyond those of a first run."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from ballbot_ros.cli.installation import EXTRAS, install, missing


@click.command('install')
@click.argument('extras', nargs=-1, type=click.Choice([*EXTRAS]), metavar='[EXTRA]...')
def command(extras: tuple[str, ...]) -> int:
    """Install the packages of each EXTRA, or list the extras with their sizes.

    A command that needs an extra offers to install it. `all` installs what any of them needs,
    before a journey without a network, for example.
    """
    for name, extra in EXTRAS.items():
        if not extras:
            state = f'{extra.size_mb} MB' if missing(name) else 'installed'
            click.echo(f'{name:10}{state:>10}  {extra.purpose}')
    packages = [package for each in extras for package in missing(each)]
    if packages:
        size_mb = sum(EXTRAS[each].size_mb for each in extras)
        install(packages, size_mb, Path(sys.prefix, 'setup.log'))
    if extras:
        click.echo(f'installed  {", ".join(extras)}')
    return 0
