"""The common style of all figures."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from io import BytesIO
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Okabe and Ito's colours, which colour-blind readers and black-and-white prints can tell apart.
BLUE, ORANGE, GRAY = '#0072B2', '#D55E00', '#666666'
GREEN, SKY, YELLOW, PURPLE = '#009E73', '#56B4E9', '#F0E442', '#CC79A7'

DARKER: Mapping[str, str] = {BLUE: '#003A5C', ORANGE: '#7D2F00'}
"""The colours of thin curves over the wide ones of the planes."""

INK, PAPER = '#1A1A1A', '#FFFFFF'
"""Colours of text, and of what is behind it."""

ON_DARK: Mapping[str, str] = {
    INK: '#E6E8EA',
    PAPER: '#15181B',
    BLUE: '#56B4E9',
    ORANGE: '#FF8F45',
    GRAY: '#A0A4A8',
    GREEN: '#2FC79A',
    SKY: '#8C8CFF',
    PURPLE: '#E29AC2',
    DARKER[BLUE]: '#B5E3FF',
    DARKER[ORANGE]: '#FFD166',
}
"""What stands for a colour on a dark page; other colours stay."""

WIDTH = 8.0
"""Width of a figure on a page [inch]."""

_TITLE_LETTERS_PER_INCH = 11


@dataclass(frozen=True)
class Line:
    """Style of a curve: width [point], a line style of matplotlib, its name in the legend or ''."""

    color: str
    width: float = 1.4
    dash: str = '-'
    label: str = ''


PLANES = (Line(BLUE, label='plane x'), Line(ORANGE, 1.0, '--', 'plane y'))
"""The curves of planes x and y."""


@cache
def _figure_class() -> type[Figure]:
    # Imported here, so that the start of a run does not wait for the import, which takes a second.
    from matplotlib.figure import Figure

    class ShownFigure(Figure):
        """A figure that a notebook shows, whether or not it uses pyplot."""

        _repr_png_ = png_of

    return ShownFigure


def new_figure(width: float, height: float, title: str = '') -> Figure:
    """Return a figure of this size [inch], with its title on as many lines as it needs."""
    figure = _figure_class()(figsize=(width, height), layout='constrained')
    if title:
        letters = int(width * _TITLE_LETTERS_PER_INCH)
        figure.suptitle(textwrap.fill(title, letters, break_on_hyphens=False))
    return figure


def png_of(figure: Figure) -> bytes:
    """Return a figure as the content of a PNG file."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        # Show a $ in user-defined names as it is; no figure has a formula.
        text.set_parse_math(False)
    buffer = BytesIO()
    figure.savefig(buffer, dpi=150)
    return buffer.getvalue()
