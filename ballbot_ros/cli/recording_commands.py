"""The commands that work on recording files, and their options."""

from __future__ import annotations

from pathlib import Path

import click

_FILE = click.Path(path_type=Path)


@click.command(short_help='Tell what a recording holds.')
@click.argument('file', type=_FILE)
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def info(file: Path, as_json: bool) -> None:
    """Tell what the recording FILE holds, what made it, and whether it is whole.

    It may be of any ROS 2 tool, and damaged.
    """
    from ballbot_ros.cli.info import print_info

    print_info(file, as_json=as_json)


@click.command(short_help='Recover a damaged recording.')
@click.argument('file', type=_FILE)
@click.option(
    '--output',
    type=_FILE,
    help='File to write, which must not exist.  [default: FILE_repaired.mcap beside it]',
)
def repair(file: Path, output: Path | None) -> None:
    """Copy what is whole in the damaged recording FILE to a new one, and say what is lost."""
    from ballbot_ros.cli.repair import repair_file

    repair_file(file, output)


def _split(
    context: click.Context, parameter: click.Parameter, values: tuple[str, ...]
) -> list[str]:
    """Let an option be given again, or once with commas."""
    return [name for value in values for name in value.split(',') if name]


@click.command(short_help='Write a recording as tables.')
@click.argument('file', type=_FILE)
@click.option(
    '--to', 'file_format', type=click.Choice(['csv', 'parquet']), required=True, help='File format.'
)
@click.option(
    '--output', type=_FILE, help='Folder for the tables.  [default: FILE_csv or FILE_parquet]'
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


@click.command(short_help='Publish a recording into the graph.')
@click.argument('file', type=_FILE)
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
