"""The house style of figures."""

from __future__ import annotations

import textwrap
from io import BytesIO
from typing import Any

# Okabe and Ito's colours: told apart by the colour-blind, and by their lightness in print.
BLUE, ORANGE, GRAY = '#0072B2', '#D55E00', '#666666'
GREEN, SKY, YELLOW, PURPLE = '#009E73', '#56B4E9', '#F0E442', '#CC79A7'

PLANES = (
    {'color': BLUE, 'linewidth': 1.4, 'label': 'plane x'},
    {'color': ORANGE, 'linewidth': 1.0, 'linestyle': '--', 'label': 'plane y'},
)
"""How the lines of planes x and y are drawn."""


_TITLE_LETTERS_PER_INCH = 11


def new_figure(width: float, height: float, title: str = '') -> Any:
    """Return a figure of that size [inch], its title in as many lines as it needs."""
    # Here, not above: the import takes a second that no run should wait for at its start.
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout='constrained')
    if title:
        figure.suptitle(textwrap.fill(title, int(width * _TITLE_LETTERS_PER_INCH)))
    return figure


def png_of(figure: Any) -> bytes:
    """Return a figure as PNG: a full disk then ends in one error, not in half a picture."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        text.set_parse_math(False)  # The user's names may have a $, and no figure has a formula.
    buffer = BytesIO()
    figure.savefig(buffer, dpi=150)
    return buffer.getvalue()


def legend_above(axes: Any, columns: int = 2) -> None:
    """Put the legend above the axes, at their right, where it hides nothing."""
    axes.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=columns, frameon=False)


def tidy(axes: Any) -> None:
    """Draw a faint grid, and no frame where there is no axis."""
    axes.grid(alpha=0.3)
    axes.spines[['top', 'right']].set_visible(False)
