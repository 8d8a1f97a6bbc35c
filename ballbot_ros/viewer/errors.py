"""The package's error."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ballbot_ros.errors import BallbotError


class ViewerError(BallbotError):
    """A page can't be served, or a picture can't be rendered."""


@contextmanager
def importing() -> Iterator[None]:
    """Turn a missing package of the viewer into a ViewerError that says how to install it."""
    try:
        yield
    except ImportError as error:
        raise ViewerError(
            f'package not found ({error}): install it with `pip install "ballbot_ros[viewer]"`'
        ) from None
