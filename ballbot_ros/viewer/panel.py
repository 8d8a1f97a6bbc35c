"""The panel next to the scene: state, display and tones."""

from __future__ import annotations

import math
import time

import viser

from ballbot_ros.brick.brick import Tone
from ballbot_ros.viewer.snapshot import Snapshot
from ballbot_ros.viewer.sound import tone_html

PERIOD = 12
"""Updates of the scene per update of the panel."""

_TONE_DELAY_S = 3.0
"""Maximum time after which a browser still starts a tone."""


class Panel:
    """Operating state, display and tones."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._status = gui.add_html('', order=0.0)
        self._sound = gui.add_html('', order=100.0)
        self._tones = 0
        self._tone_end = math.inf

    def show(self, snapshot: Snapshot, factor: float | None = None) -> None:
        """Show the state; `factor` is the speed in multiples of real time, None to omit."""
        if time.monotonic() > self._tone_end:
            self._sound.content = ''  # browsers that connect later must not play an old tone
        rows = [('state', snapshot.state or '–'), ('sim time', f'{snapshot.time:.2f} s')]
        if factor is not None:
            rows.append(('real-time factor', f'{factor:.2f}'))
        battery = snapshot.battery
        rows.append(('battery', '–' if math.isnan(battery) else f'{battery:.2f} V'))
        self._status.content = _status(rows, snapshot.lcd)

    def clear(self) -> None:
        """Show that there is no state."""
        self._status.content = _status([('state', '–'), ('sim time', '–'), ('battery', '–')], '')
        self._sound.content = ''

    def play(self, tone: Tone) -> None:
        """Play a tone."""
        self._tones += 1
        self._sound.content = tone_html(tone, self._tones)
        self._tone_end = time.monotonic() + tone.duration_ms * 1e-3 + _TONE_DELAY_S


def _status(rows: list[tuple[str, str]], lcd: str) -> str:
    cells = ''.join(f'<tr><td>{name}</td><td>{value}</td></tr>' for name, value in rows)
    page = lcd.replace('&', '&amp;').replace('<', '&lt;')
    return f'<div class="status"><table>{cells}</table><pre>{page}</pre></div>'
