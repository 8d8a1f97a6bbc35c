"""The house style of figures."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Okabe and Ito's colours: told apart by the colour-blind, and by their lightness in print.
BLUE, ORANGE, GRAY = '#0072B2', '#D55E00', '#666666'
GREEN, SKY, YELLOW, PURPLE = '#009E73', '#56B4E9', '#F0E442', '#CC79A7'

WIDTH = 8.0
"""Of a figure on a page [inch]."""

_TITLE_LETTERS_PER_INCH = 11


@dataclass(frozen=True)
class Line:
    """How a curve is drawn.

    Attributes
    ----------
    color : str
    width : float
        [point]
    dash : str
        As matplotlib names line styles.
    label : str
        Its name in the legend; '' for none.
    """

    color: str
    width: float = 1.4
    dash: str = '-'
    label: str = ''


PLANES = (Line(BLUE, label='plane x'), Line(ORANGE, 1.0, '--', 'plane y'))
"""The curves of planes x and y."""


def new_figure(width: float, height: float, title: str = '') -> Figure:
    """Return a figure of that size [inch], its title in as many lines as it needs."""
    # Here, not above: the import takes a second that no run should wait for at its start.
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout='constrained')
    if title:
        figure.suptitle(textwrap.fill(title, int(width * _TITLE_LETTERS_PER_INCH)))
    return figure


def png_of(figure: Figure) -> bytes:
    """Return a figure as PNG: a full disk then ends in one error, not in half a picture."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        # The user's names may have a $, and no figure has a formula.
        text.set_parse_math(False)
    buffer = BytesIO()
    figure.savefig(buffer, dpi=150)
    return buffer.getvalue()
