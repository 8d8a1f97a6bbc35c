"""`ballbot study`: very many runs of a scenario, and any of them once more."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ballbot_ros.cli.install import offer, require
from ballbot_ros.cli.options import (
    PATH,
    Choice,
    controller_option,
    folder_option,
    params_option_like,
    processes_option,
)
from ballbot_ros.errors import similar
from ballbot_ros.run.requirements import Processes

if TYPE_CHECKING:
    from ballbot_ros.lab.studies.execution import WorkersOfJob


@dataclass(frozen=True)
class StudyOptions:
    """The options that studies and searches share."""

    seed: int | None
    controller: str | None
    parameter_file: Path | None
    again: bool
    cluster: str | None
    as_json: bool

    def require(self, *extras: str) -> None:
        """Install what is needed, or raise what says how."""
        require('study', *extras, *(['cluster'] if self.cluster else []))

    @property
    def workers(self) -> WorkersOfJob:
        """What finds the workers: those of a scheduler, or of this machine."""
        if self.cluster is None:
            from ballbot_ros.lab.studies.execution import LocalWorkers

            return LocalWorkers
        # Imported here, because most studies have no cluster.
        from ballbot_ros.lab.studies.cluster import workers_of

        return workers_of(self.cluster)


def study_options(command: Callable[..., int]) -> Callable[..., int]:
    """Give a command the options of studies, as its argument `options`."""

    @click.option('--seed', type=click.IntRange(0), help="Seed.  [default: the file's]")
    @controller_option
    @params_option_like("Parameter file; its values precede the file's.")
    @click.option('--again', is_flag=True, help='Do all runs again, also those that are done.')
    @click.option(
        '--cluster',
        metavar='ADDRESS',
        help='Run on the workers of a Dask scheduler, such as tcp://scheduler:8786.',
    )
    @click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
    @wraps(command)
    def with_options(**given: Any) -> int:
        shared = {each.name: given.pop(each.name) for each in fields(StudyOptions)}
        return command(options=StudyOptions(**shared), **given)

    decorated: Callable[..., int] = with_options
    return decorated


method_option = click.option(
    '--method',
    type=Choice(['cma', 'random']),
    default='cma',
    show_default=True,
    help='How a search chooses values: CMA-ES, or at random to compare with.',
)
"""Selects the method of a search."""


@contextmanager
def resumable(folder: Path) -> Iterator[None]:
    """Tell how a command goes on whose studies are stopped in this context."""
    from ballbot_ros.lab.studies.execution import StudyStoppedError

    said = f'stopped; the same command goes on from there: {folder}'
    try:
        yield
    except StudyStoppedError as error:
        click.echo(said, err=True)
        raise click.exceptions.Exit(128 + error.signal) from None
    except (KeyboardInterrupt, SystemExit) as end:  # a signal between two studies
        click.echo(said, err=True)
        # Python would wait for its threads, one of which may compile.
        os._exit(getattr(end, 'code', 128 + signal.SIGINT))


class _StudyGroup(click.Group):
    """A word that is not a command is a study: `study robustness` means `study run robustness`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] not in ctx.help_option_names:
            takes_argument = len(args) > 1 and not args[1].startswith('-')  # as no study does
            if takes_argument and (found := similar(args[0], self.commands)):
                raise click.UsageError(
                    f'no command or study {args[0]!r}: did you mean study {found}?'
                )
            args = ['run', *args]
        return super().parse_args(ctx, args)


@click.group('study', cls=_StudyGroup, invoke_without_command=True)
@click.pass_context
def command(context: click.Context) -> None:
    """Run a scenario very many times, with values that vary from run to run.

    `ballbot study NAME` runs a shipped study, `ballbot study FILE.yaml` your own. Without an
    argument, the shipped studies are listed.
    """
    if context.invoked_subcommand is not None:
        return
    from ballbot_ros.lab.studies.reader import read_study, study_names

    names = study_names()
    width = max(map(len, names))
    for name in names:
        click.echo(f'{name:<{width}}  {read_study(name).purpose}')


@command.command('run')
@click.argument('study')
@click.option('--runs', type=click.IntRange(1), help="Number of runs.  [default: the file's]")
@folder_option('the results.  [default: studies/<name of the study>]')
@study_options
def run(study: str, runs: int | None, output: Path | None, options: StudyOptions) -> int:
    """Run STUDY, a name or a YAML file, on all cores; print a summary.

    A study varies parameters, or elements of them, which count from 1, such as controller.k_f.2.

    The results are Parquet files. An interrupted study goes on with the same command, and a
    finished one is not run again. Exit status: 0 if all runs are done, whether they passed or not;
    2 for a mistake in the arguments; 130 after Ctrl-C.
    """
    options.require()
    from ballbot_ros.cli.study_output import StudyProgress, print_results
    from ballbot_ros.lab.studies.execution import run_study
    from ballbot_ros.lab.studies.job import job_of
    from ballbot_ros.lab.studies.reader import read_studies
    from ballbot_ros.lab.studies.study import grid_shape
    from ballbot_ros.process import stdout_to_stderr

    with stdout_to_stderr():  # a controller may print while its class is loaded
        studies = list(
            read_studies(study, runs, options.seed, options.controller, options.parameter_file)
        )
        described = studies[0]
        if runs not in (None, described.runs):
            levels = ' × '.join(map(str, grid_shape(described.variables)))
            note = f'the nearest grid has {levels} points; {described.runs:,} runs'
            click.echo(f'note: {note}', err=True)
        place, workers = output or Path('studies') / Path(study).stem, options.workers
        for each in studies:
            job = job_of(each, place.joinpath(*each.case.values()))
            with resumable(place), StudyProgress(each.name) as progress:
                run_study(job, progress, workers, again=options.again)
    print_results(place, as_json=options.as_json)
    return 0


@command.command('rerun', short_help='Repeat one run of a study as a full run.')
@click.argument('folder', type=PATH)
@click.argument('number', type=click.IntRange(0), required=False)
@click.option('--worst', metavar='MEASURE', help='The run with the worst value of this measure.')
@click.option('--failed', is_flag=True, help='The first run that did not pass.')
@click.option(
    '--controller',
    metavar='CONTROLLER',
    help="The study's controller, if it is not an installed one: FILE.py:Class or "
    'package.module:Class.',
)
@processes_option
@folder_option('recording and picture.  [default: FOLDER/reruns/NUMBER]')
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def rerun(
    folder: Path,
    number: int | None,
    worst: str | None,
    failed: bool,
    controller: str | None,
    processes: str,
    output: Path | None,
    as_json: bool,
) -> int:
    """Repeat run NUMBER of the study in FOLDER as a full run, with its recording.

    Its duties are those of the study, bit for bit. Exit status: that of `ballbot run`, and 1 if the
    duties differ.
    """
    if sum((number is not None, worst is not None, failed)) != 1:
        raise click.UsageError('choose the run by its NUMBER, or by --worst or --failed')
    from ballbot_ros.cli.result import execute_and_print
    from ballbot_ros.lab.studies.rerun import choose_run, new_folder, rerun_spec
    from ballbot_ros.lab.studies.study_data import StudyData
    from ballbot_ros.lockstep.run_actions import Outcome

    data = StudyData.open(folder)
    row = choose_run(data, number, worst)
    place = output or new_folder(folder, row.number)
    spec = rerun_spec(data.study, row, place, Processes(processes), controller)
    result = execute_and_print(spec, as_json=as_json)
    if result.outcome is Outcome.STOPPED or result.duty_sha256 is None:
        return result.exit_status  # it did not get far enough to be compared
    if result.duty_sha256 == row.duty_sha256:
        click.echo(f'duties  as in the study: {row.duty_sha256}', err=as_json)
        return result.exit_status
    click.echo(f'error: the duties differ from those of the study: {row.duty_sha256}', err=True)
    return 1


@command.command(
    'report', short_help='Write a page about a study: maps, sensitivities, worst cases.'
)
@click.argument('folder', type=PATH)
@folder_option(
    'page, pictures and tables; it must be new or empty, or have an earlier report.  '
    '[default: FOLDER/report]'
)
def report(folder: Path, output: Path | None) -> int:
    """Write a report of the study in FOLDER: a self-contained index.html, its PNGs and CSVs.

    Exit status: 0 if the report was written; 2 for invalid arguments or a folder without results.
    """
    require('study')
    offer('report')
    from ballbot_ros.lab.studies.report import check_output, several_report, study_report
    from ballbot_ros.lab.studies.study_data import StudyData

    place = check_output(folder, output)
    (several_report(folder) or study_report(StudyData.open(folder))).write(place)
    click.echo(f'report  {place / "index.html"}')
    return 0
