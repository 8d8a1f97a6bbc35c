"""The figures of a report: content, required topics and drawing."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ballbot_ros.analysis.drawing import (
    DUTY,
    PITCH,
    POSITION,
    STATE_COLOURS,
    TRACK_MARKERS,
    TrackMark,
    draw_floor,
    draw_marks,
    draw_row,
    draw_rows,
    draw_track,
    label_time,
    legend_above,
    set_min_span,
    shade_intervals,
    style_axes,
)
from ballbot_ros.analysis.figure_parts import (
    BLUE,
    COMMANDED,
    ECHO,
    ESTIMATED,
    GRAY,
    MEASURED,
    NO_ECHO,
    READING,
    REFERENCE,
    TRUE,
    WIDTH,
    Curve,
    Interval,
    Line,
    Panel,
    Table,
    new_figure,
    panel_of_planes,
    png_of,
    track_columns,
    with_earlier,
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
    sticks_table,
    track_table,
    utilisation_table,
)
from ballbot_ros.analysis.run_data import RunData, Series
from ballbot_ros.controllers.interface import OperatingState
from ballbot_ros.recording.messages.topics import (
    BATTERY_STATE,
    CONTROLLER_STATE,
    GAMEPAD_JOY,
    GYRO_IMU,
    MOTOR_DUTY,
    PLANT_IMU,
    PLANT_ODOM,
    SONAR_RANGE,
    Topic,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HATCHES = ('', '', '//', '..', 'xx', '\\\\', '++')

MIN_AXIS_SPAN = 1.0
"""Minimum span of an axis [°, cm, cm/s or °/s]; one gyro count is 1 °/s."""


@dataclass(frozen=True)
class RenderedFigure:
    """A drawn figure and its numbers."""

    name: str
    title: str
    caption: str
    png: bytes
    table: Table


class FigureContent(NamedTuple):
    """A figure of a run and its numbers."""

    figure: RunFigure
    table: Table


def figure_contents(run: RunData, earlier: RunData | None = None) -> list[FigureContent]:
    """Return every figure for which the recording has the topics and something to show.

    Motion and duty also show those of an `earlier` run, of which it is a branch.
    """
    figures = FIGURES if run.jobs is None else (*FIGURES, UTILISATION)
    usable = [figure for figure in figures if run.series.keys() >= set(figure.needs)]
    contents = (FigureContent(figure, figure.table(run)) for figure in usable)
    shown = [each for each in contents if all(map(np.size, each.table.values()))]
    if earlier is None:
        return shown
    return [_with_earlier(each, earlier) for each in shown]


def _with_earlier(content: FigureContent, earlier: RunData) -> FigureContent:
    figure, table = content
    if figure.name not in ('motion', 'duty') or not earlier.series.keys() >= set(figure.needs):
        return content
    panels, both = with_earlier(figure.panels, table, figure.table(earlier))
    return FigureContent(replace(figure, panels=panels), both)


def draw_figures(run: RunData, contents: Iterable[FigureContent]) -> list[RenderedFigure]:
    """Draw figures of a run as pictures."""
    drawn = []
    for figure, table in contents:
        png = png_of(figure.draw(run, table, figure.panels))
        drawn.append(RenderedFigure(figure.name, figure.title, figure.caption, png, table))
    return drawn


def _draw_stacked(run: RunData, table: Table, panels: Sequence[Panel]) -> Figure:
    """Draw panels of both planes, one above the other."""
    return draw_rows([each.row(table) for each in panels], run.marked)


@dataclass(frozen=True)
class RunFigure:
    """A figure of a run: its file name without extension, heading and caption.

    It `needs` topics, makes its numbers from a run as a table, and draws them. Its `panels` are
    what it shows against time.
    """

    name: str
    title: str
    caption: str
    needs: tuple[Topic, ...]
    table: Callable[[RunData], Table]
    panels: tuple[Panel, ...] = ()
    draw: Callable[[RunData, Table, Sequence[Panel]], Figure] = _draw_stacked


def track_marks(run: RunData) -> list[TrackMark]:
    """Return where the body hit walls, and where pushes began."""
    if PLANT_ODOM not in run.series:
        return []
    return [
        _mark(run.series[PLANT_ODOM], each) for each in run.marked if each.kind in TRACK_MARKERS
    ]


def _mark(odometry: Series, interval: Interval) -> TrackMark:
    row = min(int(np.searchsorted(odometry.time, interval.start)), len(odometry.time) - 1)
    track = track_columns(odometry.values[row : row + 1])
    return TrackMark(interval, float(track['map_x_cm'][0]), float(track['map_y_cm'][0]))


def _draw_track(run: RunData, table: Table, _panels: Sequence[Panel]) -> Figure:
    figure = new_figure(WIDTH, 5.0)
    axes = figure.subplots()
    draw_floor(axes, run.floor)
    draw_track(axes, table, Line(BLUE))
    draw_marks(axes, track_marks(run))
    legend_above(axes, 4)
    return figure


def _draw_by_plane(
    run: RunData, table: Table, panels: Sequence[Panel], *, share_rows: bool = True
) -> Figure:
    """Draw panels one above the other, with a column for each plane."""
    figure = new_figure(WIDTH, 5.0)
    grid = figure.subplots(len(panels), 2, sharex=True, sharey='row' if share_rows else 'none')
    for line, panel in zip(grid, panels, strict=True):
        for axes, plane in zip(line, 'xy', strict=True):
            shown = replace(panel, label='').of_plane(plane)
            draw_row(axes, shown.row(table, Curve.line))
            shade_intervals(axes, run.marked)
        for axes in line:  # after all curves of the row: setting the span ends autoscaling
            set_min_span(axes, panel.min_span)
        line[0].set_ylabel(panel.label)
        legend_above(line[1])
    for axes, plane in zip(grid[0], 'xy', strict=True):
        axes.set_title(f'plane {plane}', loc='left')
    for axes in grid[1]:
        label_time(axes)
    return figure


def _draw_states(run: RunData, table: Table, _panels: Sequence[Panel]) -> Figure:
    known = [state.value for state in OperatingState]
    present = [state for state in known if state in table['state']]
    present += sorted(set(table['state'].tolist()) - set(present))
    figure = new_figure(WIDTH, 1.1 + 0.32 * len(present))
    axes = figure.subplots()
    for each in run.states:
        hatch = _HATCHES[known.index(each.name)] if each.name in known else ''
        # One band per state, with its name next to it, so that colour is not needed.
        axes.barh(
            present.index(each.name), each.end - each.start, left=each.start, height=0.7,
            color=STATE_COLOURS.get(each.name, GRAY), hatch=hatch, edgecolor='white', linewidth=0.0,
        )  # fmt: skip
    axes.set_yticks(range(len(present)), [state.replace('_', ' ') for state in present])
    axes.invert_yaxis()
    axes.set_xlim(0.0, max(run.end, float(table['end_s'][-1])))
    axes.set_ylabel('operating state')
    label_time(axes)
    style_axes(axes)
    return figure


_panel = partial(panel_of_planes, min_span=MIN_AXIS_SPAN)
_MOTION = POSITION.panel, PITCH.panel
_DUTY = (replace(DUTY.panel, limits=(-100.0, 100.0)),)
_STICKS = (panel_of_planes('sticks [%]', [(TRUE, 'stick_{}_percent')]),)
_COMMAND = (
    _panel(
        'speed [cm/s]',
        [
            (TRUE, 'true_speed_{}_cm_per_s'),
            (COMMANDED, 'commanded_speed_{}_cm_per_s'),
            (REFERENCE, 'reference_speed_{}_cm_per_s'),
        ],
    ),
    _panel(
        POSITION.label,
        [(TRUE, 'true_position_{}_cm'), (REFERENCE, 'reference_position_{}_cm')],
    ),
)
_ESTIMATE = (
    _panel(PITCH.label, [(TRUE, 'true_pitch_{}_deg'), (ESTIMATED, 'estimated_pitch_{}_deg')]),
    _panel(
        POSITION.label,
        [(TRUE, 'true_position_{}_cm'), (ESTIMATED, 'estimated_position_{}_cm')],
    ),
)
_GYRO = (
    _panel(
        'pitch rate [°/s]',
        [(TRUE, 'true_rate_{}_deg_per_s'), (READING, 'read_rate_{}_deg_per_s')],
    ),
    _panel(
        'gyro offset [°/s]',
        [(TRUE, 'true_offset_{}_deg_per_s'), (ESTIMATED, 'estimated_offset_{}_deg_per_s')],
    ),
)
_SONAR = (
    Panel(
        'distance [cm]',
        (Curve('distance_cm', ECHO), Curve('distance_cm', NO_ECHO)),
        bounds=(0.0, 270.0),
    ),
)
_PROCESSOR = (
    Panel('processor [%]', (Curve('utilisation_percent', MEASURED),), bounds=(0.0, 100.0)),
)
_BATTERY = (Panel('battery [V]', (Curve('voltage_v', MEASURED),), min_span=0.5),)


FIGURES = (
    RunFigure(
        'motion',
        'Position and body pitch',
        "Position of the ball, from the map's origin, and body pitch against time, as in figures "
        '8-2, 8-3, 9-2 and 9-3 of the document; forward and rightward are positive. Calibration, '
        'pushes and wall hits are shaded.',
        (PLANT_ODOM, PLANT_IMU),
        motion_table,
        _MOTION,
    ),
    RunFigure(
        'track',
        'Track',
        'The track of the ball from above, over walls and lines of the recorded map, if any; y of '
        'map is leftward.',
        (PLANT_ODOM,),
        track_table,
        draw=_draw_track,
    ),
    RunFigure(
        'operating_state',
        'Operating state',
        'The state of the control program against time.',
        (),
        state_table,
        draw=_draw_states,
    ),
    RunFigure(
        'duty',
        'Duty',
        'The duties of both motors against time; the dotted lines are the saturation limits.',
        (MOTOR_DUTY,),
        duty_table,
        _DUTY,
    ),
    RunFigure(
        'sticks',
        'Sticks',
        'The sticks of the gamepad against time; forward and rightward are positive.',
        (GAMEPAD_JOY,),
        sticks_table,
        _STICKS,
    ),
    RunFigure(
        'command',
        'Commanded and actual motion',
        'Speed and position of the ball. The command of the sticks, or of the autonomous drive, '
        'passes a low pass in the controller, whose output is the reference that it follows.',
        (PLANT_ODOM, CONTROLLER_STATE),
        command_table,
        _COMMAND,
        _draw_by_plane,
    ),
    RunFigure(
        'estimate',
        'Estimated and true state',
        'Body pitch and position as estimated by the controller, and their true values. The '
        'estimates start at the end of the calibration.',
        (PLANT_IMU, PLANT_ODOM, CONTROLLER_STATE),
        estimate_table,
        _ESTIMATE,
        _draw_by_plane,
    ),
    RunFigure(
        'gyro',
        'Gyro',
        'Above: gyro reading minus the estimated offset, and the true pitch rate. Below: the '
        'estimated offset and the true one, which is the 1 s mean of reading minus true rate.',
        (GYRO_IMU, PLANT_IMU, CONTROLLER_STATE),
        gyro_table,
        _GYRO,
        # The planes do not share an axis, since their gyros have different offsets.
        partial(_draw_by_plane, share_rows=False),
    ),
    RunFigure(
        'sonar',
        'Ultrasonic sensor',
        'The distance measured by the sensor, against time.',
        (SONAR_RANGE,),
        sonar_table,
        _SONAR,
    ),
    RunFigure(
        'battery',
        'Battery',
        'Terminal voltage of the battery against time.',
        (BATTERY_STATE,),
        battery_table,
        _BATTERY,
    ),
)
"""The figures of a report, in order."""

UTILISATION = RunFigure(
    'utilisation',
    'Utilisation of the processor',
    "The share of the brick's processor that jobs, interrupts and the bus take in each 100 ms.",
    (MOTOR_DUTY,),
    utilisation_table,
    _PROCESSOR,
)
"""The figure of a run whose tasks take time."""
