"""The base class of the package's errors."""


class BallbotError(Exception):
    """A mistake or fault reported on one line: what, where, and what is allowed."""


def one_line(error: BaseException) -> str:
    """Return an error's text on one line."""
    return ' '.join(str(error).split())
