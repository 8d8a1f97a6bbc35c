"""`ballbot replay`: runs a recorded run again and reports differences."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ballbot_ros.analysis.message_comparison import Divergence, MessageDifference
from ballbot_ros.analysis.recorded_controller import NOT_PORTABLE, ReplayedController
from ballbot_ros.analysis.recording_replay import RecordingReplay, ReplayResult
from ballbot_ros.analysis.replay import ReplayedTick
from ballbot_ros.cli.options import RECORDING, set_option_like, trust_option
from ballbot_ros.cli.progress import Progress
from ballbot_ros.files import temporary_folder
from ballbot_ros.recording.messages.recording_files import open_recording
from ballbot_ros.robot.brick.brick import DeviceInputs


def print_results(
    results: Sequence[ReplayResult], controllers: Sequence[ReplayedController]
) -> None:
    """Print for each part that it is identical, or its first difference."""
    console = Console(highlight=False, markup=False)
    runs = len(controllers)
    _print_controllers(console, controllers)
    for each in results:
        name = each.subject if runs == 1 else f'{each.subject}, {runs} runs'
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
        if each.context:
            console.print(_table(each.context, each.difference.stamp_ns))


def _print_controllers(console: Console, controllers: Sequence[ReplayedController]) -> None:
    for each in dict.fromkeys(controllers):
        origin = 'as recorded' if each.replayed == each.recorded else f'recorded {each.recorded}'
        portable = '' if each.is_portable else f', {NOT_PORTABLE}'
        successor = f'; {each.successor}' if each.successor else ''
        console.print(
            f'implementation: {each.replayed}, {origin}{successor}{portable}', soft_wrap=True
        )


def _table(ticks: Sequence[ReplayedTick], stamp_ns: int) -> Table:
    table = Table(title='recorded inputs and resulting duties', title_justify='left')
    for heading in ('sim time', *DeviceInputs._fields, 'duty'):
        table.add_column(heading, justify='right')
    for tick in ticks:
        table.add_row(
            f'{tick.stamp_ns * 1e-9:.3f} s',
            *(
                '' if value is None else str(value).strip('()')
                for value in (*tick.inputs, tick.outputs.duty)
            ),
            style='bold' if tick.stamp_ns == stamp_ns else '',
        )
    return table


def _print_json(results: Sequence[ReplayResult], controllers: Sequence[ReplayedController]) -> None:
    common = {
        'runs': len(controllers),
        'implementations': [_plain_controller(each) for each in controllers],
    }
    print(json.dumps([{**_plain(each), **common} for each in results], indent=2))


def _plain_controller(controller: ReplayedController) -> dict[str, object]:
    return {
        'recorded': controller.recorded,
        'replayed': controller.replayed,
        'reason': controller.reason or None,
        'portable': controller.is_portable,
        'successor': controller.successor and controller.successor._asdict(),
    }


def _plain(result: ReplayResult) -> dict[str, object]:
    return {
        'what': result.subject,
        'engine': result.engine.value,
        'identical': result.difference is None,
        'ticks': result.ticks,
        'messages': result.messages,
        'first_difference': _plain_difference(result.difference),
    }


def _plain_difference(difference: MessageDifference | None) -> dict[str, object] | None:
    return difference and {
        'sim_time_s': difference.stamp_ns * 1e-9,
        'topic': difference.topic,
        'what': difference.what,
    }


def _print_divergences(
    divergences: Sequence[Divergence], controllers: Sequence[ReplayedController]
) -> None:
    console = Console(highlight=False, markup=False)
    _print_controllers(console, controllers)
    for number, each in enumerate(divergences, 1):
        if jobs := each.jobs:
            where = f'sim time {jobs.stamp_ns * 1e-9:.3f} s, /{jobs.topic}: {jobs.what}'
            console.print(f'run {number}: jobs differ, first at {where}', soft_wrap=True)
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
            'first_different_jobs': _plain_difference(each.jobs),
            'implementation': _plain_controller(controller),
        }
        for number, (each, controller) in enumerate(zip(divergences, controllers, strict=True), 1)
    ]
    print(json.dumps(content, indent=2))


@click.command('replay')
@click.argument('recording', type=RECORDING)
@click.option(
    '--controller',
    metavar='CONTROLLER',
    help="The document's controller in Python (python), as generated C (c) or on an emulated ARM "
    '(arm); or the code of any other recorded one, as FILE.py:Class.  [default: the recorded one, '
    'or Python if that cannot run]',
)
@trust_option
@set_option_like('Change a parameter of the controller')
@click.option('--json', 'as_json', is_flag=True, help='Print JSON.')
def command(
    recording: Path,
    controller: str | None,
    trust_attached_code: bool,
    assignments: tuple[str, ...],
    as_json: bool,
) -> int:
    """Run the runs of RECORDING again, from the data in the file alone.

    First the controller with the recorded samples of the devices, then the whole robot with its
    parameters, seed, sticks and pushes. Every message is compared.

    Exit status: 0 if all are identical, 1 if one differs, 2 if there is nothing to replay. With
    --set only the controller's duties and jobs are compared, and the status is 0.
    """
    with open_recording(recording) as reader, temporary_folder() as scratch:
        replay = RecordingReplay(
            reader, Path(scratch), controller, trust_attached_code=trust_attached_code
        )
        for reason in replay.reasons:
            print(f'note: {recording}: {reason}', file=sys.stderr)
        if assignments:
            with Progress('controller', replay.duration) as progress:
                divergences = replay.replay_with(assignments, progress.update)
            print_divergences = _print_divergences_json if as_json else _print_divergences
            print_divergences(divergences, replay.controllers)
            return 0
        with Progress('robot', replay.duration) as progress:
            of_robot = replay.replay_robot(progress.update)
        of_controller = replay.controller_in_robot
        if of_controller is None:
            with Progress('controller', replay.duration) as progress:
                of_controller = replay.replay_controller(progress.update)
        results = (of_controller, of_robot)
        (_print_json if as_json else print_results)(results, replay.controllers)
        if reader.damage:
            note = f'note: {recording}: {reader.damage}: only the intact part was compared'
            print(note, file=sys.stderr)
        return 0 if all(result.difference is None for result in results) else 1
