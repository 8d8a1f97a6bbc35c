"""The commands and their options; each hands over to a module of its own."""

from __future__ import annotations

from pathlib import Path

import click

from ballbot_ros.scenario.library import load_scenario, scenario_names


@click.command(short_help='Run a scenario and judge it by its expectations.')
@click.argument('scenario')
@click.option(
    '--processes',
    type=click.Choice(['separate', 'one', 'none']),
    default='separate',
    show_default=True,
    help='Every node a process of its own; all nodes in one process; or no nodes at all, the same '
    'loop without ROS.',
)
@click.option(
    '--real-time-factor',
    type=click.FloatRange(0.0, 1000.0),
    help='Pace against the wall clock: 1 real time, 0.1 slow motion, 0 as fast as it can.  '
    '[default: 0, unless the scenario sets it]',
)
@click.option(
    '--output',
    type=click.Path(path_type=Path),
    help='Folder for recording and picture.  [default: runs/<date>_<scenario>]',
)
@click.option('--seed', type=click.IntRange(0), help='Seed of the device noise.')
@click.option('--no-record', is_flag=True, help='Write no recording.')
@click.option(
    '--set',
    'assignments',
    multiple=True,
    metavar='NODE.PARAM=VALUE',
    help='Set a parameter, such as controller.k_thetadot=300; may be given again.',
)
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def run(
    scenario: str,
    processes: str,
    real_time_factor: float | None,
    output: Path | None,
    seed: int | None,
    no_record: bool,
    assignments: tuple[str, ...],
    as_json: bool,
) -> int:
    """Run SCENARIO, a name or a YAML file, and judge it by its expectations.

    Exit status: 0 if the expectations hold, 1 if they do not or the run failed, 2 for a mistake
    in the arguments.
    """
    from ballbot_ros.cli.run import run_scenario

    return run_scenario(
        scenario,
        processes=processes,
        real_time_factor=real_time_factor,
        output=output,
        seed=seed,
        record=not no_record,
        assignments=assignments,
        as_json=as_json,
    )


@click.command()
def scenarios() -> None:
    """List the shipped scenarios."""
    names = scenario_names()
    width = max(map(len, names))
    for name in names:
        click.echo(f'{name:<{width}}  {load_scenario(name).purpose}')


@click.command(short_help='Print the model, its poles and the servo gains.')
@click.option(
    '--params',
    type=click.Path(path_type=Path),
    help='Parameter file whose physical values are used.',
)
def design(params: Path | None) -> None:
    """Print the model, its poles, and the servo gains beside the published ones."""
    from ballbot_ros.cli.design import print_design

    print_design(params)


@click.command(short_help='Check that this machine is ready.')
def doctor() -> int:
    """Check Python, rclpy, discovery, disk and ports; say what to do where one is not OK."""
    from ballbot_ros.cli.doctor import examine

    return examine()


@click.command(short_help='Make a page with figures and metrics of a recorded run.')
@click.argument('recording', type=click.Path(path_type=Path))
@click.option(
    '--output',
    type=click.Path(path_type=Path),
    help='Folder for page, pictures and tables; it must be new or empty.  '
    '[default: <recording>_report beside it]',
)
@click.option(
    '--run',
    'number',
    type=click.IntRange(1),
    help='Which run of a file that holds several, from 1 on.  [default: the last]',
)
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def report(recording: Path, output: Path | None, number: int | None, as_json: bool) -> int:
    """Write a report of RECORDING: index.html with everything in it, its PNGs and CSVs.

    Exit status: 0 if the report was written, whatever its verdict; 2 for a mistake in the
    arguments or a file that is no recording of a ballbot.
    """
    from ballbot_ros.cli.report import report as write

    return write(recording, number=number, output=output, as_json=as_json)


@click.command(short_help='Set the metrics of recorded runs side by side.')
@click.argument(
    'recordings', nargs=-1, required=True, type=click.Path(path_type=Path), metavar='A B...'
)
@click.option(
    '--output',
    type=click.Path(path_type=Path),
    help='Folder for a page with the figures of all runs; it must be new or empty.',
)
@click.option(
    '--fail-if',
    'conditions',
    multiple=True,
    metavar="'METRIC>X%'",
    help='Exit with 1 if METRIC of any later run is larger than that of the first by more than X '
    'percent, or without % by more than X of its unit; < for smaller.  May be given again.',
)
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def compare(
    recordings: tuple[Path, ...], output: Path | None, conditions: tuple[str, ...], as_json: bool
) -> int:
    """Compare recorded runs with the first one, A.

    Exit status: 0; 1 if a --fail-if condition holds; 2 for a mistake in the arguments or a file
    that is no recording of a ballbot.
    """
    from ballbot_ros.cli.compare import compare as compare_runs

    return compare_runs(recordings, output=output, conditions=conditions, as_json=as_json)
