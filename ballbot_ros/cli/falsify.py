"""`ballbot falsify`: runs that violate what is required, found by a search."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.table import Table

from ballbot_ros.analysis.metrics import number
from ballbot_ros.cli.options import folder_option, print_whole, processes_option
from ballbot_ros.cli.study import StudyOptions, method_option, resumable, study_options
from ballbot_ros.files import own_command
from ballbot_ros.run.requirements import Processes

if TYPE_CHECKING:
    from ballbot_ros.lab.search.falsify import Counterexample, FalsificationResult


@click.command('falsify')
@click.argument('study')
@click.option(
    '--runs', type=click.IntRange(1), help="Largest number of runs.  [default: the file's]"
)
@click.option(
    '--counterexamples',
    type=click.IntRange(1),
    default=3,
    show_default=True,
    help='Number of counterexamples after which the search ends.',
)
@method_option
@processes_option
@folder_option('the results.  [default: falsified/<name of the study>]')
@study_options
def command(
    study: str,
    runs: int | None,
    counterexamples: int,
    method: str,
    processes: str,
    output: Path | None,
    options: StudyOptions,
) -> int:
    """Search the variation of STUDY, a name or a YAML file, for runs that do not pass.

    The requirements are the properties and expectations of the study, or of its scenario. Each
    counterexample is made simpler, written as a scenario, and recorded as a run of the nodes.
    Without any, nothing is proven: the command tells how much was searched.

    Exit status: 1 if there is a counterexample, 0 if none was found, 2 for a mistake in the
    arguments, 130 after Ctrl-C.
    """
    options.require(*(['search'] if method == 'cma' else []))
    from ballbot_ros.cli.study_output import SearchProgress
    from ballbot_ros.lab.search.falsify import Falsification, check, run_falsification
    from ballbot_ros.lab.search.optimiser import Method
    from ballbot_ros.lab.search.report import falsification_report
    from ballbot_ros.lab.studies.reader import read_studies
    from ballbot_ros.lab.studies.report import check_output
    from ballbot_ros.process import stdout_to_stderr

    with stdout_to_stderr():  # a controller may print while its class is loaded
        studies = list(
            read_studies(study, runs, options.seed, options.controller, options.parameter_file)
        )
        for each in studies:
            check(each)
        place = output or Path('falsified') / Path(study).stem
        results = []
        for each in studies:
            falsification = Falsification(each, counterexamples, Method(method))
            folder, progress = place.joinpath(*each.case.values()), SearchProgress(each.name)
            with resumable(place), progress:
                result = run_falsification(
                    falsification, folder, progress, options.workers, Processes(processes),
                    again=options.again,
                )  # fmt: skip
            falsification_report(result).write(check_output(folder, None))
            results.append(result)
    if options.as_json:
        click.echo(json.dumps([_json(each) for each in results], indent=2, allow_nan=False))
    else:
        for result in results:
            _print(result)
    return 1 if any(each.counterexamples for each in results) else 0


def _print(result: FalsificationResult) -> None:
    """Print what was searched and found."""
    from ballbot_ros.lab.search.falsify import requirements_of

    study = result.of.study
    table = Table(title=f'{study.name}, seed {study.seed}', title_justify='left')
    for name in ('requirement', 'lowest robustness', 'unit'):
        table.add_column(name, justify='right' if name.startswith('low') else 'left')
    for each in requirements_of(study):
        table.add_row(each.name, f'{result.least[each.name]:.4g}', each.unit)
    print_whole(Console(highlight=False, markup=False), table)
    for rank, found in enumerate(result.counterexamples, 1):
        click.echo(f'{rank}. violates {found.requirement!r}: {_deviations(found)}')
        click.echo(f'   {own_command("run", found.scenario or "")}')
        if not found.is_same:
            click.echo('   error: the recording has other duties than the search', err=True)
    variables = len(study.variables)
    click.echo(
        f'searched  {result.runs:,} of {study.runs:,} runs, {variables} variables; '
        f'{result.violating:,} run{"s" * (result.violating != 1)} did not pass'
    )
    if not result.counterexamples:
        click.echo('No counterexample was found, which does not prove that there is none.')
    click.echo(f'report    {result.folder / "report/index.html"}')


def _deviations(found: Counterexample) -> str:
    """Return what differs from the nominal values."""
    from ballbot_ros.lab.studies.report import value_text

    if not found.deviations:
        return 'with all nominal values'
    return ', '.join(f'{name} = {value_text(found.shrunk[name])}' for name in found.deviations)


def _json(result: FalsificationResult) -> dict[str, object]:
    return {
        'study': result.of.study.name,
        'runs': result.runs,
        'budget': result.of.study.runs,
        'not_passed': result.violating,
        'robustness': {name: number(each) for name, each in result.least.items()},
        'counterexamples': [
            {
                'number': each.number,
                'requirement': each.requirement,
                'found': dict(each.found),
                'shrunk': {name: each.shrunk[name] for name in each.deviations},
                'scenario': str(each.scenario),
                'duty_sha256': each.duty_sha256,
                'reproduced': each.is_same,
            }
            for each in result.counterexamples
        ],
        'results': str(result.folder),
    }
