"""What the columns of the robot's topics mean beyond their types."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import make_dataclass
from typing import Any

import numpy as np

from ballbot_ros.recording.columns import ColumnHints, ComputedColumn
from ballbot_ros.recording.messages import topics
from ballbot_ros.recording.messages.conversions import pitch_angles
from ballbot_ros.recording.messages.jobs import COLUMNS, jobs_in
from ballbot_ros.recording.messages.topics import Topic


def column_hints(namespace: str = '') -> dict[tuple[str, str], ColumnHints]:
    """Return the hints by topic and type; `namespace` is '' or like ``/robot``."""
    return {(topic.resolved(namespace), topic.type_name): hints for topic, hints in _HINTS.items()}


def _degrees(source: str) -> ComputedColumn:
    return ComputedColumn((source,), np.degrees)


def _percent(source: str) -> ComputedColumn:
    return ComputedColumn((source,), lambda share: 100.0 * share)


def _pitch(plane: int) -> ComputedColumn:
    pitch: Callable[..., Any] = np.frompyfunc(lambda *q: pitch_angles(*q)[plane], 4, 1)
    return ComputedColumn(tuple(f'orientation_{part}' for part in 'wxyz'), pitch)


_JobRow = make_dataclass('_JobRow', COLUMNS, namespace={'__msgtype__': 'Job'})


def _job_rows(message: object) -> list[Any]:
    names, *columns = jobs_in(message)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return [_JobRow(names[task], *others) for task, *others in rows]


_HINTS: Mapping[Topic, ColumnHints] = {
    topics.GYRO_IMU: ColumnHints(
        extra={
            'reading_x_deg_per_s': _degrees('angular_velocity_y_rad_per_s'),
            'reading_y_deg_per_s': _degrees('angular_velocity_x_rad_per_s'),
        }
    ),
    topics.JOINT_STATES: ColumnHints(
        extra={f'encoder_{axis}_deg': _degrees(f'position_motor_{axis}_rad') for axis in 'xy'}
    ),
    topics.GAMEPAD_JOY: ColumnHints(
        extra={
            'stick_vertical_percent': _percent('axes_0'),
            'stick_horizontal_percent': _percent('axes_1'),
        }
    ),
    topics.CONTROLLER_STATE: ColumnHints(
        extra={
            f'{name}_{axis}_deg': _degrees(f'position_{angle}_{axis}_rad')
            for name, angle in (
                ('estimated_pitch', 'psi'),
                ('estimated_ball_angle', 'theta'),
                ('reference_ball_angle', 'theta_ref'),
            )
            for axis in 'xy'
        }
    ),
    topics.PLANT_IMU: ColumnHints(extra={'pitch_x_rad': _pitch(0), 'pitch_y_rad': _pitch(1)}),
    topics.PLANT_ODOM: ColumnHints(
        names={f'pose_pose_position_{axis}_m': f'map_{axis}_m' for axis in 'xyz'},
        extra={
            'plane_position_x_m': ComputedColumn(('pose_pose_position_x_m',), np.positive),
            'plane_position_y_m': ComputedColumn(('pose_pose_position_y_m',), np.negative),
        },
    ),
    topics.ODOM: ColumnHints(
        names={f'pose_pose_position_{axis}_m': f'odom_{axis}_m' for axis in 'xyz'},
    ),
    topics.BRICK_TASKS: ColumnHints(rows=_job_rows),
    topics.MOTOR_DUTY: ColumnHints(names={'vector_x': 'x_percent', 'vector_y': 'y_percent'}),
    topics.SOUND: ColumnHints(
        names={'vector_x': 'tone_Hz', 'vector_y': 'duration_ms', 'vector_z': 'volume_percent'}
    ),
}
"""Knowledge from docs/frames.md."""
