"""The `ballbot` command, and how a click command runs as a program."""

from __future__ import annotations

import itertools
import os
from importlib import import_module

import click

from ballbot_ros import __version__
from ballbot_ros.cli.install import YES, offer
from ballbot_ros.errors import BallbotError, MissingExtraError, printable, similar
from ballbot_ros.files import program
from ballbot_ros.process import STANDARD_OUTPUT, open_standard_streams, prepare_standard_output

COMMANDS = {
    'run': 'Run a scenario and judge it by its expectations.',
    'drive': 'Drive the robot by hand.',
    'brick': 'Drive your own brick, or an emulated one.',
    'scenarios': 'List the shipped scenarios.',
    'report': 'Write a page with figures and metrics of a recorded run.',
    'compare': 'Compare the metrics of recorded runs.',
    'view': 'Show recorded runs in a browser.',
    'render': 'Render a picture or a film of a recorded run.',
    'branch': 'Run a recorded run again, with another future.',
    'replay': 'Run a recorded run again and report differences.',
    'info': 'Describe a recording.',
    'play': 'Publish a recording into the graph.',
    'export': 'Write a recording as tables, or its data log.',
    'repair': 'Recover a damaged recording.',
    'map': 'Check a map image; export it for other programs.',
    'design': 'Print the model, its poles and the servo gains.',
    'schedule': 'Print the tasks of the brick and their worst response times.',
    'study': 'Run a scenario very many times, with varied values.',
    'tune': 'Search for parameters that are best on many robots.',
    'falsify': 'Search for runs that violate what is required.',
    'identify': 'Identify physical parameters from recordings.',
    'commission': 'Measure gyros and motors of your own robot.',
    'twin': 'Simulate the twin of a real robot, and compare both.',
    'new': 'Start a controller of your own: a package that runs.',
    'conform': 'Test a node of your own against its contract.',
    'codegen': 'Generate the controller as C for the brick, or check it.',
    'doctor': 'Check that this machine is ready.',
    'install': 'Install what some commands need.',
}
"""The line of each command in the help of `ballbot`; the module of the same name declares it."""


def load_command(name: str) -> click.Command:
    """Import the module of a command, and return the command."""
    command: click.Command = import_module(f'{__package__}.{name}').command
    return command


def _commands_with(option: str) -> list[str]:
    """Return the commands that have an option."""
    return [
        name for name in COMMANDS if any(option in each.opts for each in load_command(name).params)
    ]


def _check_scenario(word: str) -> None:
    """Raise UsageError for a word that is neither a scenario nor a file, but like a command."""
    # Imported only here: it takes a while, and only a scenario's name needs it.
    from ballbot_ros.engine.scenario.reader import scenario_names

    known = [*COMMANDS, *scenario_names()]
    found = similar(word, known)
    if found and word not in known and '.' not in word and '/' not in word:
        raise click.UsageError(f'no command or scenario {word!r}: did you mean {found}?')


class _LazyGroup(click.Group):
    """Commands whose modules are imported only when they are called.

    `ballbot --help` and completion only need names and help lines. A word that is not a command is
    a scenario: `ballbot stationary` means `ballbot run stationary`.
    """

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if YES in [*itertools.takewhile(lambda word: word != '--', args)]:
            args = [YES, *(word for word in args if word != YES)]
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as error:
            if owners := _commands_with(error.option_name):
                raise click.UsageError(
                    f'{error.option_name}: name the command first, as in `{program()} {owners[0]} '
                    f'{error.option_name}`; an option of {", ".join(owners)}'
                ) from None
            raise

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and args[0] not in self.commands and not args[0].startswith('-'):
            if not ctx.resilient_parsing:  # as for completion
                _check_scenario(args[0])
            args = ['run', *args]
        name, command, rest = super().resolve_command(ctx, args)
        return name, load_command(name) if name else command, rest

    def invoke(self, ctx: click.Context) -> object:
        try:
            return super().invoke(ctx)
        except MissingExtraError as error:
            offer(error.extra)
            raise BallbotError(f'{error}; {YES} does so') from None


@click.group(
    cls=_LazyGroup,
    commands=[click.Command(name, short_help=line) for name, line in COMMANDS.items()],
    context_settings={'help_option_names': ['-h', '--help'], 'max_content_width': 100},
)
@click.option(YES, is_flag=True, help='Install what a command needs, without asking.')
@click.version_option(__version__, prog_name='ballbot')
def ballbot(*, yes: bool) -> None:
    """Simulate, measure and record the LEGO NXT Ballbot."""


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
