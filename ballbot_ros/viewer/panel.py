"""The panel next to the scene: state, display and tones."""

from __future__ import annotations

import base64
import io
import math
import time
import wave
from functools import cache

import numpy as np
import viser
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ballbot_ros.robot.brick.brick import COLUMNS, ROWS, Tone
from ballbot_ros.viewer.snapshot import Snapshot

_PAPER, _INK = (176, 196, 168), (24, 34, 30)
_CELL = (15, 22)
_MARGIN = 8


@cache
def _font() -> ImageFont.FreeTypeFont:
    # Use the monospaced font of matplotlib; Pillow ships none.
    from matplotlib.font_manager import findfont

    return ImageFont.truetype(findfont('DejaVu Sans Mono'), 24)


def lcd_image(page: str) -> NDArray[np.uint8]:
    """Return the display with a page of text, shape (rows, columns, 3)."""
    size = (COLUMNS * _CELL[0] + 2 * _MARGIN, ROWS * _CELL[1] + 2 * _MARGIN)
    image = Image.new('RGB', size, _PAPER)
    draw = ImageDraw.Draw(image)
    for row, line in enumerate(page.splitlines()[:ROWS]):
        draw.text((_MARGIN, _MARGIN - 3 + row * _CELL[1]), line[:COLUMNS], _INK, _font())
    return np.asarray(image)


_RATE = 8000
_MAX_TONE_S = 5.0


def tone_html(tone: Tone, number: int) -> str:
    """Return an HTML element that plays a tone once.

    Browsers play it only after a click on the page. The `number` differs from tone to tone, so that
    a repeated one plays again.
    """
    time = np.arange(round(min(tone.duration_ms * 1e-3, _MAX_TONE_S) * _RATE)) / _RATE
    loudness = min(max(tone.volume, 0), 100) / 100.0
    wave_form = np.sin(2.0 * np.pi * tone.frequency_hz * time)
    samples = np.round(127.5 + 60.0 * loudness * wave_form).astype(np.uint8)
    data = io.BytesIO()
    with wave.open(data, 'wb') as file:
        file.setnchannels(1)
        file.setsampwidth(1)
        file.setframerate(_RATE)
        file.writeframes(samples.tobytes())
    encoded = base64.b64encode(data.getvalue()).decode()
    return f'<audio autoplay data-number="{number}" src="data:audio/wav;base64,{encoded}"></audio>'


PERIOD = 12
"""Updates of the scene per update of the panel."""

_TONE_DELAY_S = 3.0
"""Maximum time after which a browser still starts a tone."""


class ScenePanel:
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
