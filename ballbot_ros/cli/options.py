"""Options shared by several commands."""

from __future__ import annotations

import click

from ballbot_ros.cli.page_opening import PageOptions
from ballbot_ros.cli.value_types import Choice
from ballbot_ros.run.processes import Processes

set_option = click.option(
    '--set',
    'assignments',
    multiple=True,
    metavar='NODE.PARAM=VALUE',
    help='Set a parameter, such as controller.k_thetadot=300; can be repeated.',
)
"""Sets parameters of a run."""

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


no_browser_option = click.option(
    '--no-browser', is_flag=True, help='Open no browser; only print the address of the page.'
)
"""Leaves it to the user to open the page."""

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
            raise click.BadParameter(f'{value!r} names nothing', context, parameter)
        names += named
    return names
