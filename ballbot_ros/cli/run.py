"""`ballbot run`: from a scenario to a verdict."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import click

from ballbot_ros.cli.options import (
    Choice,
    FloatRange,
    controller_option,
    folder_option,
    no_browser_option,
    no_wait_option,
    page_options,
    params_option_like,
    processes_option,
    set_option,
)
from ballbot_ros.parameters import ROLES
from ballbot_ros.process import DeferredSignals
from ballbot_ros.run.node_process import ForkClient
from ballbot_ros.run.requirements import Processes


@click.command('run')
@click.argument('scenario')
@processes_option
@click.option(
    '--real-time-factor',
    type=FloatRange(0.0, 1000.0),
    help='Pace against the wall clock: 1 real time, 0.1 slow motion, 0 as fast as possible.  '
    '[default: 0, unless the scenario sets it]',
)
@folder_option('recording and picture.  [default: runs/<date>_<scenario>]')
@click.option(
    '--profile', help="Device profile, such as hardware, or a file.  [default: the scenario's]"
)
@params_option_like('Parameter file that overrides the scenario.')
@click.option('--seed', type=click.IntRange(0), help='Seed of the device noise and jitter.')
@click.option('--no-record', is_flag=True, help='Write no recording.')
@set_option
@controller_option
@click.option(
    '--external',
    type=Choice(ROLES),
    multiple=True,
    help='Start no node for this role, and wait for yours; can be repeated.',
)
@click.option(
    '--viewer',
    is_flag=True,
    help='Show the run in a browser, at factor 1 unless another is given; prints the address. The '
    'run begins when the page is open. The page stays after the run and can start others.',
)
@no_browser_option
@no_wait_option
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def command(
    scenario: str,
    processes: str,
    real_time_factor: float | None,
    output: Path | None,
    profile: str | None,
    parameter_file: Path | None,
    seed: int | None,
    no_record: bool,
    assignments: tuple[str, ...],
    controller: str | None,
    external: tuple[str, ...],
    viewer: bool,
    no_browser: bool,
    no_wait: bool,
    as_json: bool,
) -> int:
    """Run SCENARIO, a name or a YAML file, and judge it by its expectations.

    Exit status: 0 if the expectations hold, 1 if they do not or the run failed, 2 for a mistake
    in the arguments. With --viewer it is that of the last run.
    """
    arrangement = Processes(processes)
    page = page_options(viewer=viewer, no_browser=no_browser, no_wait=no_wait)
    # Start the fork server first: it imports the nodes while this process imports what it needs.
    with ForkClient() if arrangement is Processes.SEPARATE else nullcontext() as client:
        with DeferredSignals():
            from ballbot_ros.cli.result import execute_and_print, load_run
            from ballbot_ros.run.requirements import require_rclpy
            from ballbot_ros.run.spec import RunOptions

        options = RunOptions(
            processes=arrangement,
            profile=profile,
            parameter_file=parameter_file,
            real_time_factor=real_time_factor,
            # With a page, run in real time, since somebody watches.
            default_real_time_factor=1.0 if viewer else 0.0,
            seed=seed,
            assignments=assignments,
            controller=controller,
            external=external,
            output=output,
            record=not no_record,
        )
        if page is None:
            spec = load_run(scenario, options)
            return execute_and_print(spec, client, as_json=as_json).exit_status
        require_rclpy(', or omit --viewer')
        from ballbot_ros.cli.viewer_session import run_with_viewer

        return run_with_viewer(scenario, options, page, client, as_json=as_json)
