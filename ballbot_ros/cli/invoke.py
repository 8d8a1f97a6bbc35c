"""Running a click command as a program."""

from __future__ import annotations

import os
import sys
from io import TextIOWrapper

import click

from ballbot_ros.errors import BallbotError
from ballbot_ros.standard_streams import open_standard_streams


def invoke(command: click.Command, name: str, failed: int = 2) -> int:
    """Run a command with the arguments of the command line; return its exit status.

    A `BallbotError` or `OSError` is printed on one line, and the status is then `failed`; for
    invalid arguments it is 2.
    """
    open_standard_streams()
    if isinstance(sys.stdout, TextIOWrapper):
        # Characters that a terminal or file can't encode, such as θ in ASCII, become \u03b8.
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
        # Discard the rest of the output, which Python would try to print again when it ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        if isinstance(error, BrokenPipeError):
            return 1  # like click
        # An error that names no file comes from the command's output: code that opens files names
        # them.
        click.echo(f'error: {error.filename or "standard output"}: {error.strerror}', err=True)
        return failed
    except (click.Abort, KeyboardInterrupt):
        return 130
    return status if isinstance(status, int) else 0
