"""`ballbot twin`: the simulated twin of a real robot."""

from __future__ import annotations

from pathlib import Path

import click

from ballbot_ros.cli.options import RECORDING, folder_option, known_profile_option
from ballbot_ros.errors import BallbotError
from ballbot_ros.parameters import PLANT


@click.command('twin')
@click.argument('log', type=RECORDING)
@known_profile_option
@folder_option(
    'page, pictures, recording and parameters; it must be new or empty.  '
    '[default: <log>_twin next to it]'
)
def command(log: Path, profile: str, output: Path | None) -> None:
    """Simulate a robot like the real one of LOG, with its program and its sticks, and compare both.

    LOG is a recording of `ballbot brick drive`, or a data log. What it tells of the robot is
    identified; the rest is that of the profile. A data log as CSV has no sticks, so its twin stands
    still.
    """
    # Imported only here: it takes half a second.
    from ballbot_ros.analysis import comparison
    from ballbot_ros.analysis.identification.experiment import logged_experiment
    from ballbot_ros.analysis.identification.identification import HARD_TO_MEASURE, identify
    from ballbot_ros.analysis.page import check_folder
    from ballbot_ros.cli.compare import print_changes, print_table
    from ballbot_ros.cli.identify_output import IdentifyOutput
    from ballbot_ros.cli.progress import file_progress
    from ballbot_ros.cli.recordings import read_and_assess
    from ballbot_ros.engine.scenario.reader import load_profile
    from ballbot_ros.files import own_command
    from ballbot_ros.recording.messages.topics import GAMEPAD_JOY
    from ballbot_ros.run.observer import LogObserver
    from ballbot_ros.run.offline import run_offline
    from ballbot_ros.run.twin import NAME, twin_spec

    folder = output or log.with_name(f'{log.stem}_twin')
    check_folder(folder)
    real = read_and_assess(log)
    if not real.run.is_real:
        raise BallbotError(f'{log}: not a real robot; compare simulated runs with `compare`')
    if GAMEPAD_JOY not in real.run.series:
        click.echo(f'note: {log}: has no sticks, so its twin stands still', err=True)
    known = load_profile(profile)
    start = {name: value for node, name, value in known if node == PLANT}
    with file_progress('identifying') as progress:
        found = identify([logged_experiment(log, start)], HARD_TO_MEASURE, {}, [], progress)
    result = IdentifyOutput(found)
    result.print()
    spec = twin_spec(real.run, known, result.parameters, folder)
    folder.mkdir(parents=True, exist_ok=True)
    recording, parameters = folder / f'{NAME}.mcap', folder / f'{NAME}.yaml'
    run_offline(spec, recording, LogObserver())
    if result.identified:
        parameters.write_text(result.parameter_file(), encoding='utf-8')
    runs = [
        comparison.ComparedRun.from_assessment('A', real),
        comparison.ComparedRun.from_assessment('B', read_and_assess(recording)),
    ]
    compared = comparison.Comparison.of(runs)
    print_changes(compared, '')
    print_table(compared.runs, comparison.metric_comparisons(compared.runs), with_same=False)
    comparison.write_comparison(compared, [], folder)
    click.echo(f'comparison  {folder / "index.html"}')
    if result.identified:
        click.echo(f'parameters  {parameters}')
    click.echo(f'watch both  {own_command("view", log, recording)}')
