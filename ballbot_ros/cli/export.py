"""`ballbot export`: a recording as tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from ballbot_ros.cli.file_progress import file_progress
from ballbot_ros.cli.options import split_at_commas
from ballbot_ros.cli.path_types import PATH, RECORDING
from ballbot_ros.messages.conversions import ball_position, body_pitch
from ballbot_ros.messages.topics import (
    CONTROLLER_STATE,
    GAMEPAD_JOY,
    GYRO_IMU,
    JOINT_STATES,
    MOTOR_DUTY,
    ODOM,
    OPERATING_STATE,
    PLANT_IMU,
    PLANT_ODOM,
    SOUND,
)
from ballbot_ros.recording.columns import ColumnHints
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.recording.export import Exporter
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.tables import load_pyarrow
from ballbot_ros.timing import TICK_NS

_Read = Callable[[Any], float]


def _joint(name: str) -> _Read:
    """Return what reads the position [deg] of a joint; NaN if the message does not have it."""

    def position(message: Any) -> float:
        positions = dict(zip(message.name, message.position, strict=False))
        return math.degrees(positions.get(name, math.nan))

    return position


def _axis(number: int) -> _Read:
    """Return what reads an axis [%]; NaN if the message does not have it."""

    def percent(message: Any) -> float:
        axes = message.axes
        return 100.0 * float(axes[number]) if number < len(axes) else math.nan

    return percent


_COLUMN_HINTS = {
    GYRO_IMU: ColumnHints(
        extra={
            'reading_x_deg_per_s': lambda message: math.degrees(message.angular_velocity.y),
            'reading_y_deg_per_s': lambda message: math.degrees(message.angular_velocity.x),
        }
    ),
    JOINT_STATES: ColumnHints(
        extra={f'encoder_{axis}_deg': _joint(f'motor_{axis}') for axis in 'xy'}
    ),
    GAMEPAD_JOY: ColumnHints(
        extra={'stick_vertical_percent': _axis(0), 'stick_horizontal_percent': _axis(1)}
    ),
    CONTROLLER_STATE: ColumnHints(
        extra={
            **{f'estimated_pitch_{axis}_deg': _joint(f'psi_{axis}') for axis in 'xy'},
            **{f'estimated_ball_angle_{axis}_deg': _joint(f'theta_{axis}') for axis in 'xy'},
            **{f'reference_ball_angle_{axis}_deg': _joint(f'theta_ref_{axis}') for axis in 'xy'},
        }
    ),
    PLANT_IMU: ColumnHints(
        extra={
            'pitch_x_rad': lambda message: body_pitch(message)[0],
            'pitch_y_rad': lambda message: body_pitch(message)[1],
        }
    ),
    PLANT_ODOM: ColumnHints(
        names={f'pose_pose_position_{axis}_m': f'map_{axis}_m' for axis in 'xyz'},
        extra={
            'plane_position_x_m': lambda message: float(ball_position(message)[0]),
            'plane_position_y_m': lambda message: float(ball_position(message)[1]),
        },
    ),
    ODOM: ColumnHints(
        names={f'pose_pose_position_{axis}_m': f'odom_{axis}_m' for axis in 'xyz'},
    ),
    MOTOR_DUTY: ColumnHints(names={'vector_x': 'x_percent', 'vector_y': 'y_percent'}),
    SOUND: ColumnHints(
        names={'vector_x': 'tone_Hz', 'vector_y': 'duration_ms', 'vector_z': 'volume_percent'}
    ),
}
"""Knowledge from docs/frames.md about these topics beyond their types."""


@click.command('export')
@click.argument('file', type=RECORDING)
@click.option(
    '--to', 'file_format', type=click.Choice(['csv', 'parquet']), required=True, help='File format.'
)
@click.option(
    '--output', type=PATH, help='Folder for the tables.  [default: FILE_csv or FILE_parquet]'
)
@click.option(
    '--joined', is_flag=True, help='One table with a row per tick (4 ms) instead of one per topic.'
)
@click.option(
    '--topics',
    multiple=True,
    callback=split_at_commas,
    metavar='TOPIC[,TOPIC…]',
    help='The topics to export; can be repeated.  [default: all that are not derived from others]',
)
def command(
    file: Path, file_format: str, output: Path | None, joined: bool, topics: list[str]
) -> None:
    """Write the recording FILE as tables with SI units in the column names."""
    if file_format == 'parquet':
        load_pyarrow()
    console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    folder = output or file.with_name(f'{file.stem}_{file_format}')
    with RecordingReader(file) as reader, file_progress(f'exporting {file.name}') as progress:
        exporter = Exporter(
            reader,
            folder,
            file_format,
            _chosen(reader, topics, console),
            {(topic.resolved(), topic.type_name): hints for topic, hints in _COLUMN_HINTS.items()},
            progress,
        )
        if joined:
            exporter.write_joined(TICK_NS, [OPERATING_STATE.resolved()])
        else:
            exporter.write_topics()
        if reader.damage:
            console.print(f'{file}: {reader.damage}; the tables end there')
    for table in exporter.files:
        print(table)
    if not exporter.files:
        console.print(f'{file}: no messages to export')


def _chosen(reader: RecordingReader, topics: Sequence[str], console: Console) -> list[str]:
    known = reader.topics()
    for topic in topics:
        if topic not in known:
            raise RecordingError(
                f'{reader.path}: topic {topic!r} not found, only '
                f'{", ".join(sorted(known)) or "none"}'
            )
    unreadable = reader.unreadable()
    for topic in unreadable:
        if topic in topics:
            raise RecordingError(f'{reader.path}: {topic}: {unreadable[topic]}')
        if not topics:
            console.print(f'{reader.path}: {topic} skipped: {unreadable[topic]}')
    return list(topics) or sorted(known.keys() - unreadable.keys() - reader.derived())
