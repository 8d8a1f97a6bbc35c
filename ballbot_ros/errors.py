"""The package's base error."""


class BallbotError(Exception):
    """A mistake or fault that ends in one line: what, where, and what is allowed."""
