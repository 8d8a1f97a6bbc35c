"""`ballbot drive`: the graph in real time, and somebody at the sticks."""

from __future__ import annotations

import os
import signal
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from threading import Thread

import click
import rclpy

from ballbot_ros.cli.experiment import (
    Experiment,
    assign,
    attachments_of,
    output_of,
    require_toolchain,
    settle_map,
    tidied,
)
from ballbot_ros.cli.graph import graph_parameters, write_attachments
from ballbot_ros.cli.graph_monitor import GraphMonitor
from ballbot_ros.cli.node_process import NodeProcess, stop_all
from ballbot_ros.cli.progress import Progress
from ballbot_ros.cli.separate_processes import start_nodes, watch
from ballbot_ros.cli.viewer import require_viewer
from ballbot_ros.nodes.base import spin
from ballbot_ros.nodes.gamepad_teleop import GamepadTeleop
from ballbot_ros.parameter_file import write_parameter_file
from ballbot_ros.parameters import (
    ALL_NODES,
    GAMEPAD,
    NODES,
    PLANT,
    RECORDER,
    VIEWER,
    ParameterSet,
)
from ballbot_ros.scenario.library import load_profile
from ballbot_ros.scenario.scenario import Scenario
from ballbot_ros.stop_request import StopRequest
from ballbot_ros.teleop.terminal import why_no_keyboard

NAME = 'drive'
STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


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

    require_toolchain(parameters)
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
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix='ballbot_')))
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
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    write_attachments(experiment, scratch)
    parameters = graph_parameters(experiment, scratch)
    parameter_file = scratch / 'parameters.yaml'
    write_parameter_file(parameter_file, parameters, ALL_NODES)
    names = [n for n in NODES if n != GAMEPAD and (n != RECORDER or experiment.recording)]
    if viewer:
        names.append(VIEWER)
    processes: dict[str, NodeProcess] = {}
    with StopRequest(numbers=STOP_SIGNALS) as stop, GraphMonitor() as monitor:
        teleop = _Teleop(parameters)
        if hint:
            progress.notice(hint)

        def is_told_to_stop() -> bool:
            return bool(stop.signal) or teleop.has_ended

        try:
            start_nodes(names, parameter_file, progress.notice, processes)
            failure = watch(processes, monitor, progress, is_told_to_stop)
        finally:
            # The gamepad answers to the end, so that log and recording have the same packets.
            stop_all(processes.values(), last=RECORDER)
            teleop.close()
    if teleop.error is not None:
        raise teleop.error
    ends = {process.exit_status for process in processes.values()}
    if failure or 1 in ends or 2 in ends:
        return 2 if 2 in ends else 1
    return teleop.node.exit_status


class _Teleop:
    """The gamepad node on a thread of its own.

    Attributes
    ----------
    node : GamepadTeleop
    error : BaseException or None
        What ended it too early.
    """

    def __init__(self, parameters: ParameterSet) -> None:
        self.node = GamepadTeleop(parameters.values(GAMEPAD))
        self.error: BaseException | None = None
        self._end = rclpy.Future()
        self._thread = Thread(target=self._spin, name='gamepad_teleop', daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        try:
            spin([self.node], self._end)
        except BaseException as error:
            self.error = error
            self.node.finish()

    @property
    def has_ended(self) -> bool:
        """Whether the user has quit, or the terminal has vanished."""
        terminal = self.node.terminal
        return self.node.finished or bool(terminal and terminal.gone)

    def close(self) -> None:
        """End the node."""
        self._end.set_result(None)
        self._thread.join(1.0)
        self.node.close()
        self.node.destroy_node()
