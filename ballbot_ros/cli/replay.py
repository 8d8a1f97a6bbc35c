"""`ballbot replay`: makes a recorded run again and says where it differs."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ballbot_ros.analysis.divergence import Divergence
from ballbot_ros.analysis.message_comparison import Comparison, Difference
from ballbot_ros.analysis.recorded_inputs import RunInputs, read_inputs
from ballbot_ros.analysis.recorded_runs import RecordedRun, RobotRecording
from ballbot_ros.analysis.replay import (
    ALL_TOPICS,
    CONTROLLER_TOPICS,
    ReplayedTick,
    compare_events,
    replay_controller,
    replay_run,
)
from ballbot_ros.analysis.replayed_controller import ReplayedController, choose_controller
from ballbot_ros.analysis.told_parameters import ToldParameters
from ballbot_ros.cli.path_types import RECORDING
from ballbot_ros.cli.progress import Progress
from ballbot_ros.codegen.implementation import missing_for, program_maker, require_implementation
from ballbot_ros.controller.interface import Program
from ballbot_ros.errors import BallbotError
from ballbot_ros.files import temporary_folder, write_temporary
from ballbot_ros.messages.topics import PARTICIPANTS, Topic
from ballbot_ros.parameters import (
    CONTROLLER,
    PLANT,
    ControllerParameters,
    ParameterError,
    ParameterSet,
    PlantParameters,
)
from ballbot_ros.parameters.assignment import assign
from ballbot_ros.parameters.files import read_parameter_file
from ballbot_ros.recording.attachments import PARAMETERS
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.simulation.timing import SECOND_NS, TICK_NS
from ballbot_ros.world.library import is_file_name

AROUND_TICKS = 2


@dataclass
class Outcome:
    """What came of replaying a recording.

    Attributes
    ----------
    what : str
        ``controller`` or ``robot``: what was run again.
    ticks, messages : int
        What was compared.
    difference : Difference or None
        The first one.
    around : list of ReplayedTick
        The ticks about the difference, of the controller that was run again.
    """

    what: str
    ticks: int
    messages: int
    difference: Difference | None
    around: list[ReplayedTick] = field(default_factory=list)


def replay_recording(
    path: Path, *, controller: str | None, assignments: Sequence[str], as_json: bool
) -> int:
    """Replay every run of a recording, print what came of it, return the exit status.

    The control program is the one named by `controller`; without it, what made the recording.
    With `assignments` another controller is asked what it would have done with the same inputs.
    """
    with RecordingReader(path) as reader, temporary_folder() as scratch:
        attached = _attached_parameters(reader, Path(scratch))
        if attached is None and not _tells_participants(reader):
            raise RecordingError(_nothing_to_replay_by(path))
        recorded = read_inputs(reader)
        recording, told = recorded.recording, recorded.told
        begun = [
            _Job(inputs, _parameters(reader, inputs.run, told, attached, Path(scratch)))
            for inputs in recorded.runs
            if inputs.ticks or recorded.has_begun(inputs.run)
        ]
        jobs = [job for job in begun if job.inputs.ticks]
        if not jobs:
            raise RecordingError(f'{path}: no tick in it has a duty: nothing to replay')
        if controller:
            require_implementation(controller)
        controllers = [_choose(job, told, controller) for job in jobs]
        for reason in dict.fromkeys(each.reason for each in controllers if each.reason):
            print(f'note: {path}: {reason}', file=sys.stderr)
        if assignments:
            for assignment in assignments:
                if not assignment.startswith(f'{CONTROLLER}.'):
                    raise ParameterError(
                        f'--set {assignment}: of a recorded run only the {CONTROLLER} can be asked'
                    )
                for job in jobs:
                    assign(job.parameters, assignment)
            controllers = [
                replace(each, replayed=_implementation(job.parameters))
                for each, job in zip(controllers, jobs, strict=True)
            ]
            divergences = [_ask(recording, job) for job in jobs]
            (_print_divergences_json if as_json else _print_divergences)(divergences, controllers)
            return 0
        outcomes = [
            _replay(recording, jobs, 'controller', CONTROLLER_TOPICS),
            _replay(recording, begun, 'robot', ALL_TOPICS),
        ]
        (_print_json if as_json else print_outcomes)(outcomes, controllers)
        if reader.damage:
            print(
                f'note: {path}: {reader.damage}: only what is whole was compared', file=sys.stderr
            )
        return 0 if all(outcome.difference is None for outcome in outcomes) else 1


class _Job(NamedTuple):
    """A run, and the parameters it had."""

    inputs: RunInputs
    parameters: ParameterSet


def _choose(job: _Job, told: ToldParameters, asked: str | None) -> ReplayedController:
    """Choose what a run is replayed with, and enter it among the run's parameters."""
    attached = _implementation(job.parameters)
    chosen = choose_controller(told.controller(job.inputs.run.name), attached, asked, missing_for)
    job.parameters.set(CONTROLLER, 'implementation', chosen.replayed)
    return chosen


def _implementation(parameters: ParameterSet) -> str:
    return str(parameters.of(ControllerParameters).implementation)


def _nothing_to_replay_by(path: Path) -> str:
    return (
        f'{path}: {PARAMETERS} is not attached, and no participant has told its parameters: '
        'nothing to replay it by'
    )


def _tells_participants(reader: RecordingReader) -> bool:
    return any(name.endswith(f'/{PARTICIPANTS.name}') for name in reader.topics())


def _attached_parameters(reader: RecordingReader, scratch: Path) -> ParameterSet | None:
    """Return the parameters that are attached, if any are."""
    attached = reader.attachments()
    if PARAMETERS not in attached:
        return None
    file = scratch / PARAMETERS
    write_temporary(file, attached[PARAMETERS].data)
    try:
        return read_parameter_file(file)
    except BallbotError as error:
        text = str(error).replace(str(file), f'{reader.path}: {PARAMETERS}')
        raise RecordingError(text) from None


def _parameters(
    reader: RecordingReader,
    run: RecordedRun,
    told: ToldParameters,
    attached: ParameterSet | None,
    scratch: Path,
) -> ParameterSet:
    """Return the parameters of a run, with its map beside them."""
    if attached is None and not told.tells(run.name):
        raise RecordingError(_nothing_to_replay_by(reader.path))
    files = reader.attachments()
    parameters = told.of(run.name, attached or ParameterSet(), files)
    name = parameters.of(PlantParameters).map
    if is_file_name(name):
        if name not in files:
            raise RecordingError(f'{reader.path}: the map {name!r} is not attached')
        image = scratch / f'map{Path(name).suffix}'
        write_temporary(image, files[name].data)
        parameters.set(PLANT, 'map', str(image))
    return parameters


def _replay(
    recording: RobotRecording,
    jobs: Sequence[_Job],
    what: str,
    topics: Sequence[Topic],
) -> Outcome:
    """Run the controller or the robot again, run by run, and compare the given topics."""
    recorded = recording.topics.by_name.values()
    comparison = Comparison([topic for topic in topics if topic in recorded])
    ticks = 0
    with Progress(what, sum(job.inputs.ticks for job in jobs) * TICK_NS / SECOND_NS) as progress:
        for inputs, parameters in jobs:
            replayed: Iterator[Any]
            if what == 'controller':
                replayed = replay_controller(recording, inputs, _program(parameters), comparison)
            else:
                replayed = replay_run(recording, inputs, parameters, comparison)
            for _ in replayed:
                ticks += 1
                progress.update(ticks * TICK_NS / SECOND_NS)
    compare_events(recording, [job.inputs for job in jobs], comparison)
    difference = comparison.first_difference(complete=recording.reader.complete)
    outcome = Outcome(what, ticks, comparison.compared, difference)
    if difference and what == 'robot':
        # Of a run that has ended before, the last one that had begun.
        job = next(job for job in reversed(jobs) if _has_begun_before(job, difference))
        outcome.around = _around(recording, job, difference.stamp_ns)
    return outcome


def _has_begun_before(job: _Job, difference: Difference) -> bool:
    run = job.inputs.run
    return (run.epoch, run.start_ns) <= (difference.epoch, difference.stamp_ns)


def _program(parameters: ParameterSet) -> Program:
    return program_maker(parameters.of(ControllerParameters))()


def _around(recording: RobotRecording, job: _Job, stamp_ns: int) -> list[ReplayedTick]:
    """Return the recorded inputs about a tick, and what the controller makes of them."""
    reach = AROUND_TICKS * TICK_NS
    nothing = Comparison(())
    found = []
    for tick in replay_controller(recording, job.inputs, _program(job.parameters), nothing):
        if tick.stamp_ns > stamp_ns + reach:
            break
        if tick.stamp_ns >= stamp_ns - reach:
            found.append(tick)
    return found


def _ask(recording: RobotRecording, job: _Job) -> Divergence:
    """Compare another controller's duties with the recorded ones."""
    inputs, parameters = job
    duties = inputs.duties
    divergence = Divergence()
    with Progress('controller', inputs.ticks * TICK_NS / SECOND_NS) as progress:
        nothing = Comparison(())
        for tick in replay_controller(recording, inputs, _program(parameters), nothing):
            if tick.stamp_ns in duties:
                divergence.add(tick.stamp_ns, duties[tick.stamp_ns], tick.outputs.duty)
            progress.update((tick.stamp_ns - inputs.run.start_ns) / SECOND_NS)
    return divergence


def print_outcomes(outcomes: Sequence[Outcome], controllers: Sequence[ReplayedController]) -> None:
    """Print what was identical, and the first difference of what was not."""
    console = Console(highlight=False, markup=False)
    runs = len(controllers)
    _print_controllers(console, controllers)
    for each in outcomes:
        name = each.what if runs == 1 else f'{each.what}, {runs} runs'
        if each.difference is None:
            counts = f', {each.ticks} ticks, {each.messages} messages'
            console.print(Text.assemble(f'{name}: ', ('identical', 'green'), counts))
            continue
        stamp = each.difference.stamp_ns * 1e-9
        where = (
            f' first at sim time {stamp:.3f} s, '
            f'/{each.difference.topic.lstrip("/")}: {each.difference.what}'
        )
        console.print(Text.assemble(f'{name}: ', ('differs', 'red'), where), soft_wrap=True)
        if each.around:
            console.print(_table(each.around, each.difference.stamp_ns))


def _print_controllers(console: Console, controllers: Sequence[ReplayedController]) -> None:
    for each in dict.fromkeys(controllers):
        origin = 'as recorded' if each.replayed == each.recorded else f'recorded {each.recorded}'
        console.print(f'implementation: {each.replayed}, {origin}', soft_wrap=True)


def _table(ticks: Sequence[ReplayedTick], stamp_ns: int) -> Table:
    table = Table(title='recorded inputs, and the duties that follow', title_justify='left')
    for heading in ('sim time', 'gyro', 'motors', 'sonar', 'battery', 'sticks', 'duty'):
        table.add_column(heading, justify='right')
    for tick in ticks:
        inputs = tick.inputs
        values = (
            inputs.gyro, inputs.revolutions, inputs.sonar_cm, inputs.battery_mv, inputs.sticks,
            tick.outputs.duty,
        )  # fmt: skip
        table.add_row(
            f'{tick.stamp_ns * 1e-9:.3f} s',
            *('' if value is None else str(value).strip('()') for value in values),
            style='bold' if tick.stamp_ns == stamp_ns else '',
        )
    return table


def _print_json(outcomes: Sequence[Outcome], controllers: Sequence[ReplayedController]) -> None:
    common = {
        'runs': len(controllers),
        'implementations': [_plain_controller(each) for each in controllers],
    }
    print(json.dumps([{**_plain(each), **common} for each in outcomes], indent=2))


def _plain_controller(controller: ReplayedController) -> dict[str, str | None]:
    return {
        'recorded': controller.recorded,
        'replayed': controller.replayed,
        'reason': controller.reason or None,
    }


def _plain(outcome: Outcome) -> dict[str, object]:
    difference = outcome.difference
    return {
        'what': outcome.what,
        'identical': difference is None,
        'ticks': outcome.ticks,
        'messages': outcome.messages,
        'first_difference': difference
        and {
            'sim_time_s': difference.stamp_ns * 1e-9,
            'topic': difference.topic,
            'what': difference.what,
        },
    }


def _print_divergences(
    divergences: Sequence[Divergence], controllers: Sequence[ReplayedController]
) -> None:
    console = Console(highlight=False, markup=False)
    _print_controllers(console, controllers)
    for number, each in enumerate(divergences, 1):
        if each.first_ns is None:
            console.print(f'run {number}: the same duties, {each.ticks} ticks')
            continue
        console.print(
            f'run {number}: {each.differing} of {each.ticks} duties differ, first at sim time '
            f'{each.first_ns * 1e-9:.3f} s; plane x rms {each.rms[0]:.2f} %, at most '
            f'{each.largest[0]} %; plane y rms {each.rms[1]:.2f} %, at most {each.largest[1]} %',
            soft_wrap=True,
        )


def _print_divergences_json(
    divergences: Sequence[Divergence], controllers: Sequence[ReplayedController]
) -> None:
    content = [
        {
            'run': number,
            'ticks': each.ticks,
            'differing': each.differing,
            'first_sim_time_s': None if each.first_ns is None else each.first_ns * 1e-9,
            'rms_percent': each.rms,
            'largest_percent': each.largest,
            'implementation': _plain_controller(controller),
        }
        for number, (each, controller) in enumerate(zip(divergences, controllers, strict=True), 1)
    ]
    print(json.dumps(content, indent=2))


@click.command('replay')
@click.argument('recording', type=RECORDING)
@click.option(
    '--controller',
    type=click.Choice(['python', 'c', 'arm']),
    help='The control program in Python, or its generated C on this machine or an emulated ARM.  '
    '[default: what made the recording, or Python where that can not run]',
)
@click.option(
    '--set',
    'assignments',
    multiple=True,
    metavar='NODE.PARAM=VALUE',
    help='Ask what the controller would have done with another parameter; may be given again.',
)
@click.option('--json', 'as_json', is_flag=True, help='Print JSON.')
def command(
    recording: Path, controller: str | None, assignments: tuple[str, ...], as_json: bool
) -> int:
    """Make the runs of RECORDING again, from what the file itself holds.

    The controller first, on the recorded samples of the devices; then the whole robot, on its
    parameters and seed, the recorded sticks and pushes. Every message is compared.

    Exit status: 0 if all are identical, 1 if one differs, 2 if there is nothing to replay. With
    --set only the controller's duties are compared, and the status is 0.
    """
    return replay_recording(
        recording, controller=controller, assignments=assignments, as_json=as_json
    )
