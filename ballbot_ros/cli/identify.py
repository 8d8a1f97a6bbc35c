"""`ballbot identify`: physical parameters of the robot from recordings or data logs of its runs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ballbot_ros.analysis.recorded_runs import is_real_robot
from ballbot_ros.cli.options import (
    NEW_FILE,
    RECORDING,
    heading,
    params_option_like,
    set_option_like,
    split_at_commas,
    write_file,
)
from ballbot_ros.cli.progress import file_progress
from ballbot_ros.errors import BallbotError
from ballbot_ros.parameters import PLANT, ParameterSet, Value
from ballbot_ros.parameters.files import assign, read_parameter_file
from ballbot_ros.recording.messages.recording_files import open_recording

if TYPE_CHECKING:
    from ballbot_ros.analysis.identification.experiment import Experiment


@click.command('identify')
@click.argument(
    'recordings', nargs=-1, required=True, type=RECORDING, metavar='RUN.mcap|LOG.csv...'
)
@click.option(
    '--fit',
    'names',
    multiple=True,
    callback=split_at_commas,
    metavar='NAME,NAME...',
    help='Parameters of plant_sim to identify, the most wanted first; can be repeated.  [default: '
    'those that are hard to measure]',
)
@click.option(
    '--check',
    'checks',
    multiple=True,
    type=RECORDING,
    metavar='RUN.mcap|LOG.csv',
    help='Recording or data log that is not fitted, to check the result with; can be repeated.',
)
@click.option(
    '--truth',
    is_flag=True,
    help="Use the plant's true states instead of the readings of the sensors.",
)
@params_option_like(
    'Parameter file with what is known of the robot: its values of plant_sim replace the recorded '
    'ones. Identified parameters start from them.'
)
@set_option_like('Set one value as --params does, such as plant_sim.body_mass=0.75')
@click.option(
    '--run',
    'number',
    type=click.IntRange(1),
    help='Number of the run in a file with several, from 1.  [default: the last]',
)
@click.option(
    '--output',
    type=NEW_FILE,
    help='Parameter file to write or replace, with the identified parameters, for the option '
    '--params of a run.',
)
@click.option(
    '--plot',
    type=NEW_FILE,
    help='PNG to write or replace: the values with their intervals, and the correlations of their '
    'errors.',
)
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
@click.pass_context
def command(
    context: click.Context,
    recordings: tuple[Path, ...],
    names: list[str],
    checks: tuple[Path, ...],
    truth: bool,
    parameter_file: Path | None,
    assignments: tuple[str, ...],
    number: int | None,
    output: Path | None,
    plot: Path | None,
    as_json: bool,
) -> None:
    """Identify physical parameters of the robot from recordings of its runs.

    Prints which parameters the recordings can tell apart, their values with 95 % intervals, and
    how well the model then describes the readings.

    A data log, LOG.csv or the recording of a real robot, has no duties unless log_content of the
    controller adds them. Without, it tells little but the height of the body.

    Exit status: 0 if a parameter was identified; 2 if none was, for invalid arguments or a file
    that is neither a recording of a ballbot nor a data log.
    """
    # Imported only here: it takes half a second.
    from ballbot_ros.analysis.identification.identification import (
        HARD_TO_MEASURE,
        check_names,
        identify,
    )
    from ballbot_ros.cli.identify_output import IdentifyOutput

    if number and (len(recordings) > 1 or _is_log(recordings[0])):
        raise click.UsageError('--run needs exactly one recording')
    names = names or list(HARD_TO_MEASURE)
    check_names(names)
    _require_different(recordings, checks)
    known = _known(parameter_file, assignments)
    experiments = [_read(path, number, known, truth) for path in recordings]
    further = [_read(path, None, known, truth) for path in checks]
    start = {name: value for name in names if isinstance(value := known.get(name), float)}
    with file_progress('identifying') as progress:
        found = identify(experiments, names, start, further, progress)
    result = IdentifyOutput(found)
    if as_json:
        click.echo(json.dumps(result.as_json(), indent=2, allow_nan=False))
    else:
        result.print()
    if not result.identified:
        raise BallbotError(
            'nothing was identified: record a run in which the robot is driven, such as the '
            'scenario `excitation`'
        )
    written = []
    if plot:
        from ballbot_ros.analysis.identification.figure import render_identification

        write_file('--plot', plot, render_identification(found))
        written.append(f'plot  {plot}')
    if output:  # last, so that a command that failed has written no parameters
        text = heading(context) + result.parameter_file()
        write_file('--output', output, text.encode())
        written += [f'parameters  {output}', *result.corrections]
    if not as_json:
        for line in written:
            click.echo(line)


def _require_different(recordings: Sequence[Path], checks: Sequence[Path]) -> None:
    """Raise an error if a file is given twice: it would count twice, or check itself."""
    options: dict[Path, str] = {}
    for option, paths in (('', recordings), ('--check ', checks)):
        for path in paths:
            file = path.resolve()
            if options.get(file) == option:
                raise click.UsageError(f'{option}{path}: is given twice')
            if file in options:
                raise click.UsageError(
                    f'{option}{path}: is fitted, too; check with a recording that is not'
                )
            options[file] = option


def _is_log(path: Path) -> bool:
    with open_recording(path) as reader:
        return is_real_robot(reader)


def _known(parameter_file: Path | None, assignments: Sequence[str]) -> dict[str, Value]:
    """Return the values of the plant that were given, by name."""
    parameters = read_parameter_file(parameter_file) if parameter_file else ParameterSet()
    for assignment in assignments:
        given = ParameterSet()
        assign(given, assignment)
        if not _of_plant(given):
            raise click.UsageError(f'--set {assignment}: identify takes parameters of {PLANT} only')
        parameters.update(given)
    return _of_plant(parameters)


def _of_plant(parameters: ParameterSet) -> dict[str, Value]:
    return {name: value for node, name, value in parameters if node == PLANT}


def _read(path: Path, number: int | None, known: Mapping[str, Value], truth: bool) -> Experiment:
    from ballbot_ros.analysis.identification.experiment import (
        logged_experiment,
        recorded_experiment,
    )
    from ballbot_ros.analysis.run_data import read_run

    if _is_log(path):
        if truth:
            raise click.UsageError(f'{path}: a data log has no true states, which --truth uses')
        return logged_experiment(path, known)
    with file_progress(path.name) as progress:
        run = read_run(path, number, progress)
    experiment = recorded_experiment(run, known, truth=truth)
    for line in run.notices:
        click.echo(f'note: {path}: {line}', err=True)
    return experiment
