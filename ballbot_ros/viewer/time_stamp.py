"""The time, written into a picture."""

from __future__ import annotations

import re

import numpy as np
import PIL.Image
import PIL.ImageDraw
import PIL.ImageFont

from ballbot_ros.viewer.colours import BLACK, WHITE
from ballbot_ros.viewer.offscreen import Image

_HEIGHT = 0.045
"""Height of the letters, as a part of the shorter side of the picture."""

_MIN_LETTERS = 10
_OPACITY = 170


def with_time_stamp(image: Image, time: float) -> Image:
    """Return the picture with the time [s] in its lower left corner."""
    picture = PIL.Image.fromarray(image)
    size = max(_MIN_LETTERS, round(_HEIGHT * min(picture.size)))
    font = PIL.ImageFont.load_default(size)
    draw = PIL.ImageDraw.Draw(picture, 'RGBA')
    text = f'{time:.2f} s'
    margin = size // 2
    # The digits differ in width; the box shall not change from frame to frame.
    width = draw.textlength(re.sub(r'\d', '0', text), font)
    left, bottom = margin, picture.height - margin
    box = (left, bottom - 2 * size, left + width + size, bottom)
    draw.rounded_rectangle(box, size // 3, (*BLACK, _OPACITY))
    draw.text((box[2] - size // 2, bottom - size), text, WHITE, font, anchor='rm')
    return np.asarray(picture)
