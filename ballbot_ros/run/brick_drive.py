"""Driving a brick by hand: the link to it in this process, until it is stopped."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.files import read_bytes, temporary_folder, write_temporary
from ballbot_ros.nodes.base import SIGNAL_PERIOD_S
from ballbot_ros.nodes.brick_link import BrickLink
from ballbot_ros.parameters import BRICK_LINK, BrickLinkParameters, ParameterError, ParameterSet
from ballbot_ros.parameters.files import assign, read_parameter_file
from ballbot_ros.parameters.yaml_document import yaml_text
from ballbot_ros.process import StopRequest
from ballbot_ros.recording.rosbag2 import PARAMETERS, VERSIONS
from ballbot_ros.run.drive import DriveResult
from ballbot_ros.run.execution import output_files
from ballbot_ros.run.graph import versions
from ballbot_ros.run.observer import RunObserver
from ballbot_ros.run.one_process import NodeThread, ros
from ballbot_ros.run.spec import RunSpec

NAME = 'brick'
"""Name of the recording."""

_OPTIONS = [
    f'{BRICK_LINK}.{name}'
    for name in ('address', 'serial_port', 'output', 'attachments', 'keyboard')
]
"""Parameters that options of the command set."""


def brick_spec(
    program: Path | None = None,
    *,
    address: str = '',
    port: str = '',
    device: str | None = None,
    assignments: Sequence[str] = (),
    output: Path | None = None,
    record: bool = True,
) -> RunSpec:
    """Return the specification of a drive; BallbotError if an option can't be used.

    Parameters
    ----------
    program : Path or None
        Parameter file of the program on the brick; None for the document's values.
    address, port : str
        Where the brick is: a Bluetooth address, or a serial device or socket.
    device, output
        As in :func:`~ballbot_ros.run.drive.drive_spec`.
    """
    parameters = read_parameter_file(program) if program else ParameterSet()
    parameters.set(BRICK_LINK, 'address', address, '--address')
    parameters.set(BRICK_LINK, 'serial_port', port, '--port')
    if device is not None:
        parameters.set(BRICK_LINK, 'device', device, '--device')
    for assignment in assignments:
        if not assignment.startswith(f'{BRICK_LINK}.'):
            raise ParameterError(f'--set {assignment}: only {BRICK_LINK} runs here')
        if assignment.partition('=')[0] in _OPTIONS:
            raise ParameterError(f'--set {assignment}: use the options of the command')
        assign(parameters, assignment)
    return RunSpec(Scenario(NAME), parameters, output=output, record=record)


def drive_brick(
    spec: RunSpec, observer: RunObserver, *, program: Path | None = None, no_keyboard: str = ''
) -> DriveResult:
    """Serve the link until the user quits, or asks to stop.

    It raises BallbotError if the drive can't start.

    Parameters
    ----------
    program : Path or None
        Parameter file of the program on the brick, which is attached to the recording.
    no_keyboard : str
        Why the keyboard is not used for driving; '' if it is.
    """
    with ExitStack() as stack:
        recording = stack.enter_context(output_files(spec)).recording
        scratch = Path(stack.enter_context(temporary_folder()))
        parameters = ParameterSet(spec.parameters)
        parameters.set(BRICK_LINK, 'keyboard', not no_keyboard)
        if recording:
            write_temporary(scratch / VERSIONS, yaml_text(dict(versions())).encode())
            if program:
                write_temporary(scratch / PARAMETERS, read_bytes(program))
            parameters.set(BRICK_LINK, 'output', str(recording.resolve()))
            parameters.set(BRICK_LINK, 'attachments', str(scratch))
        stop = stack.enter_context(StopRequest())
        stack.enter_context(ros('INFO'))
        node = BrickLink(parameters.of(BrickLinkParameters))
        thread = NodeThread(node)
        try:
            if no_keyboard:
                notice = f'no keyboard ({no_keyboard}): drive with a gamepad, joy or cmd_vel'
                observer.notice(notice)
            while not (stop.signal or node.finished or (node.terminal and node.terminal.is_closed)):
                time.sleep(SIGNAL_PERIOD_S)
        finally:
            thread.close()
        if node.losses:
            observer.notice(node.losses)
        if thread.error is not None:
            raise thread.error
        if node.newest is None:
            observer.notice(f'no packet has arrived from {node.name}')
            if recording:
                recording.unlink(missing_ok=True)
            return DriveResult(1, None)
    return DriveResult(node.exit_status, recording)
