"""Preparation of a graph: its parameters and attachments."""

from __future__ import annotations

import platform
from collections.abc import Container, Iterable, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from ballbot_ros import __version__
from ballbot_ros.analysis.recorded_controller import SUCCESSOR, encode_controller
from ballbot_ros.controllers.codegen.implementation import public_changes, successor_of
from ballbot_ros.controllers.loading import load_controller, public_reference
from ballbot_ros.files import write_temporary
from ballbot_ros.nodes.middleware import DOMAIN, ros_domain
from ballbot_ros.parameters import (
    CONTROLLER,
    DOCUMENTS_PROGRAM,
    GAMEPAD,
    PLANT,
    RECORDER,
    ControllerParameters,
    ParameterSet,
)
from ballbot_ros.parameters.files import format_parameters
from ballbot_ros.parameters.yaml_document import yaml_text
from ballbot_ros.recording.rosbag2 import MAPS, PARAMETERS, PARENT, SCENARIO, VERSIONS
from ballbot_ros.robot.world.floor_map import image_suffix, is_file_name, read_map_file
from ballbot_ros.run.observer import RunObserver
from ballbot_ros.run.spec import RunSpec

RECORDED_VERSIONS = ('numpy', 'scipy', 'control', 'mcap', 'ros-rclpy', 'ros-rmw-fastrtps-cpp')


def attachments_of(spec: RunSpec) -> Mapping[str, bytes]:
    """Return scenario, parameters, versions, map and controller of a run, by file name.

    It raises WorldError if the map's file can't be read.
    """
    files: dict[str, bytes] = {}
    if name := spec.plant.map:
        image = read_map_file(name)
        files[f'map{image_suffix(image)}'] = image
    if spec.controller:
        files |= encode_controller(spec.controller)
    if successor := successor_of(spec.parameters.of(ControllerParameters)):
        reference = successor[1].implementation
        if reference not in DOCUMENTS_PROGRAM:
            files |= encode_controller(load_controller(reference), SUCCESSOR)
    if spec.parent:
        files[PARENT] = spec.parent.encode()
    text = spec.scenario.text
    return {
        **({SCENARIO: text.encode()} if text else {}),
        PARAMETERS: format_parameters(public_parameters(spec, files)).encode(),
        VERSIONS: yaml_text(dict(versions())).encode(),
        **files,
    }


def public_parameters(spec: RunSpec, attached: Container[str]) -> ParameterSet:
    """Return the parameters of a run without paths on this machine, which are private.

    The content of the files is attached instead, under the names `attached`.
    """
    parameters = ParameterSet(spec.parameters)
    parameters.set(GAMEPAD, 'scenario', '')
    if is_file_name(spec.plant.map):
        parameters.set(PLANT, 'map', next(name for name in MAPS if name in attached))
    if spec.controller:
        reference = public_reference(spec.controller.code.reference)
        parameters.set(CONTROLLER, 'implementation', reference)
    changes = spec.parameters.of(ControllerParameters).changes
    parameters.set(CONTROLLER, 'changes', public_changes(changes))
    return parameters


@cache
def versions() -> Mapping[str, str]:
    """Return the versions that influence the result."""
    found = {'ballbot_ros': __version__, 'python': platform.python_version()}
    known = {package: version_of(package) for package in RECORDED_VERSIONS}
    return found | {package: known[package] for package in known if known[package]}


def version_of(package: str) -> str:
    """Return the version of a package; empty if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ''


def graph_parameters(spec: RunSpec, recording: Path | None, scratch: Path) -> ParameterSet:
    """Return the parameters of the nodes: those of the run, and those specific to the graph.

    Parameters
    ----------
    recording : Path or None
        The file that the recorder writes; if None, a recorder creates a new one under ``runs/``.
    scratch : Path
        Folder for files that only the nodes read.
    """
    parameters = ParameterSet(spec.parameters)
    if recording:
        parameters.set(RECORDER, 'output', str(recording.resolve()))
    if RECORDER in spec.nodes:
        folder = scratch / 'attachments'
        for name, data in attachments_of(spec).items():
            write_temporary(folder / name, data)
        parameters.set(RECORDER, 'attachments', str(folder))
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
