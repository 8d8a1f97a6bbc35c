"""`ballbot export`: a recording as tables."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from ballbot_ros.cli.file_progress import file_progress
from ballbot_ros.messages.conversions import ball_position, body_pitch
from ballbot_ros.messages.topics import (
    MOTOR_DUTY,
    OPERATING_STATE,
    PLANT_IMU,
    PLANT_ODOM,
    SOUND,
)
from ballbot_ros.recording.columns import Meaning
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.recording.export import Exporter
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.tables import load_pyarrow
from ballbot_ros.simulation.timing import TICK_NS

_MEANINGS = {
    PLANT_IMU: Meaning(
        more={
            'pitch_x_rad': lambda message: body_pitch(message)[0],
            'pitch_y_rad': lambda message: body_pitch(message)[1],
        }
    ),
    PLANT_ODOM: Meaning(
        more={
            'plane_position_x_m': lambda message: float(ball_position(message)[0]),
            'plane_position_y_m': lambda message: float(ball_position(message)[1]),
        }
    ),
    MOTOR_DUTY: Meaning(names={'vector_x': 'x_percent', 'vector_y': 'y_percent'}),
    SOUND: Meaning(
        names={'vector_x': 'tone_Hz', 'vector_y': 'duration_ms', 'vector_z': 'volume_percent'}
    ),
}
"""What docs/frames.md says of these topics beyond their types."""


def export_file(
    path: Path, file_format: str, folder: Path | None, *, joined: bool, topics: Sequence[str]
) -> None:
    """Write the tables, and say where they are."""
    if file_format == 'parquet':
        load_pyarrow()
    console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    folder = folder or path.with_name(f'{path.stem}_{file_format}')
    with RecordingReader(path) as reader, file_progress(f'exporting {path.name}') as progress:
        exporter = Exporter(
            reader,
            folder,
            file_format,
            _chosen(reader, topics, console),
            {(topic.resolved(), topic.type_name): meaning for topic, meaning in _MEANINGS.items()},
            progress,
        )
        if joined:
            exporter.write_joined(TICK_NS, [OPERATING_STATE.resolved()])
        else:
            exporter.write_topics()
        if reader.damage:
            console.print(f'{path}: {reader.damage}; the tables end there')
    for file in exporter.files:
        print(file)
    if not exporter.files:
        console.print(f'{path}: no messages, no tables')


def _chosen(reader: RecordingReader, topics: Sequence[str], console: Console) -> list[str]:
    known = reader.topics()
    for topic in topics:
        if topic not in known:
            raise RecordingError(
                f'{reader.path}: no topic {topic!r}, only {", ".join(sorted(known)) or "none"}'
            )
    unreadable = reader.unreadable()
    for topic in unreadable:
        if topic in topics:
            raise RecordingError(f'{reader.path}: {topic}: {unreadable[topic]}')
        if not topics:
            console.print(f'{reader.path}: {topic} is left out: {unreadable[topic]}')
    return list(topics) or sorted(known.keys() - unreadable.keys())
