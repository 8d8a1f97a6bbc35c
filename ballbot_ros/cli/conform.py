"""`ballbot conform`: tests a node against the contract of its role."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import asdict
from typing import TYPE_CHECKING
from uuid import uuid4

import click
from rich.console import Console
from rich.text import Text

from ballbot_ros.cli.options import Choice
from ballbot_ros.parameters import ROLES
from ballbot_ros.process import StopRequest, stdout_to_stderr

if TYPE_CHECKING:  # importing it takes a while
    from ballbot_ros.nodes.conformance.examination import RequirementResult


@click.command('conform')
@click.argument('role', type=Choice(ROLES), metavar='ROLE')
@click.argument('command_line', nargs=-1, type=click.UNPROCESSED, metavar='[-- COMMAND…]')
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def command(role: str, command_line: tuple[str, ...], as_json: bool) -> int:
    """Test a node against the contract of its ROLE.

    ROLE is gyro_driver, encoder_driver, sonar_driver, controller, gamepad_teleop or recorder.
    COMMAND starts the node. Without it, start the node yourself: it is then not restarted.

    Exit status: 0 if the node met all that was tested, 1 if not, 2 for a mistake in the arguments.
    """
    from ballbot_ros.run.requirements import require_rclpy

    require_rclpy()
    from ballbot_ros.nodes.conformance.contract import START_S
    from ballbot_ros.nodes.conformance.examination import RequirementVerdict
    from ballbot_ros.run.graph import call_for

    if not command_line:
        click.echo(call_for([role], START_S), err=True)
    rows: list[RequirementResult] = []
    console = Console(highlight=False, markup=False)
    colours = {
        RequirementVerdict.MET: 'green',
        RequirementVerdict.FAILED: 'red',
        RequirementVerdict.NOT_TESTED: 'yellow',
    }
    examination = examine_node(role, command_line)
    while row := _next(examination):
        rows.append(row)
        if not as_json:
            verdict = (f'{row.verdict.value:<10}', colours[row.verdict])
            reason = f': {row.reason}' if row.reason else ''
            line = Text.assemble(verdict, f'  {row.name:<12}  {row.requirement}{reason}')
            console.print(line, soft_wrap=True)
    if as_json:
        content = [{**asdict(row), 'verdict': row.verdict.value} for row in rows]
        print(json.dumps({'role': role, 'requirements': content}, indent=2))
    else:
        counts = Counter(row.verdict for row in rows)
        print(
            ', '.join(f'{counts[each]} {each.value}' for each in RequirementVerdict if counts[each])
        )
    return int(any(row.verdict is RequirementVerdict.FAILED for row in rows))


def examine_node(role: str, command: Sequence[str]) -> Iterator[RequirementResult]:
    """Test the node of a role; yield a row for each requirement of its contract.

    The node is started by a command, and has ended when the iterator has; without any, the user
    starts it, and late start and restart are not tested. It raises BallbotError if ROS can't start,
    a plant or player is in the ROS domain, or there is no such program.
    """
    from ballbot_ros.nodes.conformance.bench import Bench
    from ballbot_ros.nodes.conformance.examination import examine
    from ballbot_ros.nodes.middleware import DomainLock, require_discovery, ros_domain
    from ballbot_ros.run.one_process import ros

    require_discovery()
    with (
        StopRequest() as stop,
        ros(),
        DomainLock(ros_domain()),
        closing(Bench(role, command, stop)) as bench,
    ):
        yield from examine(role, bench, uuid4().hex)


def _next(examination: Iterator[RequirementResult]) -> RequirementResult | None:
    """Return the next row, None after the last; the middleware may print in the meantime."""
    with stdout_to_stderr():
        return next(examination, None)
