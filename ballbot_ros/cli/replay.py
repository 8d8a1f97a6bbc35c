"""`ballbot replay`: makes a recorded run again and says where it differs."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rich.console import Console
from rich.table import Table

from ballbot_ros.analysis.divergence import Divergence
from ballbot_ros.analysis.message_comparison import Comparison, Difference
from ballbot_ros.analysis.recorded_run import RecordedRun, recorded_runs, recorded_topics
from ballbot_ros.analysis.replay import (
    ALL_TOPICS,
    CONTROLLER_TOPICS,
    ReplayedTick,
    replay_controller,
    replay_run,
)
from ballbot_ros.cli.experiment import assign, require_toolchain
from ballbot_ros.cli.progress import Progress
from ballbot_ros.codegen.implementation import program_maker
from ballbot_ros.controller.interface import Program
from ballbot_ros.messages.topics import Topic
from ballbot_ros.parameter_file import read_parameter_file
from ballbot_ros.parameters import CONTROLLER, PLANT, ParameterSet
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.simulation.timing import SECOND_NS, TICK_NS
from ballbot_ros.world.library import is_file_name

AROUND_TICKS = 2
PARAMETERS = 'parameters.yaml'


@dataclass
class Outcome:
    """What came of replaying a run.

    Attributes
    ----------
    what : str
        ``controller`` or ``robot``: what was run again.
    run : int
        Number of the run in the file, from 1.
    ticks, messages : int
        What was compared.
    difference : Difference or None
        The first one.
    around : list of ReplayedTick
        The ticks about the difference, of the controller that was run again.
    """

    what: str
    run: int
    ticks: int
    messages: int
    difference: Difference | None
    around: list[ReplayedTick] = field(default_factory=list)


def replay_recording(
    path: Path, *, controller: str, assignments: Sequence[str], as_json: bool
) -> int:
    """Replay every run of a recording, print what came of it, return the exit status.

    With `assignments` another controller is asked what it would have done with the same inputs.
    """
    with RecordingReader(path) as reader, _parameters(reader) as parameters:
        runs = [run for run in recorded_runs(reader) if run.ticks]
        if not runs:
            raise RecordingError(f'{path}: no tick in it has a duty: nothing to replay')
        parameters.set(CONTROLLER, 'implementation', controller)
        require_toolchain(parameters)
        if assignments:
            for assignment in assignments:
                assign(parameters, assignment)
            divergences = [_ask(reader, run, parameters) for run in runs]
            (_print_divergences_json if as_json else _print_divergences)(divergences)
            return 0
        outcomes: list[Outcome] = []
        for number, run in enumerate(runs, 1):
            outcomes.append(_replay_controller(reader, number, run, parameters))
            outcomes.append(_replay_robot(reader, number, run, parameters))
        (_print_json if as_json else _print)(outcomes)
        return 0 if all(outcome.difference is None for outcome in outcomes) else 1


@contextmanager
def _parameters(reader: RecordingReader) -> Iterator[ParameterSet]:
    """Take the parameters that are attached, and the map beside them."""
    attached = reader.attachments()
    if PARAMETERS not in attached:
        raise RecordingError(
            f'{reader.path}: {PARAMETERS} is not attached: nothing to replay it by'
        )
    with TemporaryDirectory(prefix='ballbot_') as scratch:
        for name, file in attached.items():
            (Path(scratch) / Path(name).name).write_bytes(file.data)
        parameters = read_parameter_file(Path(scratch) / PARAMETERS)
        name = parameters.values(PLANT)['map']
        if is_file_name(name):
            parameters.set(PLANT, 'map', str(Path(scratch) / Path(name).name))
        yield parameters


def _replay_controller(
    reader: RecordingReader, number: int, run: RecordedRun, parameters: ParameterSet
) -> Outcome:
    comparison = _comparison(reader, run, CONTROLLER_TOPICS)
    ticks = 0
    with Progress('controller', run.ticks * TICK_NS / SECOND_NS) as progress:
        for tick in replay_controller(reader, run, _program(parameters), comparison):
            ticks += 1
            progress.update((tick.stamp_ns - run.start_ns) / SECOND_NS)
    difference = comparison.first_difference(complete=reader.complete)
    return Outcome('controller', number, ticks, comparison.compared, difference)


def _replay_robot(
    reader: RecordingReader, number: int, run: RecordedRun, parameters: ParameterSet
) -> Outcome:
    comparison = _comparison(reader, run, ALL_TOPICS)
    ticks = 0
    with Progress('robot', run.ticks * TICK_NS / SECOND_NS) as progress:
        for tick in replay_run(reader, run, parameters, comparison):
            ticks += 1
            progress.update((tick.truth.stamp_ns - run.start_ns) / SECOND_NS)
    difference = comparison.first_difference(complete=reader.complete)
    outcome = Outcome('robot', number, ticks, comparison.compared, difference)
    if difference:
        outcome.around = _around(reader, run, parameters, difference.stamp_ns)
    return outcome


def _comparison(reader: RecordingReader, run: RecordedRun, topics: Sequence[Topic]) -> Comparison:
    recorded = recorded_topics(reader).values()
    return Comparison([topic for topic in topics if topic in recorded], run.last_ns)


def _program(parameters: ParameterSet) -> Program:
    return program_maker(parameters.values(CONTROLLER))()


def _around(
    reader: RecordingReader, run: RecordedRun, parameters: ParameterSet, stamp_ns: int
) -> list[ReplayedTick]:
    """Return the recorded inputs about a tick, and what the controller makes of them."""
    reach = AROUND_TICKS * TICK_NS
    nothing = Comparison((), run.last_ns)
    found = []
    for tick in replay_controller(reader, run, _program(parameters), nothing):
        if tick.stamp_ns > stamp_ns + reach:
            break
        if tick.stamp_ns >= stamp_ns - reach:
            found.append(tick)
    return found


def _ask(reader: RecordingReader, run: RecordedRun, parameters: ParameterSet) -> Divergence:
    """Compare another controller's duties with the recorded ones."""
    duties = run.duties
    divergence = Divergence()
    with Progress('controller', run.ticks * TICK_NS / SECOND_NS) as progress:
        nothing = Comparison((), run.last_ns)
        for tick in replay_controller(reader, run, _program(parameters), nothing):
            if tick.stamp_ns in duties:
                divergence.add(tick.stamp_ns, duties[tick.stamp_ns], tick.outputs.duty)
            progress.update((tick.stamp_ns - run.start_ns) / SECOND_NS)
    return divergence


def _print(outcomes: Sequence[Outcome]) -> None:
    console = Console(highlight=False)
    for each in outcomes:
        name = f'run {each.run}, {each.what}'
        if each.difference is None:
            console.print(
                f'{name}: [green]identical[/], {each.ticks} ticks, {each.messages} messages'
            )
            continue
        stamp = each.difference.stamp_ns * 1e-9
        console.print(
            f'{name}: [red]differs[/] first at sim time {stamp:.3f} s, '
            f'/{each.difference.topic.lstrip("/")}: {each.difference.what}',
            soft_wrap=True,
        )
        if each.around:
            console.print(_table(each.around, each.difference.stamp_ns))


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


def _print_json(outcomes: Sequence[Outcome]) -> None:
    print(json.dumps([_plain(each) for each in outcomes], indent=2))


def _plain(outcome: Outcome) -> dict[str, Any]:
    difference = outcome.difference
    return {
        'run': outcome.run,
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


def _print_divergences(divergences: Sequence[Divergence]) -> None:
    console = Console(highlight=False)
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


def _print_divergences_json(divergences: Sequence[Divergence]) -> None:
    content = [
        {
            'run': number,
            'ticks': each.ticks,
            'differing': each.differing,
            'first_sim_time_s': None if each.first_ns is None else each.first_ns * 1e-9,
            'rms_percent': each.rms,
            'largest_percent': each.largest,
        }
        for number, each in enumerate(divergences, 1)
    ]
    print(json.dumps(content, indent=2))
