"""The files that a recording has with it: scenario, parameters and versions."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ballbot_ros.errors import BallbotError
from ballbot_ros.parameter_file import read_parameter_file
from ballbot_ros.parameters import ParameterSet
from ballbot_ros.recording.attachments import MAPS, PARAMETERS, SCENARIO, VERSIONS
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.scenario.library import load_scenario
from ballbot_ros.scenario.scenario import Scenario
from ballbot_ros.world.floor_map import FloorMap
from ballbot_ros.world.image import read_map
from ballbot_ros.yaml_document import YamlDocument


@dataclass
class Attached:
    """What the attachments say.

    Attributes
    ----------
    scenario : Scenario or None
    parameters : ParameterSet
        Every parameter; the defaults where none are attached.
    has_parameters : bool
        Whether they were attached.
    versions : dict of str to str
    floor_map : FloorMap or None
        None where no map is attached.
    notices : list of str
        What is not there or cannot be read.
    """

    scenario: Scenario | None = None
    parameters: ParameterSet = field(default_factory=ParameterSet)
    has_parameters: bool = False
    versions: dict[str, str] = field(default_factory=dict)
    floor_map: FloorMap | None = None
    notices: list[str] = field(default_factory=list)


def read_attached(recording: RecordingReader) -> Attached:
    """Read the attachments; one that is not there or not readable is noted, not an error."""
    attached = Attached()
    files = recording.attachments()
    # Their readers take files, whose names and lines they tell.
    with TemporaryDirectory(prefix='ballbot_') as folder:
        for name in (SCENARIO, PARAMETERS, VERSIONS, *(name for name in MAPS if name in files)):
            if name not in files:
                attached.notices.append(f'No {name} is attached; {_WITHOUT[name]}.')
                continue
            path = Path(folder, name)
            path.write_bytes(files[name].data)
            try:
                _read(attached, name, path)
            except BallbotError as error:
                reason = str(error).replace(f'{folder}/', '')
                attached.notices.append(f'{reason}; {_WITHOUT[name]}.')
    return attached


_WITHOUT = {
    SCENARIO: 'no expectation is judged',
    PARAMETERS: 'the defaults are taken, and the first position for the start',
    VERSIONS: 'what made the recording is unknown',
    **dict.fromkeys(MAPS, 'the walls of the topic map are taken'),
}


def _read(attached: Attached, name: str, path: Path) -> None:
    if name == SCENARIO:
        attached.scenario = load_scenario(str(path))
    elif name == PARAMETERS:
        attached.parameters = read_parameter_file(path)
        attached.has_parameters = True
    elif name in MAPS:
        attached.floor_map = read_map(path)
    else:
        content: Any = YamlDocument(path).data
        if isinstance(content, dict):
            attached.versions = {str(key): str(value) for key, value in content.items()}
