"""The brick's display as an image."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ballbot_ros.brick.lcd import COLUMNS, ROWS

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
