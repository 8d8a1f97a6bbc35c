"""`ballbot tune`: parameters that are best on many robots, found by a search."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.table import Table

from ballbot_ros.analysis.metrics import number
from ballbot_ros.cli.install import offer
from ballbot_ros.cli.options import folder_option, print_whole
from ballbot_ros.cli.study import StudyOptions, method_option, resumable, study_options
from ballbot_ros.engine.scenario.reader import scenario_names
from ballbot_ros.engine.scenario.scenario import bounds_text
from ballbot_ros.files import own_command
from ballbot_ros.parameters.files import plain_value

if TYPE_CHECKING:
    from ballbot_ros.lab.search.objective import Verdict
    from ballbot_ros.lab.search.tune import TuningResult
    from ballbot_ros.lab.search.tuning import Tuning


@click.command('tune')
@click.argument('tuning', required=False)
@click.option(
    '--candidates', type=click.IntRange(1), help="Number of candidates.  [default: the file's]"
)
@method_option
@folder_option('the results.  [default: tunings/<name>/<controller>]')
@study_options
def command(
    tuning: str | None,
    candidates: int | None,
    method: str,
    output: Path | None,
    options: StudyOptions,
) -> int:
    """Search for parameters by TUNING, a name or a YAML file; without one, list those shipped.

    The file says what is tuned, on which robots, and for what. The result is a parameter file for
    --params, and a report. An interrupted search goes on with the same command. --controller
    chooses one of the controllers that the file tunes.

    Exit status: 0 if the best candidate keeps all limits, 1 if it breaks one, 2 for a mistake in
    the arguments, 130 after Ctrl-C.
    """
    from ballbot_ros.lab.search.tuning import read_tuning, tuning_names

    if tuning is None:
        names = tuning_names()
        for name in names:
            purpose = read_tuning(name).studies[0].purpose
            click.echo(f'{name:<{max(map(len, names))}}  {purpose}')
        return 0
    options.require(*(['search'] if method == 'cma' else []))
    offer('report')
    from ballbot_ros.cli.study_output import SearchProgress
    from ballbot_ros.lab.search.optimiser import Method
    from ballbot_ros.lab.search.report import tuning_report
    from ballbot_ros.lab.search.tune import run_tuning
    from ballbot_ros.lab.studies.report import check_output
    from ballbot_ros.process import stdout_to_stderr

    with stdout_to_stderr():  # a controller may print while its class is loaded
        read = read_tuning(
            tuning, candidates, options.seed, options.controller, options.parameter_file,
            Method(method),
        )  # fmt: skip
        place = output or Path('tunings') / read.name / read.controller
        progress = SearchProgress(read.name)
        with resumable(place), progress:
            result = run_tuning(read, place, progress, options.workers, again=options.again)
        page = check_output(place, None)
        tuning_report(result).write(page)
    _print(result, page / 'index.html', as_json=options.as_json)
    return 0 if result.verdicts.is_feasible[result.best] else 1


def _print(result: TuningResult, page: Path, *, as_json: bool) -> None:
    """Print what was found, and where it is."""
    from ballbot_ros.lab.studies.report import value_text

    tuning, unseen = result.tuning, result.unseen()
    start, best = result.values(0), result.values(result.best)
    if as_json:
        content = {
            'tuning': tuning.name,
            'candidates': len(result.points),
            'feasible': bool(result.verdicts.is_feasible[result.best]),
            'parameters': {
                name: {'start': plain_value(start[name]), 'tuned': plain_value(best[name])}
                for name in best
            },
            'searched': _verdict_json(result.verdicts, tuning, (0, result.best)),
            'unseen': _verdict_json(unseen, tuning, (0, 1)),
            'parameter_file': str(result.parameter_file),
            'report': str(page),
        }
        click.echo(json.dumps(content, indent=2, allow_nan=False))
        return
    robots = ' + '.join(f'{each.runs:,}' for each in tuning.studies)
    table = Table(title=f'{tuning.name}, {len(result.points):,} candidates', title_justify='left')
    for name in ('', 'start', 'tuned', f'start, {tuning.unseen:,} unseen', 'tuned, unseen'):
        table.add_column(name, justify='right' if name else 'left', no_wrap=True)
    for name in best:
        table.add_row(name, *(value_text(plain_value(of[name])) for of in (start, best)))
    both = [(result.verdicts, 0), (result.verdicts, result.best), (unseen, 0), (unseen, 1)]
    table.add_row(f'objective, {tuning.objective.over}', *(f'{of.value[i]:.4g}' for of, i in both))
    table.add_row('robots without a value [%]', *(f'{100 * of.lost[i]:.3g}' for of, i in both))
    for place, limit in enumerate(tuning.objective.limits):
        bounds = bounds_text(limit.minimum, limit.maximum)
        values = (f'{of.limits[i, place]:.4g}' for of, i in both)
        table.add_row(f'{limit.name} {bounds}', *values)
    print_whole(Console(highlight=False, markup=False), table)
    if not result.verdicts.is_feasible[result.best]:
        click.echo(f'note: no candidate keeps all limits on the {robots} robots of the search')
    scenario = tuning.studies[0].spec.scenario.name
    click.echo(f'parameters  {result.parameter_file}')
    click.echo(f'report      {page}')
    if scenario in scenario_names():
        click.echo(f'run it      {own_command("run", scenario, "--params", result.parameter_file)}')


def _verdict_json(of: Verdict, tuning: Tuning, pair: tuple[int, int]) -> dict[str, object]:
    """Return the verdicts of start and best."""
    return {
        which: {
            'objective': number(float(of.value[place])),
            'without_value': float(of.lost[place]),
            'limits': {
                limit.name: number(float(value))
                for limit, value in zip(tuning.objective.limits, of.limits[place], strict=True)
            },
        }
        for which, place in zip(('start', 'tuned'), pair, strict=True)
    }
