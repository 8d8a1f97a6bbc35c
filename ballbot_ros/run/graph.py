"""Preparation of a graph: its parameters and attachments."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ballbot_ros.files import write_temporary
from ballbot_ros.nodes.middleware import DOMAIN, ros_domain
from ballbot_ros.parameters import PLANT, RECORDER, ParameterSet
from ballbot_ros.run.attachments import attachments_of
from ballbot_ros.run.observer import RunObserver
from ballbot_ros.run.spec import RunSpec


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
