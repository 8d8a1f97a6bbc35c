"""What is prepared alike for every run: parameters, map, folder, attachments."""

from __future__ import annotations

import platform
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import yaml

from ballbot_ros import __version__
from ballbot_ros.errors import BallbotError
from ballbot_ros.parameters import (
    ALL_NODES,
    GAMEPAD,
    PLANT,
    ParameterError,
    ParameterSet,
    PlantParameters,
    SonarParameters,
    parameters_of,
)
from ballbot_ros.parameters.files import format_parameters
from ballbot_ros.recording.attachments import PARAMETERS, SCENARIO, VERSIONS
from ballbot_ros.scenario.scenario import Scenario
from ballbot_ros.text_enum import TextEnum
from ballbot_ros.world.library import image_suffix, is_file_name, read_map_file
from ballbot_ros.world.sonar_beam import SonarBeam
from ballbot_ros.world.world import World
from ballbot_ros.yaml_document import parse_value

RECORDED_VERSIONS = ('numpy', 'scipy', 'control', 'mcap', 'ros-rclpy', 'ros-rmw-fastrtps-cpp')


class Processes(TextEnum):
    """How the nodes of a run are spread over processes."""

    SEPARATE = 'separate'
    ONE = 'one'
    NONE = 'none'
    """No nodes at all: the closed loop without ROS."""


@dataclass
class Experiment:
    """A run as it is to be made.

    Attributes
    ----------
    scenario : Scenario
    reference : str
        Name or path by which the nodes load the scenario.
    parameters : ParameterSet
    recording : Path or None
        The file to write.
    attachments : dict
        Files that make the recording enough to run it again, by name.
    """

    scenario: Scenario
    reference: str
    parameters: ParameterSet
    recording: Path | None
    attachments: dict[str, bytes] = field(default_factory=dict)


def assign(parameters: ParameterSet, assignment: str) -> None:
    """Set the parameter that a `--set node.param=value` names."""
    target, equals, text = assignment.partition('=')
    node, dot, name = target.partition('.')
    if not (equals and dot and node and name):
        raise ParameterError(f'--set {assignment}: not of the form node.param=value')
    row = parameters_of(node).get(name) if node in ALL_NODES else None
    is_text = row is not None and isinstance(row.default, str)
    value = text if is_text else parse_value(text)
    parameters.set(node, name, value, f'--set {assignment}')


def settle_map(parameters: ParameterSet) -> World | None:
    """Find out here, before anything starts, whether map and start position are of use."""
    world = World.of(parameters.of(PlantParameters))
    SonarBeam(parameters.of(SonarParameters))
    name = parameters.of(PlantParameters).map
    if is_file_name(name):
        parameters.set(PLANT, 'map', str(Path.cwd() / name))
    return world


def output_of(name: str, output: Path | None, *, record: bool) -> tuple[Path | None, Path | None]:
    """Make the folder of a run, and return it and the recording to write; None for none.

    Raises
    ------
    BallbotError
        If the folder can't be written to, or has a recording of that name already.
    """
    if output is None and not record:
        return None, None
    folder = output or _new_folder(name)
    if output is not None:
        _make_folder(output)
    recording = folder / f'{name}.mcap' if record else None
    if recording and recording.exists():
        raise BallbotError(f'{recording}: exists already; choose another --output')
    return folder, recording


@contextmanager
def tidied(folder: Path | None) -> Iterator[None]:
    """Leave no empty folder behind where nothing came of a run."""
    try:
        yield
    finally:
        if folder and folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / '.ballbot_probe'
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise BallbotError(f'--output {folder}: {error.strerror}') from None


def _new_folder(name: str) -> Path:
    stem = f'{datetime.now():%Y-%m-%d_%H-%M-%S}_{name}'
    for suffix in ('', *(f'_{number}' for number in range(2, 1000))):
        folder = Path('runs') / (stem + suffix)
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise BallbotError(f'{folder}: {error.strerror}') from None
        return folder
    raise BallbotError(f'runs/{stem}: exists already')


def attachments_of(experiment: Experiment) -> dict[str, bytes]:
    """Return the files that make a recording enough to run it again, by name."""
    versions = {'ballbot_ros': __version__, 'python': platform.python_version()}
    for package in RECORDED_VERSIONS:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            continue
    # Scenario and map are attached; where their files lie on this machine is nobody's business.
    parameters = ParameterSet()
    parameters.update(experiment.parameters)
    parameters.set(GAMEPAD, 'scenario', '')
    attached_map = {}
    if name := experiment.parameters.of(PlantParameters).map:
        image = read_map_file(name)
        attached = f'map{image_suffix(image)}'
        attached_map[attached] = image
        if is_file_name(name):
            parameters.set(PLANT, 'map', attached)
    text = experiment.scenario.text
    return {
        **({SCENARIO: text.encode()} if text else {}),
        PARAMETERS: format_parameters(parameters).encode(),
        VERSIONS: yaml.safe_dump(versions, sort_keys=False).encode(),
        **attached_map,
    }
