"""The packages that a command needs beyond those of a first run: installed at its first use."""

from __future__ import annotations

import os
import sys
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
    packages = list(dict.fromkeys(package for each in wanted for package in missing(each)))
    size_mb = sum(EXTRAS[each].size_mb for each in wanted)
    purposes = ' and '.join(EXTRAS[each].purpose for each in wanted)
    click.echo(f'{purposes}: needs {", ".join(map(name_of, packages))}, {size_mb} MB', err=True)
    if is_agreed or click.confirm('install?', default=True, err=True):
        install(packages, size_mb, Path(sys.prefix, 'setup.log'))
        os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])
