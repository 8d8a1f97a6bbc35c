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
@click.option(
    '--controller',
    type=click.Choice(['python', 'c', 'arm']),
    help='What computes: the Python program, the C generated from it, or that on an emulated ARM '
    'processor.  [default: python, unless the scenario sets it]',
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
    controller: str | None,
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
        controller=controller,
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


@click.command(short_help='Write the controller as C for the brick, or check it.')
@click.option('--output', type=click.Path(path_type=Path), help='Folder to write.')
@click.option(
    '--params',
    type=click.Path(path_type=Path),
    help="Parameter file whose controller values are used, with --output.  [default: the table's]",
)
@click.option(
    '--mode',
    type=click.Choice(['remote', 'autonomous']),
    help="Drive mode, with --output.  [default: the parameter file's, or remote]",
)
@click.option(
    '--check',
    'checked',
    type=click.Path(path_type=Path),
    help='Folder to compare with the Python controller, bit for bit, on this machine and on an '
    'emulated ARM processor, and to measure.',
)
def codegen(
    output: Path | None, params: Path | None, mode: str | None, checked: Path | None
) -> int:
    """Write the controller as C, an nxtOSEK application; or check such a folder.

    Exit status: 0 if it was written, or is equal; 1 if it differs; 2 for a mistake in the
    arguments, or if a tool that a check needs is missing.
    """
    if (output is None) == (checked is None):
        raise click.UsageError('give either --output DIR or --check DIR')
    if checked and (params or mode):
        raise click.UsageError('--params and --mode go with --output; a folder has its own')
    from ballbot_ros.cli.codegen import check, generate

    if checked:
        return check(checked)
    assert output
    generate(output, params, mode)
    return 0


@click.command(short_help='Check that this machine is ready.')
def doctor() -> int:
    """Check Python, rclpy, discovery, disk and ports; say what to do where one is not OK."""
    from ballbot_ros.cli.doctor import examine

    return examine()
