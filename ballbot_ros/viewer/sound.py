"""The brick's tones, for a page to play."""

from __future__ import annotations

import base64
import io
import wave

import numpy as np

from ballbot_ros.brick.brick import Tone

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
