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
    POINTS,
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
    png_of,
    track_columns,
    with_earlier,
)
from ballbot_ros.analysis.panels import (
    BATTERY,
    DUTY,
    PITCH,
    POSITION,
    SPEED,
    STICKS,
    TRUE_PITCH,
    TRUE_POSITION,
)
from ballbot_ros.analysis.processor import ended, pieces, utilisation
from ballbot_ros.analysis.run_data import Integers, RunData
from ballbot_ros.analysis.run_metrics import estimated_gyro_offset, true_gyro_offset
from ballbot_ros.analysis.signals import SIGNALS, Signal
from ballbot_ros.controllers.interface import OperatingState
from ballbot_ros.engine.rows import Column
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
    shown = [each for each in contents if each.figure.says_something(each.table)]
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

    It `needs` topics and draws a table of numbers. Its `panels` are what it shows against time:
    their signals, at the samples of the first of these topics, are the numbers, unless `numbers`
    makes others. It is left out if its numbers are not `worth_showing`.
    """

    name: str
    title: str
    caption: str
    needs: tuple[Topic, ...]
    panels: tuple[Panel, ...] = ()
    draw: Callable[[RunData, Table, Sequence[Panel]], Figure] = _draw_stacked
    numbers: Callable[[RunData], Table] | None = None
    worth_showing: Callable[[Table], bool] = lambda table: True

    def table(self, run: RunData) -> Table:
        """Return its numbers."""
        if self.numbers:
            return self.numbers(run)
        samples, table = run.series[self.needs[0]], dict[str, Column]()
        curves = [curve for panel in self.panels for curve in panel.curves]
        wanted = {each.column for each in curves}
        reduced = every_nth if any(each.role.dash in POINTS for each in curves) else envelope
        for signal in (*SIGNALS, *_GYRO_SIGNALS):
            if not wanted.isdisjoint(signal.columns):
                # One after the other: for an hour, the ticks of all would take 60 MB.
                table |= reduced(samples.time, signal.table(run, samples.stamps))
        return table

    def says_something(self, table: Table) -> bool:
        """Return whether the numbers of a run are worth a figure."""
        return all(map(np.size, table.values())) and self.worth_showing(table)


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
            own = replace(panel.of_plane(plane), label='')
            drawing.draw_row(axes, own.row(table, Curve.line))
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


def track_table(run: RunData) -> Table:
    """Return the track of the ball in ``map`` [cm], of a real robot as estimated."""
    return every_nth(run.motion.time, track_columns(run.motion.position))


def _rate_read(run: RunData, stamps: Integers) -> Floats:
    gyro = run.series[GYRO_IMU]
    rates = np.degrees(gyro.values) - estimated_gyro_offset(run)
    return replace(gyro, values=rates).at(stamps)


def _true_offset(run: RunData, stamps: Integers) -> Floats:
    return replace(run.series[GYRO_IMU], values=true_gyro_offset(run)).at(stamps)


_GYRO_SIGNALS = (
    Signal('rate_read', 'deg_per_s', _rate_read, (GYRO_IMU, CONTROLLER_STATE)),
    Signal('true_gyro_offset', 'deg_per_s', _true_offset, (GYRO_IMU, PLANT_IMU)),
)
"""What only the figure of the gyro shows."""


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


def _spanned(panel: Panel, *roles: Role) -> Panel:
    """Return curves of a panel whose axis does not magnify noise."""
    return replace(panel.only(*roles), min_span=MIN_AXIS_SPAN)


def _has_reference(table: Table) -> bool:
    return not np.isnan(table['reference_speed_x_m_per_s']).all()


def _are_moved(table: Table) -> bool:
    return any(table[f'stick_{plane}_percent'].any() for plane in 'xy')


FIGURES = (
    RunFigure(
        'motion',
        'Position and body pitch',
        "Position of the ball, from the map's origin, and body pitch against time, as in figures "
        '8-2, 8-3, 9-2 and 9-3 of the document; forward and rightward are positive. Calibration, '
        'pushes and wall hits are shaded.',
        (PLANT_ODOM, PLANT_IMU),
        (TRUE_POSITION, TRUE_PITCH),
    ),
    RunFigure(
        'track',
        'Track',
        'The track of the ball from above, over walls and lines of the recorded map, if any; y of '
        'map is leftward.',
        (PLANT_ODOM,),
        draw=_draw_track,
        numbers=track_table,
    ),
    RunFigure(
        'operating_state',
        'Operating state',
        'The state of the control program against time.',
        (),
        draw=_draw_states,
        numbers=state_table,
    ),
    RunFigure(
        'duty',
        'Duty',
        'The duties of both motors against time; the dotted lines are the saturation limits.',
        (MOTOR_DUTY,),
        (replace(DUTY, limits=(-100.0, 100.0)),),
    ),
    RunFigure(
        'sticks',
        'Sticks',
        'The sticks of the gamepad against time; forward and rightward are positive.',
        (GAMEPAD_JOY,),
        (STICKS,),
        worth_showing=_are_moved,
    ),
    RunFigure(
        'command',
        'Commanded and actual motion',
        'Speed and position of the ball. The command of the sticks, or of the autonomous drive, '
        'passes a low pass in the controller, whose output is the reference that it follows.',
        (PLANT_ODOM, CONTROLLER_STATE),
        (
            _spanned(SPEED, Role.TRUE, Role.COMMANDED, Role.REFERENCE),
            _spanned(POSITION, Role.TRUE, Role.REFERENCE),
        ),
        _draw_by_plane,
        worth_showing=_has_reference,
    ),
    RunFigure(
        'estimate',
        'Estimated and true state',
        'Body pitch and position as estimated by the controller, and their true values. The '
        'estimates start at the end of the calibration.',
        (PLANT_IMU, PLANT_ODOM, CONTROLLER_STATE),
        (
            _spanned(PITCH, Role.TRUE, Role.ESTIMATED),
            _spanned(POSITION, Role.TRUE, Role.ESTIMATED),
        ),
        _draw_by_plane,
    ),
    RunFigure(
        'gyro',
        'Gyro',
        'Above: gyro reading minus the estimated offset, and the true pitch rate. Below: the '
        'estimated offset and the true one, which is the 1 s mean of reading minus true rate.',
        (GYRO_IMU, PLANT_IMU, CONTROLLER_STATE),
        (
            panel_of_planes(
                'pitch rate [°/s]',
                [(Role.TRUE, 'pitch_rate_{}_deg_per_s'), (Role.READING, 'rate_read_{}_deg_per_s')],
                min_span=MIN_AXIS_SPAN,
            ),
            panel_of_planes(
                'gyro offset [°/s]',
                [
                    (Role.TRUE, 'true_gyro_offset_{}_deg_per_s'),
                    (Role.ESTIMATED, 'estimated_gyro_offset_{}_deg_per_s'),
                ],
                min_span=MIN_AXIS_SPAN,
            ),
        ),
        # The planes do not share an axis, since their gyros have different offsets.
        partial(_draw_by_plane, share_rows=False),
    ),
    RunFigure(
        'sonar',
        'Ultrasonic sensor',
        'The distance measured by the sensor, against time.',
        (SONAR_RANGE,),
        (
            Panel(
                'distance [cm]',
                (Curve('distance_m', Role.ECHO), Curve('distance_m', Role.NO_ECHO)),
                bounds=(0.0, 270.0),
                scale=100.0,
            ),
        ),
    ),
    RunFigure(
        'battery',
        'Battery',
        'Terminal voltage of the battery against time.',
        (BATTERY_STATE,),
        (BATTERY,),
    ),
)
"""The figures of a report, in order."""


def _of_estimates(panel: Panel) -> Panel:
    """Return a panel that shows the estimates as the motion of a real robot."""
    curves = (replace(each, role=Role.TRUE) for each in panel.only(Role.ESTIMATED).curves)
    return replace(panel, label=f'estimated {panel.label}', curves=tuple(curves))


_MOTION, _TRACK, *_ = FIGURES
ESTIMATED_FIGURES = (
    replace(
        _MOTION,
        title=f'Estimated {_MOTION.title.lower()}',
        caption="In the estimate of the real robot's controller, as in figures 9-2 and 9-3 of the "
        'document. The drift of a gyro and the slip of the ball do not show in it.',
        needs=(CONTROLLER_STATE,),
        panels=(_of_estimates(POSITION), _of_estimates(PITCH)),
    ),
    replace(_TRACK, title='Estimated track', needs=(CONTROLLER_STATE,)),
)
"""The figures of a real robot's motion, whose true one is unknown."""

UTILISATION = RunFigure(
    'utilisation',
    'Utilisation of the processor',
    "The share of the brick's processor that jobs, interrupts and the bus take in each 100 ms.",
    (MOTOR_DUTY,),
    (Panel('processor [%]', (Curve('utilisation_percent', Role.MEASURED),), bounds=(0.0, 100.0)),),
    numbers=utilisation_table,
)
"""The figure of a run whose tasks take time."""
