"""Running a click command as a program."""

from __future__ import annotations

import os

import click

from ballbot_ros.errors import BallbotError, printable
from ballbot_ros.process import STANDARD_OUTPUT, open_standard_streams, prepare_standard_output


def invoke(command: click.Command, name: str, failed: int = 2) -> int:
    """Run a command with the arguments of the command line; return its exit status.

    A `BallbotError` or `OSError` is printed on one line, and the status is then `failed`; for
    invalid arguments it is 2.
    """
    open_standard_streams()
    prepare_standard_output()
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
        click.echo(f'error: {printable(str(error))}', err=True)
        return failed
    except OSError as error:
        if error.filename == STANDARD_OUTPUT:
            # Discard the rest, which Python would try to print again when it ends.
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        if isinstance(error, BrokenPipeError):
            return 1  # like click
        where = f'{error.filename}: ' if error.filename else ''
        click.echo(f'error: {where}{error.strerror or error}', err=True)
        return failed
    except (click.Abort, KeyboardInterrupt):
        return 130
    return status if isinstance(status, int) else 0
