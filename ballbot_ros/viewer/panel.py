"""The panel next to the scene: state, display and plots."""

from __future__ import annotations

import math
import time

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

from ballbot_ros.brick.brick import Tone
from ballbot_ros.viewer.snapshot import WINDOW_S, Snapshot
from ballbot_ros.viewer.sound import tone_html

PERIOD = 12
"""Updates of the scene per update of the panel."""

_X_COLOUR, _Y_COLOUR = '#0072b2', '#d55e00'
_HEIGHT = 104
_TONE_DELAY_S = 3.0
"""Maximum time after which a browser still starts a tone."""

# Title, columns of the trace, scale factor, minimum span, and labels.
_PLOTS: tuple[tuple[str, tuple[int, ...], float, float, tuple[str, ...]], ...] = (
    ('pitch [°]', (1, 2), 180.0 / math.pi, 2.0, ('ψx', 'ψy')),
    ('position [cm]', (3, 4), 100.0, 10.0, ('x', 'y')),
    ('duty [%]', (5, 6), 1.0, 20.0, ('x', 'y')),
    ('sonar [cm]', (7,), 100.0, 20.0, ('distance',)),
)


class Panel:
    """State and plots."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._status = gui.add_html('', order=0.0)
        self._sound = gui.add_html('', order=100.0)
        self._tones = 0
        self._tone_end = math.inf
        self._plots = []
        with gui.add_folder('Last 10 s', order=20.0):
            for title, columns, _, _, labels in _PLOTS:
                gui.add_html(_caption(title, labels))
                self._plots.append(_plot(gui, len(columns)))

    def show(
        self, snapshot: Snapshot, trace: NDArray[np.float64], factor: float | None = None
    ) -> None:
        """Show the state, and the last seconds in the columns of ``History.trace``.

        `factor` is the speed in multiples of real time; None to omit.
        """
        if time.monotonic() > self._tone_end:
            self._sound.content = ''  # browsers that connect later must not play an old tone
        rows = [('state', snapshot.state or '–'), ('sim time', f'{snapshot.time:.2f} s')]
        if factor is not None:
            rows.append(('real-time factor', f'{factor:.2f}'))
        battery = snapshot.battery
        rows.append(('battery', '–' if math.isnan(battery) else f'{battery:.2f} V'))
        self._status.content = _status(rows, snapshot.lcd)
        if len(trace) < 2:
            return
        times = trace[:, 0]
        for plot, (_, columns, scale, least, _) in zip(self._plots, _PLOTS, strict=True):
            # A plot can't show an infinite distance: no echo becomes a gap.
            values = np.where(np.isfinite(trace), trace * scale, np.nan)
            plot.data = (times, *(values[:, column] for column in columns))
            plot.scales = _scales(snapshot.time, _range(values[:, columns], least))

    def clear(self) -> None:
        """Show that there is no state, and empty plots."""
        self._status.content = _status([('state', '–'), ('sim time', '–'), ('battery', '–')], '')
        self._sound.content = ''
        for plot in self._plots:
            plot.data = _nothing(len(plot.data) - 1)
            plot.scales = _scales(0.0, (-1.0, 1.0))

    def play(self, tone: Tone) -> None:
        """Play a tone."""
        self._tones += 1
        self._sound.content = tone_html(tone, self._tones)
        self._tone_end = time.monotonic() + tone.duration_ms * 1e-3 + _TONE_DELAY_S


def _range(values: NDArray[np.float64], least: float) -> tuple[float, float]:
    """Return the range of a plot, at least `least` wide so that noise does not look large."""
    finite = values[np.isfinite(values)]
    low, high = (finite.min(), finite.max()) if finite.size else (0.0, 0.0)
    margin = max(0.1 * (high - low), 0.5 * (least - (high - low)))
    return float(low - margin), float(high + margin)


def _scales(now_s: float, heights: tuple[float, float]) -> dict[str, uplot.Scale]:
    end = max(now_s, WINDOW_S)
    return {
        'x': uplot.Scale(time=False, auto=False, range=(end - WINDOW_S, end)),
        'y': uplot.Scale(auto=False, range=heights),
    }


def _plot(gui: viser.GuiApi, curves: int) -> viser.GuiUplotHandle:
    colours = (_X_COLOUR, _Y_COLOUR)[:curves]
    series = [uplot.Series(stroke=colour, width=1.5) for colour in colours]
    return gui.add_uplot(
        _nothing(curves),
        (uplot.Series(label='t [s]'), *series),
        scales=_scales(0.0, (-1.0, 1.0)),
        axes=(uplot.Axis(size=30), uplot.Axis(size=46, space=18)),
        legend=uplot.Legend(show=False),
        height=_HEIGHT,
        padding=(8, 12, 0, 0),
    )


def _nothing(curves: int) -> tuple[NDArray[np.float64], ...]:
    """Return the data of a plot without curves."""
    return (np.array([0.0, 1.0]), *[np.full(2, np.nan)] * curves)


def _caption(title: str, labels: tuple[str, ...]) -> str:
    marks = ' '.join(
        f'<span style="color:{colour}">{label}</span>'
        for label, colour in zip(labels, (_X_COLOUR, _Y_COLOUR), strict=False)
    )
    return f'<div style="font-size:12px;margin:2px 1em -6px 1em"><b>{title}</b> {marks}</div>'


def _status(rows: list[tuple[str, str]], lcd: str) -> str:
    cells = ''.join(
        f'<tr><td style="color:#777;padding-right:8px">{name}</td>'
        f'<td style="font-variant-numeric:tabular-nums;white-space:nowrap"><b>{value}</b></td></tr>'
        for name, value in rows
    )
    page = lcd.replace('&', '&amp;').replace('<', '&lt;')
    display = (
        '<pre style="background:#b0c4a8;color:#18221e;font-size:10px;line-height:1.25;margin:0;'
        f'padding:6px;border-radius:4px;box-sizing:content-box;width:16ch;flex-shrink:0;min-height:10em;'
        f'overflow:hidden">{page}</pre>'
    )
    return (
        '<div style="display:flex;justify-content:space-between;align-items:center;gap:8px;'
        f'font-size:13px;margin:4px 1em"><table>{cells}</table>{display}</div>'
    )
