"""`ballbot install`: what commands need beyond a first run; offered at the first use of one."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path

import click

from ballbot_ros.cli.installation import EXTRAS, install, missing, name_of
from ballbot_ros.errors import BallbotError
from ballbot_ros.files import own_command

YES = '--yes'


def require(*extras: str) -> None:
    """As :func:`offer`; raise BallbotError if something is still missing."""
    offer(*extras)
    if wanted := [each for each in extras if missing(each)]:
        purposes = ' and '.join(EXTRAS[each].purpose for each in wanted)
        packages = ', '.join(name_of(package) for each in wanted for package in missing(each))
        remedy = own_command('install', *wanted)
        raise BallbotError(f'{purposes}: needs {packages}: `{remedy}`, or give {YES}')


def offer(*extras: str) -> None:
    """Install what is missing of some extras and restart the command, if the user agrees.

    Without a terminal nobody is asked: then nothing is installed, unless the command line has
    ``--yes`` or the environment ``CI``.
    """
    wanted = [each for each in extras if missing(each)]
    # A command that is called without its group has no such option.
    options = click.get_current_context().find_root().params
    is_agreed = options.get('yes', False) or bool(os.environ.get('CI'))
    if not wanted or not (is_agreed or (sys.stdin.isatty() and sys.stderr.isatty())):
        return
    packages, size_mb = _packages_of(wanted)
    purposes = ' and '.join(EXTRAS[each].purpose for each in wanted)
    click.echo(f'{purposes}: needs {", ".join(map(name_of, packages))}, {size_mb} MB', err=True)
    if is_agreed or click.confirm('install?', default=True, err=True):
        install(packages, size_mb, Path(sys.prefix, 'setup.log'))
        os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])


def _packages_of(extras: Sequence[str]) -> tuple[list[str], int]:
    """Return the requirements of extras that are not installed, and the size of the extras [MB]."""
    packages = dict.fromkeys(package for each in extras for package in missing(each))
    return list(packages), sum(EXTRAS[each].size_mb for each in extras)


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
    packages, size_mb = _packages_of(extras)
    if packages:
        install(packages, size_mb, Path(sys.prefix, 'setup.log'))
    if extras:
        click.echo(f'installed  {", ".join(extras)}')
    return 0
