"""What the plots show: their curves and values."""

import numpy as np

from ballbot_ros.analysis.signals import SIGNALS
from ballbot_ros.viewer.plots import (
    MAX_ROWS,
    PLOT_KINDS,
    ghost_columns,
    offered_kinds,
    plot_data,
    recorded_kinds,
    recorded_plot,
)
from ballbot_ros.viewer.snapshot import LIVE_SIGNALS

PITCH, POSITION, DUTY, SONAR = (kind for kind in PLOT_KINDS if kind.is_default)
TIME = np.array([0.0, 0.004])


def column(*values):
    return np.array(values)


def test_every_signal_has_a_plot():
    plotted = set().union(*(kind.columns for kind in PLOT_KINDS))
    assert plotted == {name for signal in SIGNALS for name in signal.columns}


def test_the_planes_have_the_same_colours_everywhere():
    colours = {
        (curve.column.rpartition(f'_{plane}_')[1][1:-1], curve.colour)
        for kind in PLOT_KINDS
        for curve in kind.curves
        for plane in 'xy'
        if f'_{plane}_' in curve.column
    }
    assert len(colours) == 2
    assert len({colour for _, colour in colours}) == 2


def test_only_actual_values_have_solid_lines():
    for kind in PLOT_KINDS:
        for curve in kind.curves:
            is_other = curve.column.startswith(('reference', 'commanded', 'estimated'))
            assert bool(curve.dash) == is_other, curve


def test_a_plot_shows_its_signals_in_its_unit():
    data = plot_data(
        POSITION, TIME, {'position_x_m': column(1.0, 2.0), 'reference_position_x_m': column(0.5, 1)}
    )
    assert [curve.label for curve in data.curves] == ['x', 'reference x']
    assert [values.tolist() for values in data.values] == [[100.0, 200.0], [50.0, 100.0]]


def test_a_curve_without_any_value_is_left_out():
    """Such as the reference of a controller that has none."""
    unknown = column(np.nan, np.nan)
    data = plot_data(PITCH, TIME, {'pitch_x_deg': column(0, np.nan), 'pitch_y_deg': unknown})
    assert [curve.label for curve in data.curves] == ['x']
    assert plot_data(PITCH, TIME, {'pitch_y_deg': unknown}).curves == ()
    data = plot_data(PITCH, TIME, {'pitch_y_deg': unknown}, keeps_unknown=True)
    assert [curve.column for curve in data.curves] == ['pitch_y_deg'], (
        'a live plot keeps its curves'
    )


def test_no_echo_is_neither_left_out_nor_a_distance():
    data = plot_data(SONAR, TIME, {'distance_m': column(np.inf, np.inf)})
    assert [curve.label for curve in data.curves] == ['sonar']
    assert np.isinf(data.values[0]).all()


def test_plots_without_signals_are_not_offered():
    assert offered_kinds(['distance_m']) == [SONAR]
    assert offered_kinds(['reference_position_x_m']) == [POSITION]
    live = offered_kinds(LIVE_SIGNALS)
    assert {PITCH, POSITION, DUTY, SONAR} < set(live) < set(PLOT_KINDS)


def test_a_ghost_has_thin_curves_behind_the_others():
    table = {'position_x_m': column(1.0, 2.0), 'position_y_m': column(0.0, 0.0)}
    data = plot_data(POSITION.with_ghost(), TIME, table | ghost_columns(table))
    assert [curve.label for curve in data.curves] == ['ghost x', 'ghost y', 'x', 'y']
    ghost_x, ghost_y, x, y = data.curves
    assert ghost_x.width < x.width
    assert len({ghost_x.colour, ghost_y.colour, x.colour, y.colour}) == 4


class RampRun:
    """A run whose pitch is the number of the tick."""

    def __init__(self, ticks):
        self.ticks = ticks
        self.columns = frozenset({'pitch_x_deg', 'pitch_y_deg', 'battery_v'})

    def table(self, names, ticks):
        assert 'pitch_x_deg' in names
        ramp = np.arange(float(self.ticks))
        padding = (0, ticks - self.ticks)
        return {
            name: np.pad(ramp, padding, constant_values=np.nan)
            for name in ('pitch_x_deg', 'pitch_y_deg')
        }


def test_a_short_run_is_shown_tick_by_tick():
    data = recorded_plot(PITCH, [RampRun(2500)])
    assert len(data.time) == 2500
    assert data.time[1] == 0.004
    assert data.values[0].tolist() == list(range(2500))


def test_a_long_run_keeps_its_length_and_its_extremes():
    ticks = 3 * MAX_ROWS
    run = RampRun(ticks)
    data = recorded_plot(PITCH, [run])
    assert len(data.time) <= MAX_ROWS
    assert (np.diff(data.time) > 0.0).all()
    assert data.time[0] == 0.0
    assert data.values[0].min() == 0.0
    assert data.values[0].max() == ticks - 1


def test_the_plots_of_two_runs_are_as_long_as_the_longer_one():
    for runs in ([RampRun(100), RampRun(50)], [RampRun(50), RampRun(100)]):
        data = recorded_plot(PITCH, runs)
        assert len(data.time) == 100
        ends = {
            c.label: np.isfinite(v).sum() for c, v in zip(data.curves, data.values, strict=True)
        }
        assert ends['x'] == runs[0].ticks
        assert ends['ghost x'] == runs[1].ticks
    assert [kind.label for kind in recorded_kinds(runs)] == ['body pitch [°]', 'battery [V]']
