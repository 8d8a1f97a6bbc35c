"""The base class of the package's errors, and what they show of other objects."""

from __future__ import annotations

MAX_SHOWN = 100
MAX_LINE = 1000


class BallbotError(Exception):
    """A mistake or fault reported on one line: what, where, and what is allowed."""


def one_line(error: object) -> str:
    """Return a text, or an error's text, on one line and without control characters."""
    try:
        text = str(error)
    except Exception:  # of an exception class of the user
        return ''
    return ' '.join(printable(text[:MAX_LINE]).split())


def short_repr(value: object) -> str:
    """Return the representation of any object on one line, at most 100 characters of it."""
    try:
        text = repr(value)
    except Exception:
        text = f'<{type(value).__name__}>'
    return short_text(text)


def short_text(text: str) -> str:
    """Return a text without control characters, at most 100 characters of it."""
    text = printable(text)
    return text if len(text) <= MAX_SHOWN else f'{text[:MAX_SHOWN]}…'


def printable(text: str) -> str:
    """Return a text in which a space replaces each control character and lone surrogate."""
    return ''.join(each if each.isprintable() else ' ' for each in text)
