"""The commands that run or make something, and their options; each has a module of its own."""

from __future__ import annotations

from pathlib import Path

import click

from ballbot_ros.cli.path_types import NEW_FILE, PATH
from ballbot_ros.scenario.library import load_scenario, scenario_names

_set_option = click.option(
    '--set',
    'assignments',
    multiple=True,
    metavar='NODE.PARAM=VALUE',
    help='Set a parameter, such as controller.k_thetadot=300; may be given again.',
)


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
    type=PATH,
    help='Folder for recording and picture.  [default: runs/<date>_<scenario>]',
)
@click.option('--seed', type=click.IntRange(0), help='Seed of the device noise.')
@click.option('--no-record', is_flag=True, help='Write no recording.')
@_set_option
@click.option(
    '--controller',
    type=click.Choice(['python', 'c', 'arm']),
    help='What computes: the Python program, the C generated from it, or that on an emulated ARM '
    'processor.  [default: python, unless the scenario sets it]',
)
@click.option(
    '--viewer',
    is_flag=True,
    help='Show the run in a browser, at factor 1 unless another is given; prints the address. The '
    'page stays after the run, for others to be chosen there.',
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
    viewer: bool,
    as_json: bool,
) -> int:
    """Run SCENARIO, a name or a YAML file, and judge it by its expectations.

    Exit status: 0 if the expectations hold, 1 if they do not or the run failed, 2 for a mistake
    in the arguments. With --viewer it is that of the last run.
    """
    from ballbot_ros.cli.requirements import require_rclpy
    from ballbot_ros.cli.run import RunOptions, run_scenario

    options = RunOptions(
        processes=processes,
        real_time_factor=real_time_factor,
        output=output,
        seed=seed,
        record=not no_record,
        assignments=assignments,
        controller=controller,
        viewer=viewer,
        as_json=as_json,
    )
    if not viewer:
        return run_scenario(scenario, options)
    require_rclpy(', or leave out --viewer')
    from ballbot_ros.cli.viewer_session import run_with_viewer

    return run_with_viewer(scenario, options)


@click.command(short_help='Drive the robot by hand.')
@click.option('--map', 'map_name', help='Map to drive in, by name or file.')
@click.option(
    '--start', nargs=2, type=float, metavar='X Y', help='Start position in the frame map [m].'
)
@click.option('--profile', help='Profile of the devices, such as hardware.  [default: ideal]')
@click.option('--device', help='Gamepad, by its number or part of its name.  [default: any]')
@click.option('--no-keyboard', is_flag=True, help='Leave the keys of the terminal alone.')
@click.option(
    '--output',
    type=PATH,
    help='Folder for the recording.  [default: runs/<date>_drive]',
)
@click.option('--no-record', is_flag=True, help='Write no recording.')
@click.option('--log', type=NEW_FILE, help='File for the data log of the brick, as CSV.')
@_set_option
@click.option('--viewer', is_flag=True, help='Show the robot in a browser; prints the address.')
@click.option('--list-devices', is_flag=True, help='List the gamepads, show their input, and end.')
def drive(
    map_name: str | None,
    start: tuple[float, float] | None,
    profile: str | None,
    device: str | None,
    no_keyboard: bool,
    output: Path | None,
    no_record: bool,
    log: Path | None,
    assignments: tuple[str, ...],
    viewer: bool,
    list_devices: bool,
) -> int:
    """Drive the robot by hand: gamepad, keyboard, or the topics joy and cmd_vel.

    It runs in real time until q, Ctrl-C or SIGTERM.
    """
    if list_devices:
        from ballbot_ros.teleop import device_list

        device_list.list_devices()
        return 0
    from ballbot_ros.cli.requirements import require_rclpy

    require_rclpy()
    from ballbot_ros.cli.drive import drive_by_hand

    return drive_by_hand(
        map_name=map_name,
        start=start,
        profile=profile,
        device=device,
        keyboard=not no_keyboard,
        output=output,
        record=not no_record,
        log=log,
        viewer=viewer,
        assignments=assignments,
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
    type=PATH,
    help='Parameter file whose physical values are used.',
)
def design(params: Path | None) -> None:
    """Print the model, its poles, and the servo gains beside the published ones."""
    from ballbot_ros.cli.design import print_design

    print_design(params)


@click.command('map', short_help='Check a map image; write it for other programs.')
@click.argument('image')
@click.option('--wrl', type=NEW_FILE, help='VRML 2.0 file to write.')
@click.option(
    '--yaml',
    'nav2',
    type=NEW_FILE,
    help="File for nav2's map server to write; its .pgm goes beside it.",
)
@click.option('--check', is_flag=True, help='Only say whether the image is a map.')
def map_command(image: str, wrl: Path | None, nav2: Path | None, check: bool) -> None:
    """Check IMAGE, a PNG or BMP file or a shipped map's name, and print what is on it."""
    from ballbot_ros.cli.map import inspect_map

    if check and (wrl or nav2):
        raise click.UsageError('--check writes nothing: leave out --wrl and --yaml')
    inspect_map(image, wrl=wrl, nav2=nav2, check=check)


@click.command(short_help='Write the controller as C for the brick, or check it.')
@click.option('--output', type=PATH, help='Folder to write.')
@click.option(
    '--params',
    type=PATH,
    help='Parameter file, or recording of runs whose last one had the controller values, with '
    "--output.  [default: the table's]",
)
@click.option(
    '--mode',
    type=click.Choice(['remote', 'autonomous']),
    help="Drive mode, with --output.  [default: the parameter file's, or remote]",
)
@click.option(
    '--check',
    'checked',
    type=PATH,
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
@click.option('--fix', is_flag=True, help='Remove what killed processes left in shared memory.')
def doctor(fix: bool) -> int:
    """Check Python, rclpy, discovery, disk and ports; say what to do where one is not OK."""
    from ballbot_ros.cli.doctor import examine

    return examine(fix=fix)
