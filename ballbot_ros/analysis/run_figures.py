"""The figures of a report: content, required topics and drawing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
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
"""Minimum span of an axis [°, cm or °/s]; one gyro count is 1 °/s."""


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


@dataclass(frozen=True)
class _Pair:
    """A true column and one to compare with it, {} for the plane; names of axis and other."""

    true: str
    other: str
    label: str
    name: str = 'estimated'


def _draw_pairs(run: RunData, table: Table, pairs: Sequence[_Pair], *, share_rows: bool) -> Figure:
    """Draw pairs of curves, true and other: a row for each pair, a column for each plane."""
    figure = new_figure(WIDTH, 5.0)
    grid = figure.subplots(2, 2, sharex=True, sharey='row' if share_rows else 'none')
    for line, pair in zip(grid, pairs, strict=True):
        for axes, plane in zip(line, 'xy', strict=True):
            for column, look in (
                (pair.true, Line(ORANGE, 2.2, label='true')),
                (pair.other, Line(BLUE, 0.9, '--', pair.name)),
            ):
                draw_line(axes, table['time_s'], table[column.format(plane)], look)
            frame_curves(axes, '')
            shade_intervals(axes, _calibration(run))
        for axes in line:  # after all curves of the row: setting the span ends autoscaling
            set_min_span(axes, MIN_AXIS_SPAN)
        line[0].set_ylabel(pair.label)
        legend_above(line[1])
    for axes, plane in zip(grid[0], 'xy', strict=True):
        axes.set_title(f'plane {plane}', loc='left')
    for axes in grid[1]:
        label_time(axes)
    return figure


def _draw_estimate(run: RunData, table: Table) -> Figure:
    pairs = (
        _Pair('true_pitch_{}_deg', 'estimated_pitch_{}_deg', PITCH.label),
        _Pair('true_position_{}_cm', 'estimated_position_{}_cm', POSITION.label),
    )
    return _draw_pairs(run, table, pairs, share_rows=True)


def _draw_gyro(run: RunData, table: Table) -> Figure:
    pairs = (
        _Pair(
            'true_rate_{}_deg_per_s',
            'read_rate_{}_deg_per_s',
            'pitch rate [°/s]',
            'reading − offset',
        ),
        _Pair('true_offset_{}_deg_per_s', 'estimated_offset_{}_deg_per_s', 'gyro offset [°/s]'),
    )
    # The planes do not share an axis, since their gyros have different offsets.
    return _draw_pairs(run, table, pairs, share_rows=False)


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
