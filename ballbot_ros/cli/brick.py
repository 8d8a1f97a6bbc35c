"""`ballbot brick`: drive a real brick, or emulate one."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import click

from ballbot_ros.cli.options import (
    NEW_FILE,
    PATH,
    Choice,
    device_option,
    folder_option,
    no_keyboard_option,
    set_option_like,
)
from ballbot_ros.cli.progress import Progress
from ballbot_ros.controllers.codegen.application import PARAMETER_FILE, write_application
from ballbot_ros.controllers.codegen.toolchain import TARGETS
from ballbot_ros.engine.scenario.reader import load_profile
from ballbot_ros.errors import TeleopError, os_errors
from ballbot_ros.files import next_steps, own_command, temporary_folder
from ballbot_ros.nodes.teleop.terminal import keyboard_unavailable_reason
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.run.requirements import require_rclpy


@click.group('brick')
def command() -> None:
    """Drive your own NXT brick, or an emulated one."""


@command.command('drive')
@click.option('--address', default='', help='Bluetooth address of the brick.')
@click.option('--port', default='', help='Serial device of the brick, or what `emulate` prints.')
@click.option(
    '--program',
    type=PATH,
    help="Folder of the brick's program, or its parameter file.  [default: the document's values]",
)
@device_option
@no_keyboard_option
@folder_option('the recording.  [default: runs/<date>_brick]')
@click.option('--no-record', is_flag=True, help='Write no recording.')
@set_option_like('Set a parameter, such as brick_link.deadzone=0.1')
def drive(
    address: str,
    port: str,
    program: Path | None,
    device: str | None,
    no_keyboard: bool,
    output: Path | None,
    no_record: bool,
    assignments: tuple[str, ...],
) -> int:
    """Drive a brick by hand and record it: gamepad, keyboard, or the topics joy and cmd_vel.

    Connects as soon as the brick is there, and again after a loss, until q, Ctrl-C or SIGTERM. Give
    either --address or --port.
    """
    if bool(address) == bool(port):
        raise click.UsageError('give either --address or --port')
    if program and program.is_dir():
        program /= PARAMETER_FILE
    require_rclpy()
    from ballbot_ros.run.brick_drive import NAME, brick_spec, drive_brick

    spec = brick_spec(
        program,
        address=address,
        port=port,
        device=device,
        assignments=assignments,
        output=output,
        record=not no_record,
    )
    obstacle = '--no-keyboard' if no_keyboard else keyboard_unavailable_reason()
    with Progress(NAME, 0.0, bar=False) as progress:
        result = drive_brick(spec, progress, program=program, no_keyboard=obstacle)
    if result.recording:
        click.echo('\n'.join([f'recording  {result.recording}', *next_steps(result.recording)]))
    return result.exit_status


@command.command('emulate')
@click.argument('folder', type=PATH, required=False)
@click.option(
    '--target',
    type=Choice([*TARGETS]),
    default='c',
    show_default=True,
    help='Run the C compiled for this machine (c), or on an emulated ARM processor (arm).',
)
@click.option(
    '--socket',
    'socket_path',
    type=NEW_FILE,
    help='Listen on this Unix socket instead of a pseudo-terminal.',
)
@click.option(
    '--profile',
    default='hardware',
    show_default=True,
    help='Device profile of the robot, or a file.',
)
@set_option_like('Set a parameter, such as gyro_driver.noise=0.5')
def emulate(
    folder: Path | None,
    target: str,
    socket_path: Path | None,
    profile: str,
    assignments: tuple[str, ...],
) -> int:
    """Run the generated program in FOLDER with a simulated robot, in real time.

    It plays the brick for `ballbot brick drive`, until Ctrl-C or SIGTERM. Without FOLDER, the
    program has the parameters of the profile.
    """
    from ballbot_ros.nodes.transports import local_socket, pseudo_terminal
    from ballbot_ros.run.brick_emulator import (
        Listener,
        compiled_program,
        emulate,
        emulator_parameters,
    )

    with ExitStack() as stack:
        given = ['--program', folder] if folder else []
        if folder is None:
            folder = Path(stack.enter_context(temporary_folder()))
            write_application(folder, load_profile(profile).of(ControllerParameters))
        parameters = emulator_parameters(folder, profile, assignments)
        start = stack.enter_context(compiled_program(folder, target))
        listener: Listener
        if socket_path is None:
            listener = pseudo_terminal.Listener()
        else:
            with os_errors(TeleopError, socket_path):
                listener = local_socket.Listener(str(socket_path))
        stack.callback(listener.close)
        click.echo(f'the brick is at {listener.path}')
        words = ['brick', 'drive', '--port', listener.path, *given]
        click.echo(f'drive it  {own_command(*words)}')
        emulate(parameters, start, listener, click.echo)
    return 0
