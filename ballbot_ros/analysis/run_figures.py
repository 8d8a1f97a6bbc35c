"""The figures of a report: what each shows, of which topics, and how it is drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

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
from ballbot_ros.analysis.run_data import RunData
from ballbot_ros.analysis.style import (
    BLUE,
    GRAY,
    GREEN,
    ORANGE,
    PLANES,
    PURPLE,
    SKY,
    YELLOW,
    legend_above,
    new_figure,
    png_of,
    tidy,
)
from ballbot_ros.analysis.table import Table
from ballbot_ros.controller.interface import DriveState
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
from ballbot_ros.world.exports import OccupancyGrid

_STATE_COLOURS = (GRAY, BLUE, GREEN, SKY, YELLOW, PURPLE, ORANGE)
_HATCHES = ('', '', '//', '..', 'xx', '\\\\', '++')
_WIDTH = 8.0

LEAST_SPAN = 1.0
"""Of the axis of a state that hardly changes [°, cm or °/s]; a count of the gyro is 1 °/s."""


@dataclass(frozen=True)
class RunFigure:
    """A figure of a run.

    Attributes
    ----------
    name : str
        The file's name without its ending.
    title, caption : str
        Heading, and what is to be seen.
    needs : tuple of Topic
        Without one of these topics there is no such figure.
    table : callable
        The numbers that it shows, of a run.
    draw : callable
        Draws them: run and table to figure.
    """

    name: str
    title: str
    caption: str
    needs: tuple[Topic, ...]
    table: Callable[[RunData], Table]
    draw: Callable[[RunData, Table], Any]


@dataclass(frozen=True)
class Drawn:
    """A figure that was drawn, and its numbers."""

    name: str
    title: str
    caption: str
    png: bytes
    table: Table


def draw_figures(run: RunData) -> list[Drawn]:
    """Draw every figure for which the recording has what it needs."""
    drawn = []
    for figure in FIGURES:
        if not all(topic in run.series for topic in figure.needs):
            continue
        table = figure.table(run)
        if all(np.size(column) for column in table.values()):
            png = png_of(figure.draw(run, table))
            drawn.append(Drawn(figure.name, figure.title, figure.caption, png, table))
    return drawn


def _draw_planes(axes: Any, table: Table, first: str, second: str, label: str) -> None:
    """Draw the columns of both planes against time."""
    axes.margins(x=0.0)
    for name, style in ((second, PLANES[1]), (first, PLANES[0])):
        axes.plot(table['time_s'], table[name], **style)
    axes.set_ylabel(label)
    tidy(axes)


def _shade_calibration(run: RunData, axes: Any) -> None:
    for each in run.states:
        if each.state == DriveState.CALIBRATION:
            axes.axvspan(each.start, each.end, color=GRAY, alpha=0.12, linewidth=0.0)


def _widen(axes: Any, least: float) -> None:
    """Let the vertical axis span at least so much: what hardly changes is shown as such."""
    low, high = axes.get_ylim()
    middle, half = (low + high) / 2.0, max(high - low, least) / 2.0
    axes.set_ylim(middle - half, middle + half)


def _draw_motion(run: RunData, table: Table) -> Any:
    figure = new_figure(_WIDTH, 5.0)
    rows = figure.subplots(2, 1, sharex=True)
    _draw_planes(rows[0], table, 'position_x_cm', 'position_y_cm', 'position [cm]')
    _draw_planes(rows[1], table, 'pitch_x_deg', 'pitch_y_deg', 'body pitch [°]')
    for axes in rows:
        _shade_calibration(run, axes)
    legend_above(rows[0])
    rows[1].set_xlabel('time [s]')
    return figure


def draw_map(grid: OccupancyGrid | None, axes: Any) -> None:
    """Draw the walls of the recorded map in gray, if there is one."""
    if grid is None:
        return
    height, width = grid.cells.shape
    left, low = (edge * 100.0 for edge in grid.origin)
    cell = grid.resolution * 100.0
    walls = np.ma.masked_less(grid.cells, 50)
    axes.imshow(
        walls, cmap='gray', vmin=0, vmax=200, origin='lower', interpolation='nearest',
        extent=(left, left + width * cell, low, low + height * cell),
    )  # fmt: skip


def label_track(axes: Any) -> None:
    """Make the axes those of the floor seen from above."""
    axes.set_aspect('equal', adjustable='datalim')
    axes.set_xlabel('x of map, forward [cm]')
    axes.set_ylabel('y of map, left [cm]')
    tidy(axes)


def _draw_track(run: RunData, table: Table) -> Any:
    figure = new_figure(_WIDTH, 5.0)
    axes = figure.subplots()
    draw_map(run.grid, axes)
    x, y = table['map_x_cm'], table['map_y_cm']
    axes.plot(x, y, color=BLUE, linewidth=1.4)
    axes.plot(x[0], y[0], marker='o', color=GRAY, linestyle='', markersize=8, label='start')
    axes.plot(x[-1], y[-1], marker='s', color=ORANGE, linestyle='', markersize=5, label='end')
    label_track(axes)
    legend_above(axes)
    return figure


def _draw_duty(run: RunData, table: Table) -> Any:
    figure = new_figure(_WIDTH, 2.8)
    axes = figure.subplots()
    _draw_planes(axes, table, 'duty_x_percent', 'duty_y_percent', 'duty [%]')
    for bound in (-100.0, 100.0):
        axes.axhline(bound, color=GRAY, linewidth=0.8, linestyle=':')
    _shade_calibration(run, axes)
    legend_above(axes)
    axes.set_xlabel('time [s]')
    return figure


def _draw_pairs(run: RunData, table: Table, rows: Any, share: str) -> Any:
    """Draw pairs of a true and an estimated column: a row a quantity, a column a plane."""
    figure = new_figure(_WIDTH, 5.0)
    grid = figure.subplots(2, 2, sharex=True, sharey=share)
    for line, (true, other, label, name) in zip(grid, rows, strict=True):
        for axes, plane in zip(line, 'xy', strict=True):
            time = table['time_s']
            axes.margins(x=0.0)
            axes.plot(time, table[true.format(plane)], color=ORANGE, linewidth=2.2, label='true')
            axes.plot(time, table[other.format(plane)], color=BLUE, linewidth=0.9, linestyle='--',
                      label=name)  # fmt: skip
            _shade_calibration(run, axes)
            tidy(axes)
        for axes in line:  # both planes may share an axis, which stays as it is set
            _widen(axes, LEAST_SPAN)
        line[0].set_ylabel(label)
        legend_above(line[1])
    for axes, plane in zip(grid[0], 'xy', strict=True):
        axes.set_title(f'plane {plane}', loc='left')
    for axes in grid[1]:
        axes.set_xlabel('time [s]')
    return figure


def _draw_estimate(run: RunData, table: Table) -> Any:
    return _draw_pairs(
        run,
        table,
        (
            ('true_pitch_{}_deg', 'estimated_pitch_{}_deg', 'body pitch [°]', 'estimated'),
            ('true_position_{}_cm', 'estimated_position_{}_cm', 'position [cm]', 'estimated'),
        ),
        'row',
    )


def _draw_gyro(run: RunData, table: Table) -> Any:
    return _draw_pairs(
        run,
        table,
        (
            (
                'true_rate_{}_deg_s',
                'read_rate_{}_deg_s',
                'pitch rate [°/s]',
                'reading − offset',
            ),
            ('true_offset_{}_deg_s', 'estimated_offset_{}_deg_s', 'gyro offset [°/s]', 'estimated'),
        ),
        'none',  # each gyro has an offset of its own
    )


def _draw_sonar(run: RunData, table: Table) -> Any:
    figure = new_figure(_WIDTH, 2.8)
    axes = figure.subplots()
    time, distance = table['time_s'], table['distance_cm']
    silent = np.isinf(distance)
    axes.margins(x=0.0)
    heard = np.isfinite(distance)
    axes.plot(time[heard], distance[heard], '.', color=BLUE, markersize=3.0, label='echo')
    axes.plot(time[silent], np.full(silent.sum(), 255.0), '|', color=ORANGE, markersize=4.0,
              label='no echo')  # fmt: skip
    axes.set_ylim(0.0, 270.0)
    axes.set_ylabel('distance [cm]')
    axes.set_xlabel('time [s]')
    tidy(axes)
    legend_above(axes)
    return figure


def _draw_battery(run: RunData, table: Table) -> Any:
    figure = new_figure(_WIDTH, 2.4)
    axes = figure.subplots()
    axes.margins(x=0.0)
    axes.plot(table['time_s'], table['voltage_v'], color=BLUE, linewidth=1.2)
    _widen(axes, 0.5)
    axes.set_ylabel('battery [V]')
    axes.set_xlabel('time [s]')
    tidy(axes)
    return figure


def _draw_states(run: RunData, table: Table) -> Any:
    known = [state.value for state in DriveState]
    present = [state for state in known if state in table['state']]
    present += sorted(set(table['state'].tolist()) - set(present))
    figure = new_figure(_WIDTH, 1.1 + 0.32 * len(present))
    axes = figure.subplots()
    for each in run.states:
        look = known.index(each.state) if each.state in known else 0
        # A band of its own for each state: its name stands beside it, with or without colour.
        axes.barh(
            present.index(each.state), each.end - each.start, left=each.start, height=0.7,
            color=_STATE_COLOURS[look], hatch=_HATCHES[look], edgecolor='white', linewidth=0.0,
        )  # fmt: skip
    axes.set_yticks(range(len(present)), [state.replace('_', ' ') for state in present])
    axes.invert_yaxis()
    axes.set_xlim(0.0, max(run.end, float(table['end_s'][-1])))
    axes.set_ylabel('operating state')
    axes.set_xlabel('time [s]')
    tidy(axes)
    return figure


FIGURES = (
    RunFigure(
        'motion',
        'Position and body pitch',
        'Position of the ball and body pitch against time, as figures 8-2, 8-3, 9-2 and 9-3 of the '
        'document; forward and rightward are positive. The gyro calibration is shaded.',
        (PLANT_ODOM, PLANT_IMU),
        motion_table,
        _draw_motion,
    ),
    RunFigure(
        'track',
        'Track',
        'The way of the ball from above, over the walls of the map where one was recorded.',
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
        'The duties of both motors against time; at the dotted lines they are saturated.',
        (MOTOR_DUTY,),
        duty_table,
        _draw_duty,
    ),
    RunFigure(
        'estimate',
        'Estimated and true state',
        'Body pitch and position as the controller estimates them, beside the truth. It estimates '
        'from the end of the calibration on.',
        (PLANT_IMU, PLANT_ODOM, CONTROLLER_STATE),
        estimate_table,
        _draw_estimate,
    ),
    RunFigure(
        'gyro',
        'Gyro',
        'Above: the gyro less the offset that the controller estimates, beside the true pitch '
        'rate. Below: that offset beside the true one, the 1 s mean of reading less true rate.',
        (GYRO_IMU, PLANT_IMU, CONTROLLER_STATE),
        gyro_table,
        _draw_gyro,
    ),
    RunFigure(
        'sonar',
        'Ultrasonic sensor',
        'The distance that the sensor reads against time.',
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
"""The figures of a report, in its order."""
