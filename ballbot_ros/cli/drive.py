"""`ballbot drive`: the graph in real time, and somebody at the sticks."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import click

from ballbot_ros.cli.experiment import (
    Experiment,
    assign,
    attachments_of,
    output_of,
    settle_map,
    tidied,
)
from ballbot_ros.cli.graph import graph_parameters, ros, write_attachments
from ballbot_ros.cli.graph_monitor import GraphMonitor
from ballbot_ros.cli.node_process import NodeProcess, stop_all
from ballbot_ros.cli.node_thread import NodeThread
from ballbot_ros.cli.progress import Progress
from ballbot_ros.cli.requirements import require_viewer
from ballbot_ros.cli.separate_processes import start_nodes, watch
from ballbot_ros.codegen.implementation import require_implementation
from ballbot_ros.files import temporary_folder
from ballbot_ros.nodes.gamepad_teleop import GamepadTeleop
from ballbot_ros.parameters import (
    ALL_NODES,
    GAMEPAD,
    NODES,
    PLANT,
    RECORDER,
    VIEWER,
    ControllerParameters,
    GamepadParameters,
    ParameterSet,
)
from ballbot_ros.parameters.files import write_parameter_file
from ballbot_ros.scenario.library import load_profile
from ballbot_ros.scenario.scenario import Scenario
from ballbot_ros.stop_request import StopRequest
from ballbot_ros.teleop.terminal import why_no_keyboard

NAME = 'drive'


def drive_by_hand(
    *,
    map_name: str | None,
    start: tuple[float, float] | None,
    profile: str | None,
    device: str | None,
    keyboard: bool,
    output: Path | None,
    record: bool,
    log: Path | None,
    viewer: bool,
    assignments: Sequence[str],
) -> int:
    """Drive until told to stop; return the exit status."""
    parameters = ParameterSet()
    if profile is not None:
        parameters.update(load_profile(profile))
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

    require_implementation(parameters.of(ControllerParameters).implementation)
    if viewer:
        require_viewer(parameters)
    settle_map(parameters)
    folder, recording = output_of(NAME, output, record=record)
    experiment = Experiment(Scenario(NAME), '', parameters, recording)
    # What follows is of this drive; it has no place in what makes it possible to run it again.
    experiment.attachments = attachments_of(experiment)
    if log is not None:
        parameters.set(GAMEPAD, 'log_csv', str(log.resolve()), '--log')
    obstacle = why_no_keyboard() if keyboard else '--no-keyboard'
    parameters.set(GAMEPAD, 'keyboard', not obstacle)

    with ExitStack() as stack:
        stack.enter_context(tidied(folder))
        scratch = Path(stack.enter_context(temporary_folder()))
        progress = stack.enter_context(Progress(NAME, 0.0, bar=bool(obstacle)))
        hint = f'no keyboard ({obstacle}): a gamepad, joy or cmd_vel drives' if obstacle else ''
        status = _drive(experiment, scratch, progress, hint, viewer=viewer)
    if recording and recording.exists():
        click.echo(f'recording  {recording}')
    return status


def _drive(
    experiment: Experiment, scratch: Path, progress: Progress, hint: str, *, viewer: bool
) -> int:
    """Run the graph; the gamepad node, which may own the terminal, is in this process."""
    write_attachments(experiment, scratch)
    parameters = graph_parameters(experiment, scratch)
    parameter_file = scratch / 'parameters.yaml'
    write_parameter_file(parameter_file, parameters, ALL_NODES)
    names = [n for n in NODES if n != GAMEPAD and (n != RECORDER or experiment.recording)]
    if viewer:
        names.append(VIEWER)
    processes: dict[str, NodeProcess] = {}
    with StopRequest() as stop, ros('INFO'), GraphMonitor() as monitor:
        gamepad = GamepadTeleop(parameters.of(GamepadParameters))
        thread = NodeThread(gamepad)
        if hint:
            progress.notice(hint)

        def is_told_to_stop() -> bool:
            # The user has quit, or the terminal has vanished.
            terminal = gamepad.terminal
            return bool(stop.signal or gamepad.finished or (terminal and terminal.gone))

        try:
            start_nodes(names, parameter_file, progress.notice, processes)
            failure = watch(processes, monitor, progress, is_told_to_stop)
        finally:
            # The gamepad answers to the end, so that log and recording have the same packets.
            stop_all(processes.values(), last=RECORDER)
            thread.close()
    if thread.error is not None:
        raise thread.error
    ends = {process.exit_status for process in processes.values()}
    if failure or 1 in ends or 2 in ends:
        return 2 if 2 in ends else 1
    return gamepad.exit_status
