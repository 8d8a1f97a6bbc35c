"""Self-contained HTML pages, and their folders."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Mapping
from io import BytesIO
from pathlib import Path

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from PIL import Image

from ballbot_ros import __version__
from ballbot_ros.analysis.figure_parts import csv_of
from ballbot_ros.analysis.run_figures import RenderedFigure
from ballbot_ros.errors import BallbotError, os_errors

_PACKAGE = 'ballbot_ros.analysis'
_COLOURS = 256


class ReportError(BallbotError):
    """A report that cannot be written."""


def render_template(template: str, *, package: str = _PACKAGE, **content: object) -> str:
    """Render a template of a package, which can extend those of this one; content is escaped."""
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(each) for each in dict.fromkeys((_PACKAGE, package))]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters['base64'] = lambda data: base64.b64encode(data).decode()
    environment.filters['number'] = number_text
    environment.filters['reduced'] = _reduced_png
    return environment.get_template(template).render(version=__version__, **content)


def _reduced_png(png: bytes) -> bytes:
    """Return a PNG with 256 colours, which is half as large; figures have hardly more."""
    with Image.open(BytesIO(png)) as picture:
        reduced = picture.convert('RGB').quantize(_COLOURS, dither=Image.Dither.NONE)
    buffer = BytesIO()
    reduced.save(buffer, 'png', optimize=True)
    return buffer.getvalue()


def number_text(value: float, missing: str = '–') -> str:
    """Return a number with 3 decimals, below 0.1 with 3 digits, from 1000 on without decimals."""
    if math.isnan(value):
        return missing
    if math.isinf(value):
        return '∞' if value > 0 else '−∞'
    form = '.3g' if 0.0 < abs(value) < 0.1 else '.3f'
    if abs(value) >= 1000.0 or float(value).is_integer():
        form = '.0f'
    return format(value, form).replace('-', '−')


def check_folder(folder: Path) -> None:
    """Raise ReportError unless `folder` is empty or does not exist: nothing is overwritten."""
    try:
        taken = folder.exists() and any(folder.iterdir())
    except NotADirectoryError:
        raise ReportError(f'{folder}: not a folder; choose another --output') from None
    except OSError as error:
        raise ReportError(f'{folder}: {error.strerror}') from None
    if taken:
        raise ReportError(f'{folder}: already exists and is not empty; choose another --output')


def write_folder(
    folder: Path, page: str, figures: Iterable[RenderedFigure], files: Mapping[str, bytes]
) -> None:
    """Write the page as ``index.html``, the figures with their tables, and other files.

    It raises ReportError if the folder cannot be written.
    """
    content = {'index.html': page.encode(), **files}
    for figure in figures:
        content[f'{figure.name}.png'] = figure.png
        if figure.table:
            content[f'{figure.name}.csv'] = csv_of(figure.table)
    with os_errors(ReportError, folder):
        folder.mkdir(parents=True, exist_ok=True)
        for name, data in content.items():
            (folder / name).write_bytes(data)
