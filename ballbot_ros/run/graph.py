"""Preparation of a graph: rclpy, parameters, attachments."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation

from ballbot_ros.errors import BallbotError, one_line
from ballbot_ros.files import write_temporary
from ballbot_ros.nodes.middleware import (
    DOMAIN,
    prepare_middleware,
    ros_domain,
    start_failure,
    stay_local,
)
from ballbot_ros.nodes.participant_ports import avoid_stale_ports
from ballbot_ros.parameters import PLANT, RECORDER, ParameterSet
from ballbot_ros.run.attachments import attachments_of
from ballbot_ros.run.observer import RunObserver
from ballbot_ros.run.spec import RunSpec

RCLError = rclpy_implementation.RCLError


@contextmanager
def ros(log_level: str = 'WARN') -> Iterator[None]:
    """Provide rclpy for the nodes of this process; by default they discover only this machine.

    It raises BallbotError if ROS can't start here, for example without a folder for its logs.
    """
    stay_local()
    if rclpy.ok():
        yield
        return
    prepare_middleware()
    try:
        rclpy.init(
            args=['--ros-args', '--log-level', log_level],
            signal_handler_options=rclpy.SignalHandlerOptions.NO,
        )
    except RuntimeError as error:
        raise BallbotError(start_failure(error)) from None
    try:
        with avoid_stale_ports(ros_domain()):
            yield
    except RCLError as error:  # for example, a peer that can't be resolved
        raise BallbotError(one_line(error)) from None
    finally:
        rclpy.try_shutdown()


def write_attachments(spec: RunSpec, scratch: Path) -> Path:
    """Write the files that the recorder attaches; return their folder."""
    folder = scratch / 'attachments'
    for name, data in attachments_of(spec).items():
        write_temporary(folder / name, data)
    return folder


def graph_parameters(spec: RunSpec, recording: Path | None, scratch: Path) -> ParameterSet:
    """Return the parameters of the nodes: those of the run, and those specific to the graph.

    Parameters
    ----------
    recording : Path or None
        The file that the recorder writes; if None, a recorder creates a new one under ``runs/``.
    scratch : Path
        Folder for files that only the nodes read.
    """
    parameters = ParameterSet()
    parameters.update(spec.parameters)
    if recording:
        parameters.set(RECORDER, 'output', str(recording.resolve()))
    if RECORDER in spec.nodes:
        parameters.set(RECORDER, 'attachments', str(write_attachments(spec, scratch)))
    if spec.record:
        parameters.set(PLANT, 'require_recorder', True)
    return parameters


def call_for(roles: Iterable[str], limit_s: float) -> str:
    """Return the line that asks the user to start nodes of his own within a time [s]."""
    where = f'with {DOMAIN}={ros_domain()}'
    return f'waiting for {", ".join(roles)}: start within {limit_s:g} s, {where}'


def call_for_external(spec: RunSpec, observer: RunObserver) -> None:
    """Ask the user to start the nodes that a run leaves to him, if any."""
    if spec.external:
        observer.notice(call_for(spec.external, spec.plant.startup_timeout))
