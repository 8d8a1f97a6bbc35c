"""The attachments of a recording, with which its run can be replayed."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version

import yaml

from ballbot_ros import __version__
from ballbot_ros.analysis.recorded_controller import encode_controller
from ballbot_ros.controllers.loading import public_reference
from ballbot_ros.parameters import CONTROLLER, GAMEPAD, PLANT, ParameterSet
from ballbot_ros.parameters.files import format_parameters
from ballbot_ros.recording.attachments import PARAMETERS, SCENARIO, VERSIONS
from ballbot_ros.run.spec import RunSpec
from ballbot_ros.world.library import image_suffix, is_file_name, read_map_file

RECORDED_VERSIONS = ('numpy', 'scipy', 'control', 'mcap', 'ros-rclpy', 'ros-rmw-fastrtps-cpp')


def attachments_of(spec: RunSpec) -> Mapping[str, bytes]:
    """Return scenario, parameters, versions, map and controller of a run, by file name.

    It raises WorldError if the map's file can't be read.
    """
    # Keep paths on this machine private: the content of the files is attached instead.
    parameters = ParameterSet()
    parameters.update(spec.parameters)
    parameters.set(GAMEPAD, 'scenario', '')
    files: dict[str, bytes] = {}
    if name := spec.plant.map:
        image = read_map_file(name)
        attached_name = f'map{image_suffix(image)}'
        files[attached_name] = image
        if is_file_name(name):
            parameters.set(PLANT, 'map', attached_name)
    if spec.controller:
        files |= encode_controller(spec.controller)
        reference = public_reference(spec.controller.code.reference)
        parameters.set(CONTROLLER, 'implementation', reference)
    text = spec.scenario.text
    return {
        **({SCENARIO: text.encode()} if text else {}),
        PARAMETERS: format_parameters(parameters).encode(),
        VERSIONS: yaml.safe_dump(_versions(), sort_keys=False).encode(),
        **files,
    }


def _versions() -> dict[str, str]:
    """Return the versions that influence the result."""
    versions = {'ballbot_ros': __version__, 'python': platform.python_version()}
    for package in RECORDED_VERSIONS:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            continue
    return versions
