"""What a report says about the brick's processor: sentences, its timeline, and ages of values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ballbot_ros.analysis.drawing import label_time, style_axes
from ballbot_ros.analysis.figure_parts import (
    BLUE,
    GRAY,
    GREEN,
    ORANGE,
    PURPLE,
    WIDTH,
    Table,
    new_figure,
    png_of,
)
from ballbot_ros.analysis.interactive import GRID, Json, PackedNumbers, chart_layout
from ballbot_ros.analysis.processor import TaskTimes, ended, pieces, sets_duty, task_times
from ballbot_ros.analysis.run_data import Integers, RunData
from ballbot_ros.analysis.run_figures import RenderedFigure, utilisation_table
from ballbot_ros.engine.rows import Column
from ballbot_ros.engine.scenario.task_timing import DUTY_AGE_US, TICK_US
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.timing import TICK_NS
from ballbot_ros.recording.messages.jobs import Jobs
from ballbot_ros.recording.messages.topics import MOTOR_DUTY
from ballbot_ros.robot.brick.job_times import kernel_constants
from ballbot_ros.robot.brick.kernel import TICK_US as INTERRUPT_PERIOD_US
from ballbot_ros.robot.brick.link import analog_age, is_sending, link_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WINDOW_US = 100_000
"""What the timeline shows at first."""

REACH_US = 180_000_000
"""How far from there the page has the timeline."""

_LANE_INCH, _LANE_PX = 0.26, 26
_COLORS = {
    'link reads': GREEN, 'interrupts': GRAY, 'link sends': GREEN, 'duty acts': PURPLE,
    'lost alarms': ORANGE,
}  # fmt: skip
_BINS = 50


@dataclass(frozen=True)
class Timeline:
    """Intervals in lanes: who has the processor, what the link does, when duties act.

    `rows` has, by start, the lane of each interval, its start and end, and release and end of its
    job, in µs since the first tick. The `window` is shown at first: its begin and its end.
    """

    lanes: list[str]
    rows: dict[str, Integers]
    window: tuple[int, int]

    @classmethod
    def of(cls, run: RunData, jobs: Jobs, acts: Integers) -> Timeline:
        """Return the timeline of a run whose new duties act at these times [µs]."""
        parameters = run.attached.parameters.of(ControllerParameters)
        constants, link = kernel_constants(parameters), link_of(parameters)
        done, first = ended(jobs), run.start_ns // 1000
        response = np.where(sets_duty(done), done.end - done.release, -1)
        window = max(int(done.release[np.argmax(response)]) - WINDOW_US // 2, first)
        ticks = first + INTERRUPT_PERIOD_US * np.arange(round(run.end * 1e3))
        ticks = ticks[np.abs(ticks - window) < REACH_US]
        sends = ticks // INTERRUPT_PERIOD_US % 2 != is_sending(link, 0)
        lanes = {}
        if link.is_on:
            lanes['link reads'] = _intervals(ticks[~sends], INTERRUPT_PERIOD_US)
        if parameters.kernel:
            lanes['interrupts'] = _intervals(ticks, constants.interrupt_us)
        found = pieces(done, constants.interrupt_us)
        for number, task in enumerate(done.tasks):
            job, start, end = found[:, done.task[found[0]] == number]
            lanes[task] = start, end, done.release[job], done.end[job]
        if link.is_on:
            lanes['link sends'] = _intervals(ticks[sends], constants.link_us + constants.latency_us)
        lanes['duty acts'] = _intervals(acts)
        if jobs.is_lost.any():
            lanes['lost alarms'] = _intervals(jobs.release[jobs.is_lost])
        lane = np.repeat(np.arange(len(lanes)), [len(each[0]) for each in lanes.values()])
        times = [np.concatenate(column) - first for column in zip(*lanes.values(), strict=True)]
        order = np.argsort(times[0], kind='stable')
        order = order[np.abs(times[0][order] + first - window) < REACH_US]
        names = ('lane', 'start', 'end', 'release', 'job_end')
        rows = {name: each[order] for name, each in zip(names, (lane, *times), strict=True)}
        return cls(list(lanes), rows, (window - first, window - first + WINDOW_US))

    @property
    def colors(self) -> list[str]:
        """The colour of each lane."""
        return [_COLORS.get(each, BLUE) for each in self.lanes]

    def table(self) -> Table:
        """Return the intervals of the picture."""
        low, high = self.window
        seen = (self.rows['job_end'] >= low) & (self.rows['start'] < high)
        table = {f'{name}_s': each[seen] * 1e-6 for name, each in self.rows.items()}
        return {**table, 'lane': np.array(self.lanes)[self.rows['lane'][seen]]}

    def draw(self) -> Figure:
        """Draw the picture."""
        figure = new_figure(WIDTH, 1.0 + _LANE_INCH * len(self.lanes))
        axes, table = figure.subplots(), self.table()
        lane = [self.lanes.index(each) for each in table['lane']]
        color = [self.colors[each] for each in lane]
        for height, start, end in ((0.12, 'release_s', 'job_end_s'), (0.7, 'start_s', 'end_s')):
            axes.barh(
                lane, table[end] - table[start], height, table[start], color=color, edgecolor=color,
                linewidth=0.6,
            )  # fmt: skip
        axes.set_yticks(range(len(self.lanes)), self.lanes)
        axes.set(ylim=(len(self.lanes) - 0.5, -0.5), xlim=[each * 1e-6 for each in self.window])
        label_time(axes)
        style_axes(axes)
        return figure

    def description(self, numbers: PackedNumbers) -> Json:
        """Return the figure of the page, which draws the intervals that are visible."""
        count, start = len(self.lanes), self.rows['start']
        range_s = [each * 1e-6 for each in self.window]
        layout = {
            **chart_layout(), 'height': _LANE_PX * count + 80, 'barmode': 'overlay',
            'margin': {'l': 56, 'r': 12, 't': 34, 'b': 46}, 'showlegend': False, 'uirevision': None,
            'xaxis': {**GRID, 'title': {'text': 'time [s]'}, 'range': range_s},
            'yaxis': {
                'range': [count - 0.5, -0.5], 'tickvals': list(range(count)), 'fixedrange': True,
                'ticktext': self.lanes, 'showgrid': False, 'zeroline': False, 'automargin': True,
            },
        }  # fmt: skip
        # Times from the start: small numbers, most of them equal.
        columns = {k: v if k in ('lane', 'start') else abs(v - start) for k, v in self.rows.items()}
        packed = {name: numbers.add_whole(each) for name, each in columns.items()}
        return {'data': [], 'layout': layout, 'timeline': packed, 'colors': self.colors}


def _intervals(start: Integers, length_us: int = 0) -> tuple[Integers, ...]:
    """Return starts and ends, twice."""
    return (start, start + length_us) * 2


@dataclass(frozen=True)
class ProcessorSection:
    """What the report says about the brick's processor; nothing if the tasks took no time.

    `descriptions` make what the page shows instead of a picture.
    """

    tasks: list[TaskTimes] = field(default_factory=list)
    findings: list[str] = field(default_factory=list)
    figures: list[RenderedFigure] = field(default_factory=list)
    descriptions: Mapping[str, Callable[[PackedNumbers], Json]] = field(default_factory=dict)


def processor_of(run: RunData) -> ProcessorSection:
    """Return what the report of a run says about the brick's processor."""
    jobs, timing, duty = run.jobs, run.trajectory.timing, run.series.get(MOTOR_DUTY)
    if jobs is None or duty is None or not sets_duty(done := ended(jobs)).any():
        return ProcessorSection()
    is_new = np.diff(duty.values[:, :2], axis=0, prepend=np.float32(0)).any(axis=1)
    acts = duty.stamps[is_new] // 1000 + np.rint(duty.values[is_new, 2] * 1e6).astype(np.int64)
    ages: dict[str, Column] = {}
    link = link_of(run.attached.parameters.of(ControllerParameters))
    if link.is_on:
        stamps = (done.start[sets_duty(done)] // TICK_US * TICK_NS).tolist()
        ages['gyro values'] = np.array([analog_age(link, each) // 1000 for each in stamps])
    ages['duties'] = timing[timing[:, DUTY_AGE_US] >= 0.0, DUTY_AGE_US]
    timeline = Timeline.of(run, jobs, acts)
    caption = (
        'The 100 ms around the longest response of the task that sets the duty. Bars: who has the '
        'processor, and what the link does. Thin lines: from the release of a job to its end.'
    )
    table, png = timeline.table(), png_of(timeline.draw())
    picture = RenderedFigure('timeline', 'Timeline', caption, png, table)
    figures, descriptions = [picture, _render_ages(ages)], {'timeline': timeline.description}
    return ProcessorSection(task_times(jobs), _findings(run, done), figures, descriptions)


def _findings(run: RunData, done: Jobs) -> list[str]:
    """Return sentences about the task that sets the duty, and the utilisation."""
    rows = sets_duty(done)
    names = ', '.join(done.tasks[each] for each in np.unique(done.task[rows]))
    begin, end = (
        f'{times.min()} … {times.max()} µs (standard deviation {times.std():.1f} µs)'
        for times in (each[rows] - done.release[rows] for each in (done.start, done.end))
    )
    found = [f'{names}: jobs begin {begin} after their release, and set the duty after {end}.']
    shares = utilisation_table(run).get('utilisation_percent', np.zeros(0))
    if shares.size:
        mean, most = (f'{each:.1f} %' for each in (shares.mean(), shares.max()))
        found.append(
            f'Jobs, interrupts and the bus take {mean} of the processor, at most {most} in 100 ms.'
        )
    return found


def _render_ages(ages: Mapping[str, Column]) -> RenderedFigure:
    """Return histograms of ages [µs]."""
    top = np.ceil(max(each.max(initial=1000.0) for each in ages.values()) * 1e-3)
    edges = np.linspace(0.0, top, _BINS + 1)
    figure, table = new_figure(WIDTH, 2.8), {'from_ms': edges[:-1], 'to_ms': edges[1:]}
    some = figure.subplots(1, len(ages), squeeze=False)[0]
    for axes, (name, each) in zip(some, ages.items(), strict=True):
        table[name.replace(' ', '_')], _, _ = axes.hist(each * 1e-3, edges, color=BLUE)
        axes.set(xlabel=f'age of {name} [ms]', ylabel='number')
        style_axes(axes)
    caption = 'How old gyro values are when a job computes with them, and those of duties that act.'
    return RenderedFigure('ages', 'Ages', caption, png_of(figure), table)
