"""`ballbot schedule`: the tasks on the brick, their worst responses, and what may come too late."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from ballbot_ros.cli.options import FloatRange, controller_option, params_option_like, set_option
from ballbot_ros.controllers.codegen.implementation import check_load
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, ParameterError
from ballbot_ros.process import stdout_to_stderr
from ballbot_ros.robot.brick.job_times import interrupt_load, kernel_constants

TICK_TIME = f'{CONTROLLER}.tick_time'
SWITCHES = 'kernel', 'link'
HEADINGS = 'priority', 'period [ms]', 'time [µs]', 'share', 'worst [µs]', 'simulated [µs]', 'lost'


@click.command('schedule')
@click.option('--profile', help='Device profile, such as hardware, or a file.  [default: ideal]')
@params_option_like('Parameter file.')
@set_option
@controller_option
@click.option(
    '--measure',
    'factor',
    type=FloatRange(0.0, 1e6, min_open=True),
    metavar='FACTOR',
    help="Measure a controller other than the document's on this machine; the brick takes FACTOR "
    'times as long.  [default: controller.tick_time]',
)
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def command(
    profile: str | None,
    parameter_file: Path | None,
    assignments: tuple[str, ...],
    controller: str | None,
    factor: float | None,
    as_json: bool,
) -> None:
    """Print the tasks on the brick, and whether each job ends before the next alarm of its task.

    The worst time from an alarm to the end of its job is computed, for fixed priorities and an
    interrupt each millisecond, and simulated, both with jobs that all take their longest path. The
    kernel need not be switched on.
    """
    # Imported only here: they take a while.
    from ballbot_ros.engine.brick_schedule import measured_time, schedule_of, warnings_of
    from ballbot_ros.run.spec import RunOptions, RunSpec

    estimate = ''
    if factor is not None:
        assignments += (f'{TICK_TIME}=0',)  # until it is measured
    options = RunOptions(
        profile=profile, parameter_file=parameter_file, assignments=assignments,
        controller=controller,
    )  # fmt: skip
    with stdout_to_stderr():  # a controller may print
        spec = RunSpec.compose(None, options)
        parameters, loaded = spec.parameters, spec.controller
        given = parameters.of(ControllerParameters)
        parameters.set(CONTROLLER, 'kernel', True)
        if factor is not None:
            if not loaded:
                raise click.UsageError("--measure: needs a --controller other than the document's")
            machine_us = measured_time(parameters, loaded)
            estimate = f'{machine_us:.3g} µs on this machine × {factor:g}'
            time_us = float(math.ceil(factor * machine_us))
            parameters.set(CONTROLLER, 'tick_time', time_us, f'--measure: {estimate}')
    settings = parameters.of(ControllerParameters)
    try:
        check_load(settings, loaded.tasks if loaded else ())
    except ParameterError as error:
        raise ParameterError(f'--measure: {estimate}: {error}' if estimate else error) from None
    tasks, simulated_ms = schedule_of(settings, loaded)
    content = {
        'processor_clock_mhz': settings.processor_clock,
        'interrupt_us': kernel_constants(settings).interrupt_us,
        'interrupt_share': interrupt_load(settings),
        'tasks': [task._asdict() for task in tasks],
        'load': interrupt_load(settings) + sum(task.share for task in tasks),
        'simulated_s': simulated_ms / 1e3,
        'tick_time': settings.tick_time if loaded else None,
        'estimate': estimate or None,
        'switched_off': [f'{CONTROLLER}.{each}' for each in SWITCHES if not getattr(given, each)],
        'warnings': [*warnings_of(settings, tasks)],
    }
    if as_json:
        click.echo(json.dumps(content, indent=2, allow_nan=False))
        return
    console = Console(highlight=False, markup=False)
    console.print(_table(content))
    for line in _lines(content):
        console.print(line, soft_wrap=True)


def _table(content: dict[str, Any]) -> Table:
    title = f'Tasks on the brick at {content["processor_clock_mhz"]:g} MHz'
    table = Table('task', title=title, title_justify='left')
    for heading in HEADINGS:
        table.add_column(heading.replace(' ', '\n'), justify='right', no_wrap=True)
    share = f'{content["interrupt_share"]:.1%}'
    table.add_row('interrupts', '', '1', f'{content["interrupt_us"]}', share)
    for task in content['tasks']:
        time_us = f'{"≈ " if content["estimate"] else ""}{task["time_us"]}'
        limit = '' if task['is_exact'] else '≤ '
        worst_us = f'{limit}{task["worst_us"]}' if task['worst_us'] else '∞'
        table.add_row(
            task['name'], f'{task["priority"]}', f'{task["period_ms"] or "once"}', time_us,
            f'{task["share"]:.1%}', worst_us, f'{task["simulated_us"] or "–"}', f'{task["lost"]}',
        )  # fmt: skip
    table.add_row('all', '', '', '', f'{content["load"]:.1%}')
    return table


def _lines(content: dict[str, Any]) -> Iterator[str]:
    yield f'Simulated: {content["simulated_s"]:g} s; all alarms start together.'
    if any(task['worst_us'] and not task['is_exact'] for task in content['tasks']):
        yield '≤: at most; alarms that are lost, or late by the defect, take load away.'
    if content['estimate']:
        declared = f'--set {TICK_TIME}={content["tick_time"]:g}'
        yield f'≈: estimate: {content["estimate"]}; to declare it: {declared}'
    if content['switched_off']:
        yield f'Switched off in runs with these parameters: {", ".join(content["switched_off"])}.'
    yield from (f'warning: {warning}' for warning in content['warnings'])
