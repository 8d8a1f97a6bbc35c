"""The scenario of a recorded run, and its pushes: from the scenario or from outside."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from ballbot_ros.analysis.figure_parts import Interval, IntervalKind
from ballbot_ros.analysis.recorded_controller import decode_controller
from ballbot_ros.analysis.recorded_runs import END_OF_TIME_NS, AnnouncedParameters
from ballbot_ros.engine.scenario.reader import load_scenario
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.errors import BallbotError, short_text
from ballbot_ros.files import temporary_folder, write_temporary
from ballbot_ros.parameters import (
    CONTROLLER,
    ControllerParameters,
    ParameterError,
    ParameterSet,
    PlantParameters,
)
from ballbot_ros.parameters.files import read_parameter_file
from ballbot_ros.parameters.timing import SECOND_NS
from ballbot_ros.parameters.yaml_document import YamlDocument
from ballbot_ros.recording.messages.conversions import push_forces, stamp_ns
from ballbot_ros.recording.messages.topics import ACCEPTED_PUSH, PARTICIPANTS, RUN_STATUS
from ballbot_ros.recording.reader import AttachedFile, RecordingReader
from ballbot_ros.recording.rosbag2 import MAPS, PARAMETERS, SCENARIO, VERSIONS
from ballbot_ros.recording.schemas import WrenchStamped
from ballbot_ros.robot.brick.faults import Fault, all_faults
from ballbot_ros.robot.plant.ground_truth import Pair, Push
from ballbot_ros.robot.world.floor_map import FloorMap, load_map, map_names
from ballbot_ros.robot.world.image import read_map


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


def read_attachments(files: Mapping[str, AttachedFile]) -> RecordedAttachments:
    """Read the attachments; a missing or unreadable one becomes a notice, not an error."""
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


_DIRECTIONS = (
    'forward', 'forward left', 'left', 'backward left', 'backward', 'backward right', 'right',
    'forward right',
)  # fmt: skip
"""Names of directions, counterclockwise in steps of 45°."""


class PushPairs:
    """Makes pushes of the messages of ``plant/accepted_push``: one for the start, one for the end.

    `pushes` are those whose start and end have been added.
    """

    def __init__(self) -> None:
        self.pushes: list[Push] = []
        self._begun: dict[str, WrenchStamped] = {}

    def add(self, message: WrenchStamped) -> None:
        """Add a message; those of a push have the same frame_id."""
        start = self._begun.pop(message.header.frame_id, None)
        if start is None:
            self._begun[message.header.frame_id] = message
        else:
            self.pushes.append(Push(stamp_ns(start), stamp_ns(message), *push_forces(start)))


@dataclass(frozen=True)
class RecordedPush:
    """A push that acted on the robot.

    Attributes
    ----------
    start, end : float
        From the start of the run [s].
    force, torque : tuple of float
        On plane x, y, in plane signs [N], [N·m].
    is_external : bool
        Whether it came from outside, not from the scenario.
    """

    start: float
    end: float
    force: Pair
    torque: Pair
    is_external: bool

    def as_json(self) -> dict[str, object]:
        """Return the push with units in the keys."""
        return {
            'start_s': self.start,
            'end_s': self.end,
            'force_n': list(self.force),
            'torque_n_m': list(self.torque),
            'is_external': self.is_external,
        }

    @property
    def interval(self) -> Interval:
        """When it acted."""
        name = 'outside push' if self.is_external else 'push'
        return Interval(self.start, self.end, name, IntervalKind.PUSH, self.strength)

    @property
    def strength(self) -> str:
        """Force and torque as text, such as ``1 N forward``."""
        parts = []
        if any(self.force):
            forward, rightward = self.force
            eighth = round(math.atan2(-rightward, forward) / math.radians(45.0)) % len(_DIRECTIONS)
            parts.append(f'{math.hypot(forward, rightward):.3g} N {_DIRECTIONS[eighth]}')
        if any(self.torque):
            x, y = (f'{each:.3g}'.replace('-', '−') for each in self.torque)
            parts.append(f'torque x {x}, y {y} N·m')
        return ', '.join(parts) or 'no force'


def external_push(content: Mapping[str, Any]) -> RecordedPush:
    """Return an outside push of the JSON of a run."""
    return RecordedPush(
        content['start_s'],
        content['end_s'],
        tuple(content['force_n']),
        tuple(content['torque_n_m']),
        is_external=True,
    )


def scheduled_pushes(scenario: Scenario) -> tuple[RecordedPush, ...]:
    """Return the pushes of a scenario."""
    pushes = scenario.pushes_from(0)
    return recorded_pushes(pushes, pushes, 0)


def recorded_pushes(
    pushes: Iterable[Push], scheduled: Sequence[Push], start_ns: int
) -> tuple[RecordedPush, ...]:
    """Return the pushes of a run that begins at `start_ns` [ns], in the order of their times.

    Those that are not among the `scheduled` ones of its scenario came from outside.
    """
    expected = Counter(scheduled)
    found = []
    for push in pushes:
        is_external = not expected[push]
        expected[push] -= not is_external
        start, end = ((each - start_ns) / SECOND_NS for each in (push.start_ns, push.end_ns))
        found.append(RecordedPush(start, end, push.force, push.torque, is_external))
    return tuple(sorted(found, key=lambda push: push.start))


def known_faults(parameters: ParameterSet) -> tuple[Fault, ...]:
    """Return the faults of a recorded run; none if its parameters are not valid here."""
    try:
        return all_faults(parameters.of)
    except ParameterError:
        return ()


def faults_in(reader: RecordingReader, parameters: ParameterSet) -> list[Fault]:
    """Return the faults of all runs of a recording, whose attached parameters are these."""
    announced, named = AnnouncedParameters(), {x.resolved(): x for x in (PARTICIPANTS, RUN_STATUS)}
    topics = {name: topic for name, topic in named.items() if name in reader.topics()}
    for raw in reader.raw_messages(topics):
        announced.add(topics[raw.topic], raw.data)
    runs = [announced.of(run, parameters, {}) for run in announced.by_run] or [parameters]
    return list(dict.fromkeys(each for run in runs for each in known_faults(run)))


def fault_intervals(parameters: ParameterSet, end: float) -> list[Interval]:
    """Return when the faults of a run act that ends at a time [s]."""
    return [
        Interval(each.time, min(each.end, end), f'{each.component} {each.type}', IntervalKind.FAULT)
        for each in known_faults(parameters)
        if each.time < end
    ]


def outside_pushes_in(reader: RecordingReader, runs_ns: Sequence[int]) -> list[RecordedPush]:
    """Return the pushes from outside in a recording whose runs begin at these stamps [ns]."""
    name, topics = ACCEPTED_PUSH.resolved(), reader.topics()
    if name not in topics or topics[name].type_name != ACCEPTED_PUSH.type_name:
        return []
    pairs = PushPairs()
    for _, _, message in reader.messages([name]):
        pairs.add(message)
    scenario = read_attachments(reader.attachments()).scenario or Scenario()
    found: list[RecordedPush] = []
    for start_ns, next_ns in pairwise([*sorted(runs_ns), END_OF_TIME_NS]):
        acted = [push for push in pairs.pushes if start_ns <= push.start_ns < next_ns]
        found += recorded_pushes(acted, scenario.pushes_from(start_ns), start_ns)
    return [push for push in found if push.is_external]


_MAX_LISTED = 3


def outside_pushes(pushes: Iterable[RecordedPush]) -> str:
    """Return a sentence about the pushes from outside; '' if there are none."""
    told = [
        f'{push.strength}, {push.start:.3f} s to {push.end:.3f} s'
        for push in pushes
        if push.is_external
    ]
    if len(told) > 1:
        listed = '; '.join(told[:_MAX_LISTED]) + '; …' * (len(told) > _MAX_LISTED)
        return f'{len(told)} outside pushes were part of the run: {listed}.'
    return f'An outside push was part of the run: {told[0]}.' if told else ''
