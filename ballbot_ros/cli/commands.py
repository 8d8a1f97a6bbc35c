"""The commands and their options; each hands over to a module of its own."""

from __future__ import annotations

from pathlib import Path

import click

from ballbot_ros.scenario.library import load_scenario, scenario_names
from ballbot_ros.viewer.views import VIEWS


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
    from ballbot_ros.cli.run import RunOptions, require_rclpy, run_scenario

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
    type=click.Path(path_type=Path),
    help='Folder for the recording.  [default: runs/<date>_drive]',
)
@click.option('--no-record', is_flag=True, help='Write no recording.')
@click.option(
    '--log', type=click.Path(path_type=Path), help='File for the data log of the brick, as CSV.'
)
@click.option(
    '--set',
    'assignments',
    multiple=True,
    metavar='NODE.PARAM=VALUE',
    help='Set a parameter, such as controller.k_thetadot=300; may be given again.',
)
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


@click.command(short_help='Write the data log of a recording as CSV.')
@click.argument('recording', type=click.Path(path_type=Path))
@click.option(
    '--output',
    type=click.Path(path_type=Path),
    help='File to write.  [default: RECORDING with the suffix .csv]',
)
def log2csv(recording: Path, output: Path | None) -> None:
    """Write the data log that the brick sent in RECORDING as CSV, a file for each run in it."""
    from ballbot_ros.cli.log2csv import write_csv

    write_csv(recording, output or recording.with_suffix('.csv'))


@click.command()
def scenarios() -> None:
    """List the shipped scenarios."""
    names = scenario_names()
    width = max(map(len, names))
    for name in names:
        click.echo(f'{name:<{width}}  {load_scenario(name).purpose}')


@click.command(short_help='Make a recorded run again and say where it differs.')
@click.argument('recording', type=click.Path(path_type=Path))
@click.option(
    '--controller',
    type=click.Choice(['python', 'c', 'arm']),
    default='python',
    show_default=True,
    help='The control program in Python, or its generated C on this machine or an emulated ARM.',
)
@click.option(
    '--set',
    'assignments',
    multiple=True,
    metavar='NODE.PARAM=VALUE',
    help='Ask what the controller would have done with another parameter; may be given again.',
)
@click.option('--json', 'as_json', is_flag=True, help='Print JSON.')
def replay(recording: Path, controller: str, assignments: tuple[str, ...], as_json: bool) -> int:
    """Make the runs of RECORDING again, from what the file itself holds.

    The controller first, on the recorded samples of the devices; then the whole robot, on its
    parameters and seed, the recorded sticks and pushes. Every message is compared.

    Exit status: 0 if all are identical, 1 if one differs, 2 if there is nothing to replay. With
    --set only the controller's duties are compared, and the status is 0.
    """
    from ballbot_ros.cli.replay import replay_recording

    return replay_recording(
        recording, controller=controller, assignments=assignments, as_json=as_json
    )


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


@click.command('map', short_help='Check a map image; write it for other programs.')
@click.argument('image')
@click.option('--wrl', type=click.Path(path_type=Path), help='VRML 2.0 file to write.')
@click.option(
    '--yaml',
    'nav2',
    type=click.Path(path_type=Path),
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


@click.command(short_help='Show recorded runs in a browser.')
@click.argument('recording', type=click.Path(path_type=Path))
@click.argument('other', required=False, type=click.Path(path_type=Path))
@click.option(
    '--host', default='127.0.0.1', show_default=True, help='Address on which the page is served.'
)
@click.option(
    '--port',
    type=click.IntRange(0, 65535),
    default=8080,
    show_default=True,
    help='Its port; 0: a free one.',
)
def view(recording: Path, other: Path | None, host: str, port: int) -> int:
    """Show the last run of RECORDING in a browser, and that of OTHER as its ghost.

    It serves the page until Ctrl-C or SIGTERM.
    """
    from ballbot_ros.cli.view import view_recordings

    return view_recordings([recording, *([other] if other else [])], host, port)


@click.command(short_help='Make a picture or a film of a recorded run.')
@click.argument('recording', type=click.Path(path_type=Path))
@click.option(
    '--view', type=click.Choice(VIEWS), default='chaser1', show_default=True, help='The view.'
)
@click.option(
    '--output',
    required=True,
    type=click.Path(path_type=Path),
    help='File to write: a picture (.png) or a film (.mp4, .gif).',
)
@click.option(
    '--time',
    'moment',
    type=click.FloatRange(0.0),
    help='Time of a picture from the start of the run [s].  [default: the end]',
)
def render(recording: Path, view: str, output: Path, moment: float | None) -> None:
    """Write a picture or a film of the last run of RECORDING, without a window."""
    from ballbot_ros.cli.render import render_recording

    render_recording(recording, view, output, moment)
