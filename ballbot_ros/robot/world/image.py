"""Map images: PNG or BMP, one pixel per square centimetre (Appendix B.2)."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from ballbot_ros.errors import WorldError, os_errors
from ballbot_ros.files import open_regular
from ballbot_ros.robot.world.floor_map import FLOOR, LINE, WALL, FloorMap

MAX_SIDE_PIXELS = 4000
"""Maximum width and length: 40 m."""

ALLOWED = (
    f'allowed are white ({FLOOR}) for floor, gray ({WALL}) for wall and black ({LINE}) for a '
    'black line'
)
_OPAQUE = 255
_PNG_BIT_DEPTH = 24
"""Position of the bit depth in the PNG header."""


def read_map(path: str | Path) -> FloorMap:
    """Read a map image.

    It raises WorldError if the file can't be read, is not an intact PNG or BMP image of one frame
    with at most :data:`MAX_SIDE_PIXELS` pixels a side, or has a pixel whose colour is not allowed;
    the message names the file and the first such pixel.
    """
    path = Path(path)
    try:
        with os_errors(WorldError, path), BufferedReader(open_regular(path)) as stream:
            pixels = _pixels(stream, path)
    except ValueError as error:  # a null character in the name
        raise WorldError(f'{str(path)!r}: {error}') from None
    gray = pixels[..., 0]
    allowed = np.isin(gray, (FLOOR, WALL, LINE)) & (pixels[..., 3] == _OPAQUE)
    for channel in (1, 2):
        allowed &= pixels[..., channel] == gray
    if not allowed.all():
        row, column = np.unravel_index(np.argmin(allowed), allowed.shape)
        *colour, alpha = map(int, pixels[row, column])
        what = f'transparent (alpha {alpha})' if alpha != _OPAQUE else f'of colour {tuple(colour)}'
        raise WorldError(
            f'{path}: the pixel in column {column}, row {row} (from 0 at the top left) is {what}; '
            f'{ALLOWED}'
        )
    return FloorMap(np.ascontiguousarray(gray))


def _pixels(stream: BinaryIO, path: Path) -> NDArray[np.uint8]:
    """Return red, green, blue and alpha, shape (rows, columns, 4)."""
    header = stream.read(_PNG_BIT_DEPTH + 1)
    if not header:
        raise WorldError(f'{path}: the file is empty')
    stream.seek(0)
    with _refusals(path), Image.open(stream, formats=('PNG', 'BMP')) as image:
        if max(image.size) > MAX_SIDE_PIXELS:
            raise _too_large(path, f'{image.width} × {image.height} pixels')
        if image.format == 'PNG' and header[_PNG_BIT_DEPTH] > 8:
            raise WorldError(f'{path}: 16 bits per colour; a map has at most 8')
        frames = getattr(image, 'n_frames', 1)
        if frames > 1:
            raise WorldError(f'{path}: {frames} frames; a map has a single frame')
        return np.asarray(image.convert('RGBA'))


@contextmanager
def _refusals(path: Path) -> Iterator[None]:
    """Turn any error of Pillow into one line."""
    try:
        with warnings.catch_warnings():
            # Pillow only warns of some large sizes. Turn this into an error: all of them exceed
            # the limit of a map.
            warnings.simplefilter('error', Image.DecompressionBombWarning)
            yield
    except WorldError:
        raise
    except UnidentifiedImageError:
        raise WorldError(
            f'{path}: not a PNG or BMP image, which a map must be (JPEG alters colours)'
        ) from None
    except (Image.DecompressionBombWarning, Image.DecompressionBombError):
        raise _too_large(path, 'far too many pixels') from None
    except Exception as error:  # Damaged files cause errors of many types.
        reason = ' '.join(str(error).split()) or type(error).__name__
        raise WorldError(f'{path}: the image is damaged: {reason}') from None


def _too_large(path: Path, size: str) -> WorldError:
    return WorldError(f'{path}: {size}; a map has at most {MAX_SIDE_PIXELS} a side')
