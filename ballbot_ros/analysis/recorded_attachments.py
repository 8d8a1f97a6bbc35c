"""The attachments of a recording: scenario, parameters and versions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from ballbot_ros.analysis.announced_parameters import AnnouncedParameters
from ballbot_ros.analysis.recorded_controller import decode_controller
from ballbot_ros.errors import BallbotError, short_text
from ballbot_ros.files import temporary_folder, write_temporary
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, ParameterSet, PlantParameters
from ballbot_ros.parameters.files import read_parameter_file
from ballbot_ros.recording.attachments import MAPS, PARAMETERS, SCENARIO, VERSIONS
from ballbot_ros.recording.reader import AttachedFile, RecordingReader
from ballbot_ros.scenario.library import load_scenario
from ballbot_ros.scenario.scenario import Scenario
from ballbot_ros.world.floor_map import FloorMap
from ballbot_ros.world.image import read_map
from ballbot_ros.world.library import load_map, map_names
from ballbot_ros.yaml_document import YamlDocument


@dataclass
class RecordedAttachments:
    """The content of the attachments.

    Attributes
    ----------
    parameters : ParameterSet
        All parameters, with defaults for those that are neither attached nor announced.
    has_parameters : bool
        Whether the parameters were attached, or announced by the participants.
    floor_map : FloorMap or None
        None if no map is attached.
    notices : list of str
        A line about each attachment that is missing or unreadable.
    files : mapping of str to AttachedFile
        The attached files.
    external : mapping of str to str
        By role: the programs of the participants that are nodes of other packages.
    """

    scenario: Scenario | None = None
    parameters: ParameterSet = field(default_factory=ParameterSet)
    has_parameters: bool = False
    versions: dict[str, str] = field(default_factory=dict)
    floor_map: FloorMap | None = None
    notices: list[str] = field(default_factory=list)
    files: Mapping[str, AttachedFile] = field(default_factory=dict)
    external: Mapping[str, str] = field(default_factory=dict)

    @property
    def controller(self) -> str:
        """Name of the controller; '' if it is unknown."""
        own = self.parameters.of(ControllerParameters).implementation
        return self.external.get(CONTROLLER, own if self.has_parameters else '')

    def for_run(self, run: str, announced: AnnouncedParameters) -> RecordedAttachments:
        """Return the content that applies to the run with this name in ``plant/run``."""
        external = {
            role: short_text(each.implementation) for role, each in announced.foreign(run).items()
        }
        if not announced.has_parameters(run):
            return replace(self, external=external)
        parameters = announced.of(run, self.parameters, self.files)
        name = parameters.of(PlantParameters).map
        floor_map = self.floor_map
        if name not in self.files:
            # The file of this run's map is not attached. Load the map if it is shipped; if not,
            # the topic map has its walls.
            floor_map = load_map(name) if name in map_names() else None
        notices = [each for each in self.notices if not each.startswith(f'No {PARAMETERS} ')]
        scenario = self.scenario
        if scenario and announced.is_of_another_scenario(run):
            scenario = None
            notices.append(f'{SCENARIO} belongs to another run; {_WITHOUT[SCENARIO]}.')
        return replace(
            self,
            scenario=scenario,
            parameters=parameters,
            has_parameters=True,
            floor_map=floor_map,
            notices=notices,
            external=external,
        )


def read_attachments(recording: RecordingReader) -> RecordedAttachments:
    """Read the attachments; a missing or unreadable one becomes a notice, not an error."""
    files = recording.attachments()
    attached = RecordedAttachments(files=files)
    # Write the attachments to files for their readers, whose errors name file and line.
    with temporary_folder() as folder:
        for name in (*(name for name in MAPS if name in files), SCENARIO, PARAMETERS, VERSIONS):
            if name not in files:
                attached.notices.append(f'No {name} is attached; {_WITHOUT[name]}.')
                continue
            path = Path(folder, name)
            write_temporary(path, files[name].data)
            try:
                _read(attached, name, path)
            except BallbotError as error:
                reason = str(error).replace(f'{folder}/', '')
                attached.notices.append(f'{reason}; {_WITHOUT[name]}.')
    if identity := decode_controller(files):
        attached.versions['controller'] = identity.description
    return attached


_WITHOUT = {
    SCENARIO: 'no expectation is judged',
    PARAMETERS: 'defaults are assumed, and the first position counts as the start',
    VERSIONS: 'the versions behind the recording are unknown',
    **dict.fromkeys(MAPS, 'the walls of the topic map are used'),
}


def _read(attached: RecordedAttachments, name: str, path: Path) -> None:
    if name == SCENARIO:
        # A recording can name any path, but only the attached image may be read.
        maps = [path.with_name(each) for each in MAPS if each in attached.files]
        attached.scenario = load_scenario(
            str(path), map_file=next(iter(maps), path.with_name(MAPS[0]))
        )
    elif name == PARAMETERS:
        attached.parameters = read_parameter_file(path)
        attached.has_parameters = True
    elif name in MAPS:
        attached.floor_map = read_map(path)
    else:
        content = YamlDocument(path).data
        if isinstance(content, dict):
            attached.versions = {str(key): str(value) for key, value in content.items()}
