"""The figures of a report: content, required topics and drawing."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ballbot_ros.analysis.drawing import (
    DUTY,
    PITCH,
    POSITION,
    draw_floor,
    draw_line,
    draw_planes,
    draw_track,
    frame_curves,
    label_time,
    legend_above,
    set_min_span,
    shade_intervals,
    style_axes,
)
from ballbot_ros.analysis.figure_tables import (
    battery_table,
    command_table,
    duty_table,
    estimate_table,
    gyro_table,
    motion_table,
    sonar_table,
    state_table,
    track_table,
)
from ballbot_ros.analysis.interval import Interval
from ballbot_ros.analysis.run_data import RunData
from ballbot_ros.analysis.style import (
    BLUE,
    GRAY,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    WIDTH,
    YELLOW,
    Line,
    new_figure,
    png_of,
)
from ballbot_ros.analysis.table import Table
from ballbot_ros.controllers.interface import OperatingState
from ballbot_ros.messages.topics import (
    BATTERY_STATE,
    CONTROLLER_STATE,
    GYRO_IMU,
    MOTOR_DUTY,
    PLANT_IMU,
    PLANT_ODOM,
    SONAR_RANGE,
    Topic,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STATE_COLOURS = (GRAY, BLUE, GREEN, SKY, YELLOW, PURPLE, ORANGE)
_HATCHES = ('', '', '//', '..', 'xx', '\\\\', '++')

MIN_AXIS_SPAN = 1.0
"""Minimum span of an axis [°, cm, cm/s or °/s]; one gyro count is 1 °/s."""


@dataclass(frozen=True)
class RunFigure:
    """A figure of a run: its file name without extension, heading and caption.

    It `needs` topics, makes its numbers from a run as a table, and draws them.
    """

    name: str
    title: str
    caption: str
    needs: tuple[Topic, ...]
    table: Callable[[RunData], Table]
    draw: Callable[[RunData, Table], Figure]


@dataclass(frozen=True)
class RenderedFigure:
    """A drawn figure and its numbers."""

    name: str
    title: str
    caption: str
    png: bytes
    table: Table


def draw_figures(run: RunData) -> list[RenderedFigure]:
    """Draw every figure for which the recording has the topics."""
    drawn = []
    for figure in FIGURES:
        if not all(topic in run.series for topic in figure.needs):
            continue
        table = figure.table(run)
        if all(np.size(column) for column in table.values()):
            png = png_of(figure.draw(run, table))
            drawn.append(RenderedFigure(figure.name, figure.title, figure.caption, png, table))
    return drawn


def _calibration(run: RunData) -> list[Interval]:
    return [each for each in run.states if each.name == OperatingState.CALIBRATION]


def _draw_motion(run: RunData, table: Table) -> Figure:
    figure = new_figure(WIDTH, 5.0)
    rows = figure.subplots(2, 1, sharex=True)
    for axes, quantity in zip(rows, (POSITION, PITCH), strict=True):
        draw_planes(axes, quantity, table)
        shade_intervals(axes, _calibration(run))
    legend_above(rows[0])
    label_time(rows[1])
    return figure


def _draw_track(run: RunData, table: Table) -> Figure:
    figure = new_figure(WIDTH, 5.0)
    axes = figure.subplots()
    draw_floor(axes, run.floor)
    draw_track(axes, table, Line(BLUE))
    legend_above(axes)
    return figure


def _draw_duty(run: RunData, table: Table) -> Figure:
    figure = new_figure(WIDTH, 2.8)
    axes = figure.subplots()
    draw_planes(axes, DUTY, table)
    for limit in (-100.0, 100.0):
        axes.axhline(limit, color=GRAY, linewidth=0.8, linestyle=':')
    shade_intervals(axes, _calibration(run))
    legend_above(axes)
    label_time(axes)
    return figure


_TRUE, _ESTIMATED = Line(ORANGE, 2.2, label='true'), Line(BLUE, 0.9, '--', 'estimated')


@dataclass(frozen=True)
class _Row:
    """The curves of a quantity for each plane: columns, {} for the plane, and their lines."""

    label: str
    curves: Mapping[str, Line]


def _draw_rows(run: RunData, table: Table, rows: Sequence[_Row], *, share_rows: bool) -> Figure:
    """Draw two rows of curves, with a column for each plane."""
    figure = new_figure(WIDTH, 5.0)
    grid = figure.subplots(2, 2, sharex=True, sharey='row' if share_rows else 'none')
    for line, row in zip(grid, rows, strict=True):
        for axes, plane in zip(line, 'xy', strict=True):
            for column, look in row.curves.items():
                draw_line(axes, table['time_s'], table[column.format(plane)], look)
            frame_curves(axes, '')
            shade_intervals(axes, _calibration(run))
        for axes in line:  # after all curves of the row: setting the span ends autoscaling
            set_min_span(axes, MIN_AXIS_SPAN)
        line[0].set_ylabel(row.label)
        legend_above(line[1])
    for axes, plane in zip(grid[0], 'xy', strict=True):
        axes.set_title(f'plane {plane}', loc='left')
    for axes in grid[1]:
        label_time(axes)
    return figure


def _draw_estimate(run: RunData, table: Table) -> Figure:
    rows = (
        _Row(PITCH.label, {'true_pitch_{}_deg': _TRUE, 'estimated_pitch_{}_deg': _ESTIMATED}),
        _Row(
            POSITION.label,
            {'true_position_{}_cm': _TRUE, 'estimated_position_{}_cm': _ESTIMATED},
        ),
    )
    return _draw_rows(run, table, rows, share_rows=True)


def _draw_command(run: RunData, table: Table) -> Figure:
    reference = replace(_ESTIMATED, label='reference')
    speeds = {'true_speed_{}_cm_per_s': _TRUE, 'reference_speed_{}_cm_per_s': reference}
    if not np.isnan(table['commanded_speed_x_cm_per_s']).all():
        speeds['commanded_speed_{}_cm_per_s'] = Line(GRAY, 1.2, ':', 'commanded')
    positions = {'true_position_{}_cm': _TRUE, 'reference_position_{}_cm': reference}
    rows = _Row('speed [cm/s]', speeds), _Row(POSITION.label, positions)
    return _draw_rows(run, table, rows, share_rows=True)


def _draw_gyro(run: RunData, table: Table) -> Figure:
    rows = (
        _Row(
            'pitch rate [°/s]',
            {
                'true_rate_{}_deg_per_s': _TRUE,
                'read_rate_{}_deg_per_s': replace(_ESTIMATED, label='reading − offset'),
            },
        ),
        _Row(
            'gyro offset [°/s]',
            {'true_offset_{}_deg_per_s': _TRUE, 'estimated_offset_{}_deg_per_s': _ESTIMATED},
        ),
    )
    # The planes do not share an axis, since their gyros have different offsets.
    return _draw_rows(run, table, rows, share_rows=False)


def _draw_sonar(run: RunData, table: Table) -> Figure:
    figure = new_figure(WIDTH, 2.8)
    axes = figure.subplots()
    time, distance = table['time_s'], table['distance_cm']
    heard, silent = np.isfinite(distance), np.isinf(distance)
    axes.plot(time[heard], distance[heard], '.', color=BLUE, markersize=3.0, label='echo')
    axes.plot(time[silent], np.full(silent.sum(), 255.0), '|', color=ORANGE, markersize=4.0,
              label='no echo')  # fmt: skip
    axes.set_ylim(0.0, 270.0)
    frame_curves(axes, 'distance [cm]')
    label_time(axes)
    legend_above(axes)
    return figure


def _draw_battery(run: RunData, table: Table) -> Figure:
    figure = new_figure(WIDTH, 2.4)
    axes = figure.subplots()
    draw_line(axes, table['time_s'], table['voltage_v'], Line(BLUE))
    frame_curves(axes, 'battery [V]')
    set_min_span(axes, 0.5)
    label_time(axes)
    return figure


def _draw_states(run: RunData, table: Table) -> Figure:
    known = [state.value for state in OperatingState]
    present = [state for state in known if state in table['state']]
    present += sorted(set(table['state'].tolist()) - set(present))
    figure = new_figure(WIDTH, 1.1 + 0.32 * len(present))
    axes = figure.subplots()
    for each in run.states:
        look = known.index(each.name) if each.name in known else 0
        # One band per state, with its name next to it, so that colour is not needed.
        axes.barh(
            present.index(each.name), each.end - each.start, left=each.start, height=0.7,
            color=_STATE_COLOURS[look], hatch=_HATCHES[look], edgecolor='white', linewidth=0.0,
        )  # fmt: skip
    axes.set_yticks(range(len(present)), [state.replace('_', ' ') for state in present])
    axes.invert_yaxis()
    axes.set_xlim(0.0, max(run.end, float(table['end_s'][-1])))
    axes.set_ylabel('operating state')
    label_time(axes)
    style_axes(axes)
    return figure


FIGURES = (
    RunFigure(
        'motion',
        'Position and body pitch',
        'Position of the ball and body pitch against time, as in figures 8-2, 8-3, 9-2 and 9-3 of '
        'the document; forward and rightward are positive. The gyro calibration is shaded.',
        (PLANT_ODOM, PLANT_IMU),
        motion_table,
        _draw_motion,
    ),
    RunFigure(
        'track',
        'Track',
        'The track of the ball from above, over the walls of the recorded map, if any.',
        (PLANT_ODOM,),
        track_table,
        _draw_track,
    ),
    RunFigure(
        'operating_state',
        'Operating state',
        'The state of the control program against time.',
        (),
        state_table,
        _draw_states,
    ),
    RunFigure(
        'duty',
        'Duty',
        'The duties of both motors against time; the dotted lines are the saturation limits.',
        (MOTOR_DUTY,),
        duty_table,
        _draw_duty,
    ),
    RunFigure(
        'command',
        'Commanded and actual motion',
        'Speed and position of the ball. The command of the sticks, or of the autonomous drive, '
        'passes a low pass in the controller, whose output is the reference that it follows.',
        (PLANT_ODOM, CONTROLLER_STATE),
        command_table,
        _draw_command,
    ),
    RunFigure(
        'estimate',
        'Estimated and true state',
        'Body pitch and position as estimated by the controller, and their true values. The '
        'estimates start at the end of the calibration.',
        (PLANT_IMU, PLANT_ODOM, CONTROLLER_STATE),
        estimate_table,
        _draw_estimate,
    ),
    RunFigure(
        'gyro',
        'Gyro',
        'Above: gyro reading minus the estimated offset, and the true pitch rate. Below: the '
        'estimated offset and the true one, which is the 1 s mean of reading minus true rate.',
        (GYRO_IMU, PLANT_IMU, CONTROLLER_STATE),
        gyro_table,
        _draw_gyro,
    ),
    RunFigure(
        'sonar',
        'Ultrasonic sensor',
        'The distance measured by the sensor, against time.',
        (SONAR_RANGE,),
        sonar_table,
        _draw_sonar,
    ),
    RunFigure(
        'battery',
        'Battery',
        'Terminal voltage of the battery against time.',
        (BATTERY_STATE,),
        battery_table,
        _draw_battery,
    ),
)
"""The figures of a report, in order."""
