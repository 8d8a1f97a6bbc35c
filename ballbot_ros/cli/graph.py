"""What both ways of running the graph prepare."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation

from ballbot_ros.cli.experiment import Experiment
from ballbot_ros.errors import BallbotError, one_line
from ballbot_ros.files import write_temporary
from ballbot_ros.nodes.middleware import (
    DISCOVERY_RANGE,
    prepare_middleware,
    ros_domain,
    start_failure,
)
from ballbot_ros.nodes.participant_ports import avoid_stale_ports
from ballbot_ros.parameters import PLANT, RECORDER, ParameterSet, PlantParameters

RCLError = rclpy_implementation.RCLError


@contextmanager
def ros(log_level: str = 'WARN') -> Iterator[None]:
    """Have rclpy ready for the nodes of this process, on this machine unless told otherwise.

    Parameters
    ----------
    log_level : str
        Of the nodes; the command itself tells of the run.

    Raises
    ------
    BallbotError
        If ROS can't start here, such as without a folder for its logs.
    """
    os.environ.setdefault(DISCOVERY_RANGE, 'LOCALHOST')
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
    except RCLError as error:  # such as a peer that can't be resolved
        raise BallbotError(one_line(error)) from None
    finally:
        rclpy.try_shutdown()


def write_attachments(experiment: Experiment, scratch: Path) -> None:
    """Write the files that the recorder attaches to the recording."""
    for name, data in experiment.attachments.items():
        write_temporary(_attachments_folder(scratch) / name, data)


def graph_parameters(experiment: Experiment, scratch: Path) -> ParameterSet:
    """Return the experiment's parameters with those that only a graph needs."""
    parameters = ParameterSet()
    parameters.update(experiment.parameters)
    if experiment.recording:
        parameters.set(RECORDER, 'output', str(experiment.recording.resolve()))
        parameters.set(RECORDER, 'attachments', str(_attachments_folder(scratch)))
        if parameters.of(PlantParameters).lockstep:
            parameters.set(PLANT, 'require_recorder', True)
    return parameters


def _attachments_folder(scratch: Path) -> Path:
    return scratch / 'attachments'
