"""The figures of a report: their numbers, required topics and drawing."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ballbot_ros.analysis import drawing
from ballbot_ros.analysis.figure_parts import (
    BLUE,
    GRAY,
    WIDTH,
    Curve,
    Line,
    Panel,
    Role,
    Table,
    envelope,
    every_nth,
    new_figure,
    panel_of_planes,
    plane_columns,
    png_of,
    track_columns,
    with_earlier,
)
from ballbot_ros.analysis.processor import ended, pieces, utilisation
from ballbot_ros.analysis.run_data import RunData, Series
from ballbot_ros.analysis.run_metrics import (
    ball_speed,
    commanded_speed,
    estimated_gyro_offset,
    estimated_pitch,
    estimated_position,
    reference_position,
    reference_speed,
    true_gyro_offset,
)
from ballbot_ros.controllers.interface import OperatingState
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.timing import TICK_S
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
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.brick.job_times import bus_share, kernel_constants

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
    if run.is_real:
        figures = (*ESTIMATED_FIGURES, *figures)
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
    return drawing.draw_rows([each.row(table) for each in panels], run.marked)


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


def track_marks(run: RunData) -> list[drawing.TrackMark]:
    """Return where the body hit walls, and where pushes began."""
    if PLANT_ODOM not in run.series:
        return []
    odometry = run.series[PLANT_ODOM]
    marked = [each for each in run.marked if each.kind in drawing.TRACK_MARKERS]
    rows = np.searchsorted(odometry.time, [each.start for each in marked])
    track = track_columns(odometry.values[rows.clip(max=len(odometry.time) - 1)])
    return list(map(drawing.TrackMark, marked, *(column.tolist() for column in track.values())))


def _draw_track(run: RunData, table: Table, _panels: Sequence[Panel]) -> Figure:
    return drawing.draw_tracks([(table, Line(BLUE))], run.floor, track_marks(run))


def _draw_by_plane(
    run: RunData, table: Table, panels: Sequence[Panel], *, share_rows: bool = True
) -> Figure:
    """Draw panels one above the other, with a column for each plane."""
    figure = new_figure(WIDTH, 5.0)
    grid = figure.subplots(len(panels), 2, sharex=True, sharey='row' if share_rows else 'none')
    for line, panel in zip(grid, panels, strict=True):
        for axes, plane in zip(line, 'xy', strict=True):
            curves = tuple(each for each in panel.curves if each.plane == plane)
            drawing.draw_row(axes, replace(panel, label='', curves=curves).row(table, Curve.line))
            drawing.shade_intervals(axes, run.marked)
        for axes in line:  # after all curves of the row: setting the span ends autoscaling
            drawing.set_min_span(axes, panel.min_span)
        line[0].set_ylabel(panel.label)
        drawing.legend_above(line[1])
    for axes, plane in zip(grid[0], 'xy', strict=True):
        axes.set_title(f'plane {plane}', loc='left')
    for axes in grid[1]:
        drawing.label_time(axes)
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
            color=drawing.STATE_COLOURS.get(each.name, GRAY), hatch=hatch, edgecolor='white',
            linewidth=0.0,
        )  # fmt: skip
    axes.set_yticks(range(len(present)), [state.replace('_', ' ') for state in present])
    axes.invert_yaxis()
    axes.set_xlim(0.0, max(run.end, float(table['end_s'][-1])))
    axes.set_ylabel('operating state')
    drawing.label_time(axes)
    drawing.style_axes(axes)
    return figure


def _table(series: Series, name: str, unit: str, values: Floats) -> Table:
    return envelope(series.time, plane_columns(name, unit, values))


def position_table(run: RunData) -> Table:
    """Return the true position [cm]."""
    series = run.series[PLANT_ODOM]
    return envelope(series.time, drawing.POSITION.columns(series.values * 100.0))


def pitch_table(run: RunData) -> Table:
    """Return the true body pitch [°]."""
    series = run.series[PLANT_IMU]
    return envelope(series.time, drawing.PITCH.columns(np.degrees(series.values[:, :2])))


def track_table(run: RunData) -> Table:
    """Return the track of the ball in ``map`` [cm], of a real robot as estimated."""
    if run.is_real:
        return every_nth(run.motion.time, track_columns(run.motion.position))
    series = run.series[PLANT_ODOM]
    return every_nth(series.time, track_columns(series.values))


def duty_table(run: RunData) -> Table:
    """Return the duties [%]."""
    series = run.series[MOTOR_DUTY]
    return envelope(series.time, drawing.DUTY.columns(series.values[:, :2]))


def motion_table(run: RunData) -> Table:
    """Return position [cm] and body pitch [°] at ticks that have both."""
    odometry, body = run.series[PLANT_ODOM], run.series[PLANT_IMU]
    if np.array_equal(odometry.stamps, body.stamps):
        return {**position_table(run), **pitch_table(run)}
    stamps = np.intersect1d(odometry.stamps, body.stamps)
    time = odometry.time[np.isin(odometry.stamps, stamps)]
    position, pitch = odometry.at(stamps) * 100.0, np.degrees(body.at(stamps)[:, :2])
    return envelope(time, drawing.POSITION.columns(position) | drawing.PITCH.columns(pitch))


def estimated_motion_table(
    run: RunData,
    position: drawing.Quantity = drawing.ESTIMATED_POSITION,
    pitch: drawing.Quantity = drawing.ESTIMATED_PITCH,
) -> Table:
    """Return position [cm] and body pitch [°] of a real robot, as estimated."""
    motion = run.motion
    columns = position.columns(motion.position * 100.0) | pitch.columns(np.degrees(motion.psi))
    return envelope(motion.time, columns)


def estimate_table(run: RunData) -> Table:
    """Return true and estimated pitch [°] and position [cm]."""
    body = run.series[PLANT_IMU]
    # Reduce one quantity after the other: for an hour, the ticks of all would take 60 MB.
    table = dict(_table(body, 'true_pitch', 'deg', np.degrees(body.values[:, :2])))
    table |= _table(body, 'estimated_pitch', 'deg', np.degrees(estimated_pitch(run, body.stamps)))
    table |= _table(body, 'true_position', 'cm', run.series[PLANT_ODOM].at(body.stamps) * 100.0)
    believed = estimated_position(run, body.stamps)
    table |= _table(body, 'estimated_position', 'cm', believed * 100.0)
    return table


def command_table(run: RunData) -> Table:
    """Return commanded, reference and true speed [cm/s], and reference and true position [cm].

    It is empty if the controller publishes no reference.
    """
    truth = run.series[PLANT_ODOM]
    stamps = truth.stamps
    reference = reference_speed(run, stamps)
    if np.isnan(reference).all():
        return {'time_s': np.zeros(0)}
    table = dict(_table(truth, 'reference_speed', 'cm_per_s', reference * 100.0))
    del reference  # reduce one quantity after the other, as in estimate_table
    table |= _table(truth, 'commanded_speed', 'cm_per_s', commanded_speed(run, stamps) * 100.0)
    table |= _table(truth, 'true_speed', 'cm_per_s', ball_speed(run) * 100.0)
    table |= _table(truth, 'reference_position', 'cm', reference_position(run, stamps) * 100.0)
    table |= _table(truth, 'true_position', 'cm', truth.values * 100.0)
    return table


def gyro_table(run: RunData) -> Table:
    """Return true rate, reading minus offset, true and estimated offset [°/s]."""
    gyro = run.series[GYRO_IMU]
    rates = run.series[PLANT_IMU].at(gyro.stamps)[:, 2:]
    table = dict(_table(gyro, 'true_rate', 'deg_per_s', np.degrees(rates)))
    offset = estimated_gyro_offset(run)
    table |= _table(gyro, 'read_rate', 'deg_per_s', np.degrees(gyro.values) - offset)
    table |= _table(gyro, 'true_offset', 'deg_per_s', true_gyro_offset(run))
    table |= _table(gyro, 'estimated_offset', 'deg_per_s', offset)
    return table


def sonar_table(run: RunData) -> Table:
    """Return the measured distances [cm]; infinite for no echo."""
    series = run.series[SONAR_RANGE]
    distance = series.values[:, 0].astype(float) * 100.0
    return every_nth(series.time, {'distance_cm': distance})


def sticks_table(run: RunData) -> Table:
    """Return the sticks [%], forward and rightward positive; empty if they are never moved."""
    series = run.series[GAMEPAD_JOY]
    sticks = np.rint(series.values * 100.0) + 0.0
    if not sticks.any():
        return {'time_s': np.zeros(0)}
    return _table(series, 'stick', 'percent', sticks)


def battery_table(run: RunData) -> Table:
    """Return the voltage [V]."""
    series = run.series[BATTERY_STATE]
    return envelope(series.time, {'voltage_v': series.values[:, 0]})


def utilisation_table(run: RunData) -> Table:
    """Return the utilisation of the processor [%] in each 100 ms; empty if tasks take no time."""
    parameters = run.attached.parameters.of(ControllerParameters)
    if run.jobs is None or not parameters.kernel:
        return {'time_s': np.zeros(0)}
    interrupt_us = kernel_constants(parameters).interrupt_us
    # The jobs after the last whole 100 ms are not recorded.
    edges_ms = np.arange(0, round((run.end + TICK_S) * 1e3) + 1, 100)
    edges = run.start_ns // 1000 + 1000 * edges_ms
    parts, bus = pieces(ended(run.jobs), interrupt_us), bus_share(parameters)
    shares = utilisation(parts, edges, bus, interrupt_us)
    return envelope(edges_ms[:-1] * 1e-3 + 0.05, {'utilisation_percent': 100.0 * shares})


def state_table(run: RunData) -> Table:
    """Return the operating states and their times [s]."""
    return {
        'start_s': np.array([each.start for each in run.states]),
        'end_s': np.array([each.end for each in run.states]),
        'state': np.array([each.name for each in run.states]),
    }


def _panel(label: str, column: str, *roles: Role) -> Panel:
    """Return a panel of both planes with a column for each role, which it begins with."""
    names = [f'{"read" if role is Role.READING else role.label}_{column}' for role in roles]
    return panel_of_planes(label, zip(roles, names, strict=True), min_span=MIN_AXIS_SPAN)


FIGURES = (
    RunFigure(
        'motion',
        'Position and body pitch',
        "Position of the ball, from the map's origin, and body pitch against time, as in figures "
        '8-2, 8-3, 9-2 and 9-3 of the document; forward and rightward are positive. Calibration, '
        'pushes and wall hits are shaded.',
        (PLANT_ODOM, PLANT_IMU),
        motion_table,
        (drawing.POSITION.panel, drawing.PITCH.panel),
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
        (replace(drawing.DUTY.panel, limits=(-100.0, 100.0)),),
    ),
    RunFigure(
        'sticks',
        'Sticks',
        'The sticks of the gamepad against time; forward and rightward are positive.',
        (GAMEPAD_JOY,),
        sticks_table,
        (panel_of_planes('sticks [%]', [(Role.TRUE, 'stick_{}_percent')]),),
    ),
    RunFigure(
        'command',
        'Commanded and actual motion',
        'Speed and position of the ball. The command of the sticks, or of the autonomous drive, '
        'passes a low pass in the controller, whose output is the reference that it follows.',
        (PLANT_ODOM, CONTROLLER_STATE),
        command_table,
        (
            _panel('speed [cm/s]', 'speed_{}_cm_per_s', Role.TRUE, Role.COMMANDED, Role.REFERENCE),
            _panel(drawing.POSITION.label, 'position_{}_cm', Role.TRUE, Role.REFERENCE),
        ),
        _draw_by_plane,
    ),
    RunFigure(
        'estimate',
        'Estimated and true state',
        'Body pitch and position as estimated by the controller, and their true values. The '
        'estimates start at the end of the calibration.',
        (PLANT_IMU, PLANT_ODOM, CONTROLLER_STATE),
        estimate_table,
        (
            _panel(drawing.PITCH.label, 'pitch_{}_deg', Role.TRUE, Role.ESTIMATED),
            _panel(drawing.POSITION.label, 'position_{}_cm', Role.TRUE, Role.ESTIMATED),
        ),
        _draw_by_plane,
    ),
    RunFigure(
        'gyro',
        'Gyro',
        'Above: gyro reading minus the estimated offset, and the true pitch rate. Below: the '
        'estimated offset and the true one, which is the 1 s mean of reading minus true rate.',
        (GYRO_IMU, PLANT_IMU, CONTROLLER_STATE),
        gyro_table,
        (
            _panel('pitch rate [°/s]', 'rate_{}_deg_per_s', Role.TRUE, Role.READING),
            _panel('gyro offset [°/s]', 'offset_{}_deg_per_s', Role.TRUE, Role.ESTIMATED),
        ),
        # The planes do not share an axis, since their gyros have different offsets.
        partial(_draw_by_plane, share_rows=False),
    ),
    RunFigure(
        'sonar',
        'Ultrasonic sensor',
        'The distance measured by the sensor, against time.',
        (SONAR_RANGE,),
        sonar_table,
        (
            Panel(
                'distance [cm]',
                (Curve('distance_cm', Role.ECHO), Curve('distance_cm', Role.NO_ECHO)),
                bounds=(0.0, 270.0),
            ),
        ),
    ),
    RunFigure(
        'battery',
        'Battery',
        'Terminal voltage of the battery against time.',
        (BATTERY_STATE,),
        battery_table,
        (Panel('battery [V]', (Curve('voltage_v', Role.MEASURED),), min_span=0.5),),
    ),
)
"""The figures of a report, in order."""

_MOTION, _TRACK, *_ = FIGURES
ESTIMATED_FIGURES = (
    replace(
        _MOTION,
        title=f'Estimated {_MOTION.title.lower()}',
        caption="In the estimate of the real robot's controller, as in figures 9-2 and 9-3 of the "
        'document. The drift of a gyro and the slip of the ball do not show in it.',
        needs=(CONTROLLER_STATE,),
        table=estimated_motion_table,
        panels=(drawing.ESTIMATED_POSITION.panel, drawing.ESTIMATED_PITCH.panel),
    ),
    replace(_TRACK, title='Estimated track', needs=(CONTROLLER_STATE,)),
)
"""The figures of a real robot's motion, whose true one is unknown."""

UTILISATION = RunFigure(
    'utilisation',
    'Utilisation of the processor',
    "The share of the brick's processor that jobs, interrupts and the bus take in each 100 ms.",
    (MOTOR_DUTY,),
    utilisation_table,
    (Panel('processor [%]', (Curve('utilisation_percent', Role.MEASURED),), bounds=(0.0, 100.0)),),
)
"""The figure of a run whose tasks take time."""
