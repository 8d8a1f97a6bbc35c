"""Options, types of their values, tables and written files, which several commands share."""

from __future__ import annotations

import math
import os
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from ballbot_ros.cli.web_page import PageOptions
from ballbot_ros.errors import BallbotError, did_you_mean, os_errors, printable
from ballbot_ros.run.requirements import Processes

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


class _Path(click.Path):
    """A path; rejects an empty word, as of an unset variable, which a Path takes for ``.``.

    If an argument can only mean a folder, it is rejected, too, and the message says what is
    `wanted`.
    """

    def __init__(
        self, is_folder: Callable[[str], bool] = lambda value: False, wanted: str = ''
    ) -> None:
        super().__init__(path_type=Path)
        self._is_folder, self._wanted = is_folder, wanted

    def convert(
        self,
        value: str | os.PathLike[str],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> str | bytes | os.PathLike[str]:
        word = str(value)
        if not word:
            self.fail('names nothing', param, ctx)
        if self._is_folder(word):
            self.fail(f'{word}: is a folder; name {self._wanted}', param, ctx)
        return super().convert(value, param, ctx)


PATH = _Path()
"""A file to read, or a folder."""

RECORDING = _Path(lambda value: not Path(value).name, 'a recording')
"""A recording to read. Output files are named after it, so it must have a name."""

NEW_FILE = _Path(lambda value: value.endswith('/'), 'a file to write')
"""A file to write. ``x/`` means a folder, but a Path would drop the slash."""


class Choice(click.Choice[str]):
    """One of several words; a misspelt one gets a suggestion."""

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> str:
        """Return the word."""
        try:
            return super().convert(value, param, ctx)
        except click.BadParameter as error:
            hint = did_you_mean(str(value), map(str, self.choices))
            self.fail(error.message.removesuffix('.') + hint, param, ctx)


class FloatRange(click.FloatRange):
    """A number within a range; unlike click's type, it refuses NaN."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number."""
        number: float = super().convert(value, param, ctx)
        if math.isnan(number):
            self.fail(f'{value!r} is not a number', param, ctx)
        return number


def set_option_like(text: str, metavar: str = 'NODE.PARAM=VALUE') -> Callable[[Any], Any]:
    """Return the option that sets parameters, with its text in the help."""
    return click.option(
        '--set',
        'assignments',
        multiple=True,
        metavar=metavar,
        help=f'{text}; can be repeated.',
    )


set_option = set_option_like('Set a parameter, such as controller.k_thetadot=300')
"""Sets parameters of a run."""


def params_option_like(text: str) -> Callable[[Any], Any]:
    """Return the option that names a parameter file, with its text in the help."""
    return click.option('--params', 'parameter_file', type=PATH, help=text)


def folder_option(text: str) -> Callable[[Any], Any]:
    """Return the option that names the folder for what a command writes."""
    return click.option('--output', type=PATH, help=f'Folder for {text}')


controller_option = click.option(
    '--controller',
    metavar='CONTROLLER',
    help="Controller: the document's program in Python (python), as generated C (c) or C on an "
    'emulated ARM processor (arm); the name of an installed one; package.module:Class; or '
    'FILE.py:Class.  [default: python, unless a file sets it]',
)
"""Selects the controller of a run."""


processes_option = click.option(
    '--processes',
    type=Choice([each.value for each in Processes]),
    default=Processes.SEPARATE.value,
    show_default=True,
    help='One process per node; all nodes in one process; or no nodes, the same loop without ROS.',
)
"""Selects how a run is executed."""


known_profile_option = click.option(
    '--profile',
    default='hardware',
    show_default=True,
    help='Device profile, or a file, for what a log does not tell.',
)
"""Names what is known of a real robot."""

device_option = click.option(
    '--device', help='Gamepad, by its number or part of its name.  [default: any]'
)
"""Selects the gamepad that drives."""

no_keyboard_option = click.option(
    '--no-keyboard', is_flag=True, help='Do not use the keys of the terminal.'
)
"""Leaves the keys to others."""

no_browser_option = click.option(
    '--no-browser', is_flag=True, help='Open no browser; only print the address of the page.'
)
"""Leaves it to the user to open the page."""

code_option = click.option(
    '--code',
    metavar='FILE.py:Class',
    help="Your copy of the recorded controller's code, if it is not installed.",
)
"""The code of a recorded controller."""

trust_option = click.option(
    '--trust-attached-code',
    is_flag=True,
    help='Run the code of the controller that is attached to the recording, which may come from '
    'anybody.',
)
"""Whether to run attached code."""

no_wait_option = click.option(
    '--no-wait', is_flag=True, help='Begin at once, not when the page is open or a key is pressed.'
)
"""Begins a run with a page at once."""


def page_options(*, viewer: bool, no_browser: bool, no_wait: bool) -> PageOptions | None:
    """Return how the page of a run is opened; None if it has none."""
    if viewer:
        return PageOptions(opens_browser=not no_browser, waits=not no_wait)
    for name, is_given in (('--no-browser', no_browser), ('--no-wait', no_wait)):
        if is_given:
            raise click.UsageError(f'{name}: requires --viewer')
    return None


def split_at_commas(
    context: click.Context, parameter: click.Parameter, values: tuple[str, ...]
) -> list[str]:
    """Split the values of an option at commas; the option can also be repeated."""
    names = []
    for value in values:
        named = [name for name in value.split(',') if name]
        if not named:
            raise click.BadParameter(f'{value!r} names nothing')
        names += named
    return names


MAX_TABLE_WIDTH = 2000


def print_whole(console: Console, table: Table) -> None:
    """Print a table; let the terminal wrap its lines rather than truncate numbers."""
    options = console.options.update(max_width=MAX_TABLE_WIDTH)
    console.width = max(console.width, console.measure(table, options=options).maximum)
    console.print(table)


_OUTPUTS = ('output', 'plot', 'as_json')


def write_file(option: str, path: Path, content: bytes) -> None:
    """Write the file that an option names.

    It raises BallbotError if it can't be written.
    """
    with os_errors(BallbotError, f'{option} {path}'):
        path.write_bytes(content)


def heading(context: click.Context) -> str:
    """Return the first line of a parameter file: the command that gives it again."""
    command = shlex.join(['ballbot', context.command.name or '', *_words(context)])
    return f'# {printable(command)}\n'


def _words(context: click.Context) -> Iterator[str]:
    """Yield the words that were given, but for those about output."""
    for parameter in context.command.params:
        name = parameter.name or ''
        value = context.params[name]
        given = context.get_parameter_source(name) is ParameterSource.COMMANDLINE
        if not given or name in _OUTPUTS:
            continue
        if isinstance(parameter, click.Argument):
            yield from map(str, value if parameter.nargs != 1 else (value,))
        elif isinstance(parameter, click.Option) and parameter.is_flag:
            yield parameter.opts[0]
        else:
            if not (isinstance(parameter, click.Option) and parameter.multiple):
                words = value if isinstance(value, tuple) else (value,)
                value = (','.join(str(word).strip('()') for word in words),)
            for each in value:
                # With =, since the value may begin with a minus sign.
                yield f'{parameter.opts[0]}={each}'
