"""Files that a command writes: their first line, and the errors of writing."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import Path

import click
from click.core import ParameterSource

from ballbot_ros.errors import BallbotError, printable

_OUTPUTS = ('output', 'plot', 'as_json')


def write_file(option: str, path: Path, content: bytes) -> None:
    """Write the file that an option names.

    Raises
    ------
    BallbotError
        If it can't be written.
    """
    try:
        path.write_bytes(content)
    except OSError as error:
        raise BallbotError(f'{option} {path}: {error.strerror}') from None


def heading(command: str) -> str:
    """Return the first line of a parameter file: the command that made it."""
    return f'# {printable(command)}\n'


def command_line(context: click.Context) -> str:
    """Return the command line that gives the same result again, without what it writes."""
    return shlex.join(['ballbot', context.command.name or '', *_words(context)])


def _words(context: click.Context) -> Iterator[str]:
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
