"""Running a click command as a program."""

from __future__ import annotations

import os
import sys
from io import TextIOWrapper

import click

from ballbot_ros.errors import BallbotError
from ballbot_ros.standard_streams import open_standard_streams


def invoke(command: click.Command, name: str, failed: int = 2) -> int:
    """Run a command with the words of the command line; return its exit status.

    Parameters
    ----------
    command : click.Command
    name : str
        The program's name in the help text.
    failed : int
        Status after an error of ours, which is told in one line; after a mistake in the words it
        is 2.
    """
    open_standard_streams()
    if isinstance(sys.stdout, TextIOWrapper):
        # What a terminal or a file can't show, such as θ in ASCII, it is given as \u03b8.
        sys.stdout.reconfigure(errors='backslashreplace')
    try:
        status = command(prog_name=name, standalone_mode=False)
        print(end='', flush=True)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        return 2
    except click.ClickException as error:
        click.echo(f'error: {" ".join(error.format_message().split())}', err=True)
        return 2
    except BallbotError as error:
        click.echo(f'error: {error}', err=True)
        return failed
    except OSError as error:
        # What could not be printed is not to be tried again at the end of Python.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        if isinstance(error, BrokenPipeError):
            return 1  # as click ends where it meets it
        # Whoever opens a file names it; what is left is what the command prints.
        click.echo(f'error: {error.filename or "standard output"}: {error.strerror}', err=True)
        return failed
    except (click.Abort, KeyboardInterrupt):
        return 130
    return status if isinstance(status, int) else 0
