"""`ballbot branch`: a recorded run again, with another future."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ballbot_ros.cli.options import (
    RECORDING,
    FloatRange,
    code_option,
    folder_option,
    processes_option,
    set_option_like,
    trust_option,
)
from ballbot_ros.errors import BallbotError
from ballbot_ros.files import next_steps, own_command, temporary_folder
from ballbot_ros.process import DeferredSignals, stdout_to_stderr
from ballbot_ros.run.node_process import ForkClient
from ballbot_ros.run.requirements import Processes, require_rclpy

if TYPE_CHECKING:
    from ballbot_ros.run.branch import Past, Proof
    from ballbot_ros.run.result import RunResult
    from ballbot_ros.run.spec import RunSpec


@click.command('branch')
@click.argument('recording', type=RECORDING)
@click.option(
    '--at',
    type=FloatRange(0.0),
    required=True,
    help='When the branch begins, in seconds from the start of the run.',
)
@click.option(
    '--push',
    'pushes',
    multiple=True,
    metavar="'force=N direction=D'",
    help='Push the robot, as in a scenario; duration=S if not 0.1 s, time=S if not at once. Can be '
    'repeated.',
)
@click.option(
    '--fault',
    'faults',
    multiple=True,
    metavar="'COMPONENT TYPE'",
    help='A fault as in a scenario, such as gyro_x stuck; with duration=S, amount=A, time=S if not '
    'at once. Can be repeated.',
)
@set_option_like('Change a gain or threshold of the controller', 'controller.PARAM=VALUE')
@click.option(
    '--controller',
    metavar='CONTROLLER',
    help='Another controller takes over, which has run along from the start: a name, '
    'package.module:Class or FILE.py:Class.',
)
@click.option(
    '--sticks',
    default='recorded',
    show_default=True,
    metavar='STICKS',
    help='The sticks from then on: recorded, neutral, or held values VERTICAL,HORIZONTAL such as '
    '-100,0 (full ahead).',
)
@click.option(
    '--drive',
    'is_live',
    is_flag=True,
    help='Drive from then on, with the keys of the terminal, a gamepad, joy or cmd_vel, until q. '
    'The robot waits at that moment for a key.',
)
@click.option(
    '--run',
    'number',
    type=click.IntRange(1),
    help='Number of the run in a recording of several.',
)
@code_option
@trust_option
@processes_option
@folder_option('recording and picture.  [default: runs/<date>_<recording>_branch]')
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def command(
    recording: Path,
    at: float,
    pushes: tuple[str, ...],
    faults: tuple[str, ...],
    assignments: tuple[str, ...],
    controller: str | None,
    sticks: str,
    is_live: bool,
    number: int | None,
    code: str | None,
    trust_attached_code: bool,
    processes: str,
    output: Path | None,
    as_json: bool,
) -> int:
    """Run a run of RECORDING again up to a moment, and then change something.

    The result is a complete recording. Each of its messages up to that moment is compared with the
    recorded one. What was recorded later (sticks, pushes, changes of parameters) happens again,
    unless it is changed.

    Exit status: as of `ballbot run`; 1 also if the beginning is not the same, 2 if the run can't be
    branched.
    """
    if is_live and (as_json or processes != Processes.SEPARATE.value):
        raise click.UsageError('--drive: takes neither --json nor --processes')
    if '' in map(str.strip, faults):
        raise click.UsageError('--fault: names nothing')
    arrangement = Processes(processes)
    with ForkClient() if arrangement is Processes.SEPARATE else nullcontext() as client:
        with DeferredSignals():
            from ballbot_ros.analysis.run_data import read_run
            from ballbot_ros.cli.progress import Progress
            from ballbot_ros.recording.messages.recording_files import open_recording
            from ballbot_ros.run.branch import branch_spec, prove, read_past
            from ballbot_ros.run.execution import execute
            from ballbot_ros.run.future import given_future

        future = given_future(
            at,
            pushes=_pushes(pushes),
            faults=';'.join(faults),
            values=_values(assignments),
            sticks=_sticks(sticks, is_live=is_live),
            controller=controller,
            names=('--push', '--fault', '--set', '--sticks'),
        )
        future = replace(future, is_live=is_live)
        with open_recording(recording) as reader, temporary_folder() as folder:
            scratch = Path(folder)
            with stdout_to_stderr():  # a controller may print while its class is loaded
                past = read_past(
                    reader, number, scratch, code, trust_attached_code=trust_attached_code
                )
                spec = branch_spec(past, future, scratch, processes=arrangement, output=output)
            if is_live:
                return _drive(past, spec, at)
            spec = replace(spec, earlier=read_run(past.path, past.number).trajectory)
            with Progress(spec.name, spec.plant.duration) as progress, stdout_to_stderr():
                result = execute(spec, progress, client=client)
                progress.release(result.reason)
            proof = prove(past, result.recording, at) if result.recording else None
    _print(recording, spec, result, proof, as_json=as_json)
    return 1 if proof and proof.problem else result.exit_status


def _pushes(texts: Sequence[str]) -> Iterator[Mapping[str, object]]:
    """Yield the values of the option --push."""
    from ballbot_ros.parameters.yaml_document import parse_value

    for text in texts:
        words = [word.partition('=') for word in text.split()]
        if not words or not all(value for _, _, value in words):
            raise BallbotError(
                f'--push {text!r}: not words NAME=VALUE, such as force=0.8 direction=left'
            )
        yield {name: parse_value(value) for name, _, value in words}


def _values(texts: Sequence[str]) -> dict[str, object]:
    """Return the values of the option --set."""
    from ballbot_ros.parameters.yaml_document import parse_value

    pairs = [text.partition('=') for text in texts]
    return {target: parse_value(value) for target, _, value in pairs}


def _sticks(text: str, *, is_live: bool) -> object:
    """Return the value of the option --sticks."""
    from ballbot_ros.parameters.yaml_document import parse_value
    from ballbot_ros.run.future import RECORDED

    if text == 'neutral' or (is_live and text == RECORDED):
        return 0, 0
    return text if text == RECORDED else tuple(map(parse_value, text.split(',')))


def _print(
    recording: Path, spec: RunSpec, result: RunResult, proof: Proof | None, *, as_json: bool
) -> None:
    from ballbot_ros.cli.result import print_table, result_json

    difference = proof.difference if proof else None
    if as_json:
        content = result_json(spec, result)
        content['parent'] = spec.parent and asdict(spec.parent)
        content['compared_messages'] = proof and proof.messages
        content['first_difference'] = None
        if proof and difference:
            place = {'topic': difference.topic, 'what': difference.what}
            content['first_difference'] = {'time_s': proof.at, **place}
        content['problem'] = proof.problem if proof else ''
        click.echo(json.dumps(content, indent=2, allow_nan=False))
        return
    print_table(spec, result)
    if proof and result.recording:
        _print_proof(spec, proof, recording, result.recording)


def _print_proof(spec: RunSpec, proof: Proof, recording: Path, branch: Path) -> None:
    if proof.problem:
        click.echo(f'error: {proof.problem}', err=True)
        return
    click.echo(f'both  {own_command("compare", recording, branch)}')
    click.echo(f'branch of {spec.parent}')
    if difference := proof.difference:
        click.echo(f'first difference at {proof.at:.3f} s, /{difference.topic}: {difference.what}')
    else:
        click.echo(f'no difference in {proof.messages} messages')


def _drive(past: Past, spec: RunSpec, at: float) -> int:
    """Drive from a time on [s]; return the exit status."""
    from ballbot_ros.cli.progress import Progress
    from ballbot_ros.nodes.teleop.terminal import keyboard_unavailable_reason
    from ballbot_ros.run.branch import prove
    from ballbot_ros.run.drive import NAME, drive

    require_rclpy()
    obstacle = keyboard_unavailable_reason()
    with Progress(NAME, 0.0, bar=bool(obstacle)) as progress:
        result = drive(spec, progress, no_keyboard=obstacle, starts_paused=not obstacle)
    if result.recording is None:
        return result.exit_status
    click.echo('\n'.join([f'recording  {result.recording}', *next_steps(result.recording)]))
    proof = prove(past, result.recording, at)
    _print_proof(spec, proof, past.path, result.recording)
    return 1 if proof.problem else result.exit_status
