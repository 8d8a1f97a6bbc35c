"""The errors of this package, each with a text of one line, and hints for misspelt names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import SequenceMatcher

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


@contextmanager
def os_errors(kind: type[BallbotError], path: object, other: str = '') -> Iterator[None]:
    """Turn an error of the operating system into one of a kind, about this file or folder.

    `other` is what to choose another of for a new file that already exists.
    """
    try:
        yield
    except OSError as error:
        is_taken = other and isinstance(error, FileExistsError)
        reason = f'already exists; choose another {other}' if is_taken else error.strerror or error
        raise kind(f'{path}: {reason}') from None


class CodegenError(BallbotError):
    """A folder can't be written or read, a tool is missing, or the C does not build or run."""


class ControllerError(BallbotError):
    """A controller that can't be loaded, fails, or answers with something that is no duty."""


class TickTimeoutError(BaseException):
    """A tick that does not return; no Exception, so that few controllers catch it."""


class EnvironmentConfigurationError(BallbotError, ValueError):
    """An argument, a reset option or a saved state that an environment can't use."""


class IdentificationError(BallbotError):
    """A recording that cannot be used, or a parameter that cannot be identified."""


class RecordingError(BallbotError):
    """A recording can't be created, written or read; the message begins with its path."""


class ScenarioError(BallbotError):
    """An unknown scenario, or a file that does not describe one."""


class StudyError(BallbotError):
    """A study can't be read, run or kept."""


class TeleopError(BallbotError):
    """An input can't be opened or understood, or a data log can't be written."""


class ViewerError(BallbotError):
    """A page can't be served, or a picture can't be rendered."""


class MissingExtraError(BallbotError):
    """A package is not installed.

    Attributes
    ----------
    extra : str
        The extra of setup.py that has it.
    """

    def __init__(self, text: str, extra: str = '') -> None:
        super().__init__(text)
        self.extra = extra


@contextmanager
def importing(extra: str, alternative: str = '') -> Iterator[None]:
    """Turn a missing package into a MissingExtraError, to which an alternative may be appended."""
    try:
        yield
    except ImportError as error:
        remedy = f'install it with `pip install "ballbot_ros[{extra}]"`{alternative}'
        raise MissingExtraError(f'package not found ({error}): {remedy}', extra) from None


class WorldError(BallbotError):
    """A map can't be read or written, or the start pose is not possible on it."""


_MOST_HINTS = 3


def similar(name: str, known: Iterable[str], prefix: str = '') -> str:
    """Return the `known` names most similar to `name`, as in ``a or b``, each after `prefix`."""
    likeness = {each: _likeness(name, each) for each in sorted(known)}
    # At most one letter in three is wrong, or `name` is the beginning.
    alike = [
        each for each in likeness if likeness[each] >= 2 / 3 or (name and each.startswith(name))
    ]
    best = sorted(alike, key=likeness.__getitem__, reverse=True)[:_MOST_HINTS]
    return ' or '.join(prefix + each for each in best)


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return a question to follow a misspelt `name`; '' if no `known` one is similar."""
    found = similar(name, known)
    return f' (did you mean {found}?)' if found else ''


def _likeness(name: str, known: str) -> float:
    """Return the part of the longer name's letters that both have in the same order, 0 … 1."""
    blocks = SequenceMatcher(None, name, known, autojunk=False).get_matching_blocks()
    return sum(block.size for block in blocks) / max(len(name), len(known))
