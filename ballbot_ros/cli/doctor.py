"""`ballbot doctor`: checks of this machine; each check reports OK, or what to do."""

from __future__ import annotations

from collections.abc import Callable

import click
from rich.console import Console
from rich.text import Text

from ballbot_ros.errors import BallbotError
from ballbot_ros.run.machine_checks import CHECKS, OPTIONAL_CHECKS


def _run(console: Console, name: str, check: Callable[[], str], needed_for: str = '') -> bool:
    """Run a check, and print what it finds; return whether it is OK."""
    try:
        line = Text.assemble(('OK  ', 'green'), f' {name:<10} {check()}')
    except BallbotError as problem:
        mark = ('NOTE', 'yellow') if needed_for else ('FAIL', 'red')
        purpose = f' (for {needed_for})' if needed_for else ''
        console.print(Text.assemble(mark, f' {name:<10} {problem}{purpose}'), soft_wrap=True)
        return False
    console.print(line, soft_wrap=True)
    return True


@click.command('doctor')
def command() -> int:
    """Check this machine, and say what to do if a check fails.

    Lines with NOTE are about what only some commands need. Exit status: 1 if a line has FAIL.
    """
    console = Console(highlight=False, markup=False)
    results = [_run(console, name, check) for name, check in CHECKS.items()]
    for name, (check, commands) in OPTIONAL_CHECKS.items():
        _run(console, name, check, needed_for=commands)
    return int(not all(results))
