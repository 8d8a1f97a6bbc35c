"""Driving by hand: the graph in real time, until it is stopped."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import NamedTuple

from ballbot_ros.controllers.codegen.implementation import compose_controller
from ballbot_ros.engine.scenario.reader import load_profile
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.files import temporary_folder
from ballbot_ros.nodes.gamepad_teleop import GamepadTeleop
from ballbot_ros.nodes.supervisor import StartRequest
from ballbot_ros.nodes.teleop.terminal import KeyPress
from ballbot_ros.parameters import (
    CONTROLLER,
    GAMEPAD,
    NODES,
    PLANT,
    RECORDER,
    VIEWER,
    GamepadParameters,
    ParameterSet,
    PlantParameters,
)
from ballbot_ros.parameters.files import assign
from ballbot_ros.process import StopRequest
from ballbot_ros.run.execution import output_files
from ballbot_ros.run.graph import graph_parameters
from ballbot_ros.run.node_process import ForkClient
from ballbot_ros.run.observer import RunObserver, StartObserver
from ballbot_ros.run.one_process import NodeThread, ros
from ballbot_ros.run.requirements import require_viewer
from ballbot_ros.run.separate_processes import run_nodes
from ballbot_ros.run.spec import RunSpec, check_reserved_parameters, resolve_map

NAME = 'drive'
"""Name of the recording."""


class DriveResult(NamedTuple):
    """Exit status of a drive, and its recording, if any."""

    exit_status: int
    recording: Path | None


def drive_spec(
    *,
    map_name: str | None = None,
    start: tuple[float, float] | None = None,
    profile: str | None = None,
    device: str | None = None,
    assignments: Sequence[str] = (),
    controller: str | None = None,
    output: Path | None = None,
    record: bool = True,
) -> RunSpec:
    """Return the specification of a drive; BallbotError if an option can't be used.

    Parameters
    ----------
    start : tuple of float or None
        Start position x, y in the frame ``map`` [m].
    profile : str or None
        Profile of the devices; None for ``ideal``.
    device : str or None
        Gamepad, by its number or part of its name; None for any.
    output : Path or None
        Folder for the recording; None for a new one under ``runs/``.
    """
    parameters = ParameterSet() if profile is None else load_profile(profile)
    parameters.set(PLANT, 'real_time_factor', 1.0)
    parameters.set(PLANT, 'on_wall_hit', 'report')
    if map_name is not None:
        parameters.set(PLANT, 'map', map_name, '--map')
    if start is not None:
        parameters.set(PLANT, 'start_position_x', start[0], '--start')
        parameters.set(PLANT, 'start_position_y', -start[1], '--start')
    if device is not None:
        parameters.set(GAMEPAD, 'device', device, '--device')
    for assignment in assignments:
        assign(parameters, assignment)
    if controller is not None:
        parameters.set(CONTROLLER, 'implementation', controller, '--controller')
    loaded = compose_controller(parameters)
    check_reserved_parameters(parameters)
    resolve_map(parameters)
    return RunSpec(Scenario(NAME), parameters, output=output, record=record, controller=loaded)


def drive(
    spec: RunSpec,
    observer: RunObserver,
    *,
    no_keyboard: str = '',
    viewer: bool = False,
    starts_paused: bool = False,
) -> DriveResult:
    """Run the graph; the gamepad node runs in this process, so that it can use the terminal.

    It raises BallbotError if the drive can't start.

    Parameters
    ----------
    no_keyboard : str
        Why the keyboard is not used for driving; '' if it is.
    starts_paused : bool
        Whether the drive waits for the page to be opened, or for a key.
    """
    if viewer:
        require_viewer(spec.parameters)
    with ExitStack() as stack:
        recording = stack.enter_context(output_files(spec)).recording
        scratch = Path(stack.enter_context(temporary_folder()))
        parameters = graph_parameters(spec, recording, scratch)
        # Set these after the attachments are written: a replay needs no terminal, and waits for
        # nobody.
        parameters.set(GAMEPAD, 'keyboard', not no_keyboard)
        if starts_paused:
            parameters.set(PLANT, 'start_paused', True)
        names = [n for n in NODES if n != GAMEPAD and (n != RECORDER or recording)]
        if viewer:
            names.append(VIEWER)
        status = _run_graph(names, parameters, scratch, observer, no_keyboard)
        recorded = recording if recording and recording.exists() else None
    return DriveResult(status, recorded)


def _run_graph(
    names: Sequence[str],
    parameters: ParameterSet,
    scratch: Path,
    observer: RunObserver,
    no_keyboard: str,
) -> int:
    with ExitStack() as stack:
        stop = stack.enter_context(StopRequest())
        client = stack.enter_context(ForkClient())
        stack.enter_context(ros('INFO'))
        gamepad = GamepadTeleop(parameters.of(GamepadParameters))
        if parameters.of(PlantParameters).start_paused:
            observer = stack.enter_context(_starting_at_key_press(gamepad, observer))
        thread = NodeThread(gamepad)
        if no_keyboard:
            observer.notice(f'no keyboard ({no_keyboard}): drive with a gamepad, joy or cmd_vel')

        def should_stop() -> bool:
            # The user has quit, or the terminal has disappeared.
            terminal = gamepad.terminal
            return bool(stop.signal or gamepad.finished or (terminal and terminal.is_closed))

        try:
            processes, failure = run_nodes(
                client, names, parameters, scratch, observer, should_stop
            )
        finally:
            # The gamepad answers until the end, so that log and recording have the same packets.
            thread.close()
    if thread.error is not None:
        raise thread.error
    ends = [process.exit_status for process in processes.values()]
    return _exit_status(failure, ends, gamepad.exit_status)


@contextmanager
def _starting_at_key_press(gamepad: GamepadTeleop, observer: RunObserver) -> Iterator[RunObserver]:
    """Start the drive when a key is pressed; yield the observer that it needs."""
    start = StartRequest(gamepad)
    if gamepad.terminal:
        gamepad.terminal.on_key = start.request
        yield observer
    else:
        with closing(KeyPress(start.request)) as key_press:
            yield StartObserver(observer, key_press)


def _exit_status(failure: str, ends: Collection[int | None], gamepad: int) -> int:
    """Return the status of a drive; a mistake of the user, 2, explains all other failures."""
    if failure or 1 in ends or 2 in ends:
        return 2 if 2 in ends else 1
    return gamepad
