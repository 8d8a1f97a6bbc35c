"""`ballbot doctor`: checks of this machine; each check reports OK, or what to do."""

from __future__ import annotations

import click
from rich.console import Console
from rich.text import Text

from ballbot_ros.errors import BallbotError
from ballbot_ros.run.machine_checks import CHECKS, remove_leftovers


def run_checks(*, fix: bool = False) -> int:
    """Run every check; return 0 if all are OK, else 1.

    With `fix`, remove what killed processes left in shared memory.
    """
    console = Console(highlight=False, markup=False)
    failed = False
    checks = {**CHECKS, 'leftovers': remove_leftovers} if fix else CHECKS
    for name, check in checks.items():
        try:
            line = Text.assemble(('OK  ', 'green'), f' {name:<10} {check()}')
        except BallbotError as problem:
            failed = True
            line = Text.assemble(('FAIL', 'red'), f' {name:<10} {problem}')
        console.print(line, soft_wrap=True)
    return int(failed)


@click.command('doctor')
@click.option('--fix', is_flag=True, help='Remove what killed processes left in shared memory.')
def command(fix: bool) -> int:
    """Check Python, rclpy, discovery, disk and ports; say what to do if a check fails."""
    return run_checks(fix=fix)
