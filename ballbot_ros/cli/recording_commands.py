"""The commands that work on recording files, and their options; each has a module of its own."""

from __future__ import annotations

from pathlib import Path

import click

from ballbot_ros.cli.path_types import NEW_FILE, PATH, RECORDING
from ballbot_ros.viewer.views import VIEWS


@click.command(short_help='Make a page with figures and metrics of a recorded run.')
@click.argument('recording', type=RECORDING)
@click.option(
    '--output',
    type=PATH,
    help='Folder for page, pictures and tables; it must be new or empty.  '
    '[default: <recording>_report beside it]',
)
@click.option(
    '--run',
    'number',
    type=click.IntRange(1),
    help='Which run of a file that holds several, from 1 on.  [default: the last]',
)
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def report(recording: Path, output: Path | None, number: int | None, as_json: bool) -> int:
    """Write a report of RECORDING: index.html with everything in it, its PNGs and CSVs.

    Exit status: 0 if the report was written, whatever its verdict; 2 for a mistake in the
    arguments or a file that is no recording of a ballbot.
    """
    from ballbot_ros.cli.report import report as write

    return write(recording, number=number, output=output, as_json=as_json)


@click.command(short_help='Set the metrics of recorded runs side by side.')
@click.argument('recordings', nargs=-1, required=True, type=RECORDING, metavar='A B...')
@click.option(
    '--output',
    type=PATH,
    help='Folder for a page with the figures of all runs; it must be new or empty.',
)
@click.option(
    '--fail-if',
    'conditions',
    multiple=True,
    metavar="'METRIC>X%'",
    help='Exit with 1 if METRIC of any later run is larger than that of the first by more than X '
    'percent, or without % by more than X of its unit; < for smaller.  May be given again.',
)
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def compare(
    recordings: tuple[Path, ...], output: Path | None, conditions: tuple[str, ...], as_json: bool
) -> int:
    """Compare recorded runs with the first one, A.

    Exit status: 0; 1 if a --fail-if condition holds; 2 for a mistake in the arguments or a file
    that is no recording of a ballbot.
    """
    from ballbot_ros.cli.compare import compare as compare_runs

    return compare_runs(recordings, output=output, conditions=conditions, as_json=as_json)


@click.command(short_help='Show recorded runs in a browser.')
@click.argument('recording', type=RECORDING)
@click.argument('other', required=False, type=RECORDING)
@click.option(
    '--host',
    default='127.0.0.1',
    show_default=True,
    help='Address on which the page is served. Everybody who reaches it can look; whoever has the '
    'printed address with its token can steer.',
)
@click.option(
    '--port',
    type=click.IntRange(0, 65535),
    default=8080,
    show_default=True,
    help='Its port; 0: a free one.',
)
def view(recording: Path, other: Path | None, host: str, port: int) -> int:
    """Show the last run of RECORDING in a browser, and that of OTHER as its ghost.

    It serves the page until Ctrl-C or SIGTERM.
    """
    from ballbot_ros.cli.view import view_recordings

    return view_recordings([recording, *([other] if other else [])], host, port)


@click.command(short_help='Make a picture or a film of a recorded run.')
@click.argument('recording', type=RECORDING)
@click.option(
    '--view', type=click.Choice(VIEWS), default='chaser1', show_default=True, help='The view.'
)
@click.option(
    '--output',
    required=True,
    type=NEW_FILE,
    help='File to write: a picture (.png) or a film (.mp4, .gif).',
)
@click.option(
    '--time',
    'moment',
    type=click.FloatRange(0.0),
    help='Time of a picture from the start of the run [s].  [default: the end]',
)
def render(recording: Path, view: str, output: Path, moment: float | None) -> None:
    """Write a picture or a film of the last run of RECORDING, without a window."""
    from ballbot_ros.cli.render import render_recording

    render_recording(recording, view, output, moment)


@click.command(short_help='Make a recorded run again and say where it differs.')
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
def replay(
    recording: Path, controller: str | None, assignments: tuple[str, ...], as_json: bool
) -> int:
    """Make the runs of RECORDING again, from what the file itself holds.

    The controller first, on the recorded samples of the devices; then the whole robot, on its
    parameters and seed, the recorded sticks and pushes. Every message is compared.

    Exit status: 0 if all are identical, 1 if one differs, 2 if there is nothing to replay. With
    --set only the controller's duties are compared, and the status is 0.
    """
    from ballbot_ros.cli.replay import replay_recording

    return replay_recording(
        recording, controller=controller, assignments=assignments, as_json=as_json
    )


@click.command(short_help='Tell what a recording holds.')
@click.argument('file', type=RECORDING)
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def info(file: Path, as_json: bool) -> None:
    """Tell what the recording FILE holds, what made it, and whether it is whole.

    It may be of any ROS 2 tool, and damaged.
    """
    from ballbot_ros.cli.info import print_info

    print_info(file, as_json=as_json)


def _split(
    context: click.Context, parameter: click.Parameter, values: tuple[str, ...]
) -> list[str]:
    """Let an option be given again, or once with commas."""
    return [name for value in values for name in value.split(',') if name]


@click.command(short_help='Publish a recording into the graph.')
@click.argument('file', type=RECORDING)
@click.option('--rate', default=1.0, show_default=True, help='Speed in times real time.')
@click.option(
    '--start', default=0.0, show_default=True, help='Where to begin, after the first message [s].'
)
@click.option('--loop', is_flag=True, help='Begin again at the end.')
@click.option(
    '--topics',
    multiple=True,
    callback=_split,
    metavar='TOPIC[,TOPIC…]',
    help='The topics to publish; may be given again.  [default: all]',
)
def play(file: Path, rate: float, start: float, loop: bool, topics: list[str]) -> int:
    """Publish the recording FILE with its /clock, on the recorded topics.

    Keys: space pauses, → and ← skip 5 s, + and - change the speed, q ends. The player refuses to
    publish /clock and plant topics where a plant is at work.
    """
    from ballbot_ros.cli.play import play_file

    return play_file(
        {
            'file': str(file), 'rate': rate, 'start': start, 'loop': loop,
            'topics': ','.join(topics),
        }
    )  # fmt: skip


@click.command(short_help='Write a recording as tables.')
@click.argument('file', type=RECORDING)
@click.option(
    '--to', 'file_format', type=click.Choice(['csv', 'parquet']), required=True, help='File format.'
)
@click.option(
    '--output', type=PATH, help='Folder for the tables.  [default: FILE_csv or FILE_parquet]'
)
@click.option(
    '--joined', is_flag=True, help='One table with a row each tick (4 ms) instead of one a topic.'
)
@click.option(
    '--topics',
    multiple=True,
    callback=_split,
    metavar='TOPIC[,TOPIC…]',
    help='The topics to take; may be given again.  [default: all]',
)
def export(
    file: Path, file_format: str, output: Path | None, joined: bool, topics: list[str]
) -> None:
    """Write the recording FILE as tables with SI units in the names of the columns."""
    from ballbot_ros.cli.export import export_file

    export_file(file, file_format, output, joined=joined, topics=topics)


@click.command(short_help='Recover a damaged recording.')
@click.argument('file', type=RECORDING)
@click.option(
    '--output',
    type=NEW_FILE,
    help='File to write, which must not exist.  [default: FILE_repaired.mcap beside it]',
)
def repair(file: Path, output: Path | None) -> None:
    """Copy what is whole in the damaged recording FILE to a new one, and say what is lost."""
    from ballbot_ros.cli.repair import repair_file

    repair_file(file, output)


@click.command(short_help='Write the data log of a recording as CSV.')
@click.argument('recording', type=RECORDING)
@click.option(
    '--output',
    type=NEW_FILE,
    help='File to write.  [default: RECORDING with the suffix .csv]',
)
def log2csv(recording: Path, output: Path | None) -> None:
    """Write the data log that the brick sent in RECORDING as CSV, a file for each run in it."""
    from ballbot_ros.cli.log2csv import write_csv

    write_csv(recording, output or recording.with_suffix('.csv'))
