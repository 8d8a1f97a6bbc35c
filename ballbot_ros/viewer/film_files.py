"""Files of pictures and films."""

from __future__ import annotations

import contextlib
import itertools
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import imageio_ffmpeg
import numpy as np
import PIL.Image

from ballbot_ros.viewer.errors import ViewerError
from ballbot_ros.viewer.offscreen import Image


@dataclass(frozen=True)
class FilmFormat:
    """How FFmpeg encodes a film.

    Attributes
    ----------
    max_fps : int
        Highest number of frames per second that players show.
    needs_even_size : bool
        Whether two by two pixels have one colour value.
    quality : float or None
        Of a codec with variable bit rate, 0 to 10.
    """

    codec: str
    pixels: str
    max_fps: int
    needs_even_size: bool = False
    quality: float | None = None
    options: tuple[str, ...] = ()


# A palette for each frame, so that no frame waits for the last one.
_PALETTE = (
    'split[image][sample];[sample]palettegen=stats_mode=single[palette];'
    '[image][palette]paletteuse=new=1:dither=none:diff_mode=rectangle'
)

FORMATS = {
    '.mp4': FilmFormat('libx264', 'yuv420p', 60, needs_even_size=True, quality=7),
    '.webp': FilmFormat(
        'libwebp_anim', 'yuv420p', 60, options=('-quality', '80', '-loop', '0')
    ),
    '.gif': FilmFormat('gif', 'pal8', 50, options=('-filter_complex', _PALETTE, '-loop', '0')),
}  # fmt: skip
"""Formats of films by their suffix."""


@contextlib.contextmanager
def replacing(output: Path) -> Iterator[Path]:
    """Give a path to write to; the file replaces `output` once it is complete.

    Yields
    ------
    pathlib.Path

    Raises
    ------
    ViewerError
        If the file can't be written.
    """
    try:
        with TemporaryDirectory(prefix='.ballbot_', dir=output.parent) as folder:
            unfinished = Path(folder) / output.name
            yield unfinished
            unfinished.replace(output)
    except (OSError, ImportError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or ' '.join(str(error).split())
        raise ViewerError(f'{output}: {reason}') from None


def write_picture(output: Path, image: Image) -> None:
    """Write a .png file."""
    PIL.Image.fromarray(image).save(output, optimize=True)


def write_film(output: Path, images: Iterator[Image], fps: int) -> None:
    """Write a film in the format of its suffix, with `fps` frames per second."""
    first = next(images)
    height, width, _ = first.shape
    film_format = FORMATS[output.suffix]
    encoder = imageio_ffmpeg.write_frames(
        os.fspath(output),
        (width, height),
        fps=fps,
        codec=film_format.codec,
        quality=film_format.quality,
        pix_fmt_out=film_format.pixels,
        output_params=list(film_format.options),
        macro_block_size=1,  # keep the size
        ffmpeg_log_level='error',
    )
    encoder.send(None)  # starts it
    with contextlib.closing(encoder):
        for image in itertools.chain([first], images):
            encoder.send(np.ascontiguousarray(image))
