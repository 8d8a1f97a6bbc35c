"""A branch of a recorded run: the same up to a moment, and something else from then on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple

from ballbot_ros.analysis.message_comparison import MessageComparator, MessageDifference
from ballbot_ros.analysis.parent import Parent
from ballbot_ros.analysis.recorded_runs import RobotRecording, robot_topics
from ballbot_ros.analysis.recorded_scenario import read_attachments
from ballbot_ros.analysis.recording_replay import RecordingReplay
from ballbot_ros.analysis.replay import STAMPED_TOPICS, RunInputs
from ballbot_ros.controllers.codegen.implementation import compose_controller, public_changes
from ballbot_ros.engine.scenario.reader import load_scenario, window_fault
from ballbot_ros.engine.scenario.scenario import Scenario, ScheduledPush, Segment, StickSignal
from ballbot_ros.engine.scenario.writer import scenario_data
from ballbot_ros.errors import BallbotError
from ballbot_ros.parameters import (
    CONTROLLER,
    GAMEPAD,
    PLANT,
    ControllerParameters,
    ParameterSet,
    PlantParameters,
    Value,
)
from ballbot_ros.parameters.changes import (
    IMPLEMENTATION,
    TimedChange,
    changes_text,
    parse_changes,
    parse_succession,
)
from ballbot_ros.parameters.files import plain_value
from ballbot_ros.parameters.timing import FIRST_TICK_NS, SECOND_NS, SLOW_PERIOD_NS, TICK_NS
from ballbot_ros.parameters.yaml_document import yaml_text
from ballbot_ros.recording.messages.topics import ACCEPTED_PUSH, GAMEPAD_JOY, PARAMETER_EVENTS
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.robot.brick.bluetooth import NEUTRAL
from ballbot_ros.robot.brick.faults import Fault, all_faults, fault_texts
from ballbot_ros.robot.world.floor_map import is_file_name
from ballbot_ros.run.future import RECORDED, Future
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.spec import RunSpec

_HALF_PERIOD_NS = SLOW_PERIOD_NS // 2
"""Sticks step halfway between two samples."""

_CAUSES = GAMEPAD_JOY, ACCEPTED_PUSH, PARAMETER_EVENTS
_COMPARED = [topic for topic in STAMPED_TOPICS if topic not in _CAUSES]
"""What must be the same: all effects. A sample of the sticks names another source in a branch."""

_OF_A_RUN: Mapping[str, Mapping[str, Value]] = {
    PLANT: {
        'real_time_factor': 0.0,
        'start_paused': False,
        'require_recorder': False,
        'live_from': 0.0,
    },
    GAMEPAD: {'device': '', 'keyboard': False},
}
"""Parameters of a recorded run that its branch does not have."""


class Past(NamedTuple):
    """A recorded run that can be branched; `number` is its number in the file, from 1.

    The map and the controller in its parameters are files of this machine.
    """

    recording: RobotRecording
    number: int
    inputs: RunInputs
    parameters: ParameterSet
    scenario: Scenario | None

    @property
    def path(self) -> Path:
        """The file."""
        return self.recording.reader.path

    @property
    def end(self) -> float:
        """When its last tick was, from its start [s]."""
        return (self.inputs.last_ns - self.inputs.run.start_ns) / SECOND_NS


class Proof(NamedTuple):
    """The comparison of a branch with the recorded run.

    Attributes
    ----------
    messages : int
        Number of messages that were compared, in the whole run.
    difference : MessageDifference or None
        The first one; None if there is none.
    at : float or None
        When it is, from the start of the run [s].
    problem : str
        Why it is no branch, on one line; '' if they are the same up to its moment.
    """

    messages: int
    difference: MessageDifference | None = None
    at: float | None = None
    problem: str = ''


def read_past(
    reader: RecordingReader,
    number: int | None,
    scratch: Path,
    controller: str | None = None,
    *,
    trust_attached_code: bool = False,
) -> Past:
    """Read a recorded run; its map and its attached code go to the folder `scratch`.

    It raises BallbotError if the run can't be made again here; the message is one line with the
    reason.

    Parameters
    ----------
    number : int or None
        Number of the run in the file, from 1; None for the only one.
    controller : str or None
        The user's copy of the controller's code, as for a replay.
    """
    replay = RecordingReplay(reader, scratch, controller, trust_attached_code=trust_attached_code)
    runs = replay.runs
    if number is None and len(runs) > 1:
        raise BallbotError(f'{reader.path}: holds {len(runs)} runs; choose one by --run')
    if number is not None and not 1 <= number <= len(runs):
        raise BallbotError(f'{reader.path}: run {number} not found; it has 1 … {len(runs)}')
    run = runs[(number or 1) - 1]
    where = f'{reader.path}: cannot be branched: '
    for participant in replay.announced.foreign(run.inputs.run.name).values():
        raise BallbotError(
            f'{where}nobody knows what its {participant.role}, {participant.implementation}, would '
            'have done'
        )
    if not run.parameters.of(PlantParameters).lockstep:
        raise BallbotError(f'{where}it ran without lockstep, so it never happens again')
    if run.inputs.run.start_ns != FIRST_TICK_NS:
        raise BallbotError(
            f'{where}run {number or 1} began at {run.inputs.run.start_ns / SECOND_NS:g} s of sim '
            'time, after a reset; only a first run can be'
        )
    attached = read_attachments(reader.attachments())
    is_anothers = replay.announced.is_of_another_scenario(run.inputs.run.name)
    scenario = None if is_anothers else attached.scenario
    return Past(replay.recording, number or 1, run.inputs, run.parameters, scenario)


def branch_spec(
    past: Past,
    future: Future,
    scratch: Path,
    *,
    processes: Processes = Processes.NONE,
    output: Path | None = None,
) -> RunSpec:
    """Return the run of a branch, ready to execute; its scenario goes to the folder `scratch`.

    It raises BallbotError if the recorded run does not reach the moment, or can't have these
    changes.
    """
    push_name, fault_name, value_name, _ = future.names
    if not 0.0 <= future.at <= past.end:
        raise BallbotError(f'at {future.at:g} s: not within the recorded run, 0 … {past.end:.3f} s')
    parameters = ParameterSet(past.parameters)
    for node, values in _OF_A_RUN.items():
        for name, value in values.items():
            parameters.set(node, name, value)
    if not past.parameters.of(PlantParameters).duration:
        ticks = (past.inputs.last_ns - past.inputs.run.start_ns) // TICK_NS + 1
        parameters.set(PLANT, 'duration', ticks * TICK_NS / SECOND_NS)
    duration = parameters.of(PlantParameters).duration
    if future.controller and future.values:
        raise BallbotError(f'{value_name}: another controller takes over at that time')
    for name, events in ((push_name, future.pushes), (fault_name, future.faults)):
        for each in events:
            if not future.at <= each.time < duration:
                raise BallbotError(
                    f'{name}: begins at {each.time:g} s, not within {future.at:g} … {duration:g} s'
                )
    changes = changes_text(each for each in _changes(past, future) if each.time < duration)
    parameters.set(CONTROLLER, 'changes', changes)
    faults = (*_faults(past), *future.faults)
    for node, text in fault_texts(faults).items():
        parameters.set(node, 'faults', text)
    path = scratch / f'{past.path.stem}_branch.yaml'
    path.write_text(_scenario_text(past, future, faults, parameters), encoding='utf-8')
    scenario = load_scenario(str(path))
    parameters.set(GAMEPAD, 'scenario', str(path))
    if future.is_live:
        for name, value in (('live_from', future.at), ('real_time_factor', 1.0), ('duration', 0.0)):
            parameters.set(PLANT, name, value)
    controller = compose_controller(parameters)
    # Without an output folder, the run makes one there.
    folder = output or Path('runs', 'new')
    parent = Parent.of(past.path, past.number, future.at, future.told, folder)
    return RunSpec(scenario, parameters, processes, output, controller=controller, parent=parent)


def _changes(past: Past, future: Future) -> list[TimedChange]:
    """Return the changes of parameters: those that happened, and those of the future."""
    start_ns = past.inputs.run.start_ns
    scheduled_text = past.parameters.of(ControllerParameters).changes
    scheduled = parse_changes(scheduled_text)
    happened = [
        TimedChange((stamp_ns - start_ns) / SECOND_NS, values)
        for stamp_ns, values in sorted(past.inputs.retunings.items())
        if stamp_ns >= start_ns
    ]
    later = [each for each in scheduled if each.time > past.end]
    found = []
    for time, values in (*happened, *later):
        if time >= future.at:
            # Another controller does not have the parameters that changed.
            values = {
                name: each
                for name, each in values.items()
                if name not in future.values and not future.controller
            }
        found.append(TimedChange(time, values))
    found.append(TimedChange(future.at, future.values))
    if future.controller:
        found.append(TimedChange(future.at, {IMPLEMENTATION: future.controller}))
    elif after := parse_succession(scheduled_text):
        found.append(after)
    return found


def _faults(past: Past) -> list[Fault]:
    """Return the recorded faults, without those that recorded sticks have passed."""
    planned = past.scenario or Scenario()
    are_planned = all(
        _is_planned(past, signal, number)
        for number, signal in enumerate((planned.vertical, planned.horizontal))
    )
    faults = all_faults(past.parameters.of)
    return [each for each in faults if are_planned or each.component != 'gamepad']


def _scenario_text(
    past: Past, future: Future, faults: tuple[Fault, ...], parameters: ParameterSet
) -> str:
    """Return the text of the branch's scenario."""
    plant, changes = parameters.of(PlantParameters), parameters.of(ControllerParameters).changes
    duration, before = plant.duration, past.scenario
    if before is None:
        plain = {'purpose': f'a branch of {past.path.name}', 'duration': duration}
        before = Scenario(text=yaml_text(plain))
    scheduled = dict(zip(before.pushes_from(FIRST_TICK_NS), before.pushes, strict=True))
    pushes = [
        scheduled.get(push)
        or ScheduledPush(
            (push.start_ns - FIRST_TICK_NS) / SECOND_NS,
            (push.end_ns - push.start_ns) / SECOND_NS,
            force=push.force,
            torque=push.torque,
        )
        for push in past.inputs.pushes
    ]
    scenario = replace(
        before,
        vertical=_sticks(past, future, before.vertical, 0, duration),
        horizontal=_sticks(past, future, before.horizontal, 1, duration),
        pushes=(*pushes, *future.pushes),
        faults=faults,
    )
    # A shorter run, or one with fewer events, can't meet everything.
    has_map = bool(plant.map)
    scenario = replace(
        scenario,
        expectations=tuple(e for e in before.expectations if not window_fault(e, plant)),
        properties=tuple(
            p for p in before.properties if not p.fault(scenario.events, has_map=has_map)
        ),
    )
    data = scenario_data(scenario)
    data.pop('changes', None)
    if changes:
        data['changes'] = [
            {
                'time': time,
                **{f'{CONTROLLER}.{name}': plain_value(each) for name, each in values.items()},
            }
            for time, values in parse_changes(changes)
        ]
    if after := parse_succession(public_changes(changes)):
        data.setdefault('changes', []).append(
            {'time': after.time, f'{CONTROLLER}.{IMPLEMENTATION}': after.values[IMPLEMENTATION]}
        )
    data['duration'] = duration
    if 'map' in data and is_file_name(plant.map):
        data['map'] = Path(plant.map).name
    return yaml_text(data)


def _samples(past: Past, number: int) -> Iterator[tuple[int, int]]:
    """Yield the recorded samples of a stick: time from the start of the run [ns] and value."""
    start_ns = past.inputs.run.start_ns
    for stamp_ns in range(start_ns, past.inputs.last_ns + 1, SLOW_PERIOD_NS):
        value = past.inputs.sticks.get(stamp_ns, NEUTRAL)[number]
        yield stamp_ns - start_ns, value


def _is_planned(past: Past, planned: StickSignal, number: int) -> bool:
    """Return whether a stick was that of the scenario."""
    samples = _samples(past, number)
    return all(planned.at(time_ns / SECOND_NS) == value for time_ns, value in samples)


def _sticks(
    past: Past, future: Future, planned: StickSignal, number: int, duration: float
) -> StickSignal:
    """Return a stick: as it was recorded up to the moment, then that of the future."""
    is_planned = _is_planned(past, planned, number)
    if is_planned and future.sticks == RECORDED:
        return StickSignal(tuple(each for each in planned.segments if each.start < duration))
    # Whole segments before the moment keep their names.
    segments = [each for each in planned.segments if is_planned and each.end <= future.at]
    begun = segments[-1].end if segments else 0.0
    end = math.inf if future.sticks == RECORDED else future.at
    samples = _samples(past, number)
    segments += held_sticks([each for each in samples if begun <= each[0] / SECOND_NS < end], begun)
    if future.sticks != RECORDED and (value := future.sticks[number]):
        begun = segments[-1].end if segments else 0.0
        first_ns = -(-round(future.at * SECOND_NS) // SLOW_PERIOD_NS) * SLOW_PERIOD_NS
        start = max((first_ns - _HALF_PERIOD_NS) / SECOND_NS, begun)
        segments.append(Segment.step('branch', start, math.inf, value))
    return StickSignal(tuple(each for each in segments if each.start < duration))


def held_sticks(samples: Sequence[tuple[int, int]], begun: float) -> Iterator[Segment]:
    """Yield segments from a time on [s] for samples that are held; none where they are 0."""
    points: list[tuple[float, float]] = []
    for value, group in groupby((*samples, (0, 0)), itemgetter(1)):
        times_ns = [time_ns for time_ns, _ in group]
        if value:
            start, end = times_ns[0] - _HALF_PERIOD_NS, times_ns[-1] + _HALF_PERIOD_NS
            points += [(max(start / SECOND_NS, begun), value), (end / SECOND_NS, value)]
        elif points:
            yield Segment(RECORDED, points)
            points = []


def prove(past: Past, recording: Path, at: float) -> Proof:
    """Compare the recording of a branch that begins at a time [s], message by message."""
    start_ns, epoch = past.inputs.run.start_ns, past.inputs.run.epoch
    comparator = MessageComparator(_COMPARED)
    with RecordingReader(recording) as reader:
        branch = RobotRecording(reader, robot_topics(reader), epochs=1)
        for each in past.recording.blocks(_COMPARED, start_ns, past.inputs.last_ns):
            if each.epoch == epoch:
                comparator.add_recorded(each.topic, each.stamps_ns, each.data)
        for each in branch.blocks(_COMPARED, start_ns, past.inputs.last_ns):
            comparator.add_replayed(each.topic, each.stamps_ns, each.data)
        is_whole = past.recording.reader.complete and reader.complete
        difference = comparator.first_difference(complete=is_whole)
    if difference is None:
        return Proof(comparator.compared())
    first_s, problem = (difference.stamp_ns - start_ns) / SECOND_NS, ''
    if difference.stamp_ns - start_ns < round(at * SECOND_NS):
        problem = (
            f'{recording}: no branch of {past.path}: they differ at {first_s:.3f} s, '
            f'/{difference.topic}: {difference.what}'
        )
    return Proof(comparator.compared(), difference, first_s, problem)
