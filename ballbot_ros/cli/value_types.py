"""Types of values on the command line."""

from __future__ import annotations

import math
from typing import Any

import click

from ballbot_ros.suggestions import did_you_mean


class Choice(click.Choice[str]):
    """One of several words; a misspelt one gets a suggestion."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the word."""
        try:
            return super().convert(value, param, ctx)
        except click.BadParameter as error:
            hint = did_you_mean(str(value), map(str, self.choices))
            self.fail(error.message.removesuffix('.') + hint, param, ctx)


class FloatRange(click.FloatRange):
    """A number within a range; unlike click's type, it refuses NaN."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number."""
        number: float = super().convert(value, param, ctx)
        if math.isnan(number):
            self.fail(f'{value!r} is not a number', param, ctx)
        return number
