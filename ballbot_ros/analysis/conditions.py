"""Conditions on the change of a metric, such as ``peak_pitch_deg>5%``."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

from ballbot_ros.errors import BallbotError
from ballbot_ros.suggestions import similar

_FORM = re.compile(
    r'\s*(?P<metric>\w+)\s*(?P<sign>[<>])\s*(?P<amount>\d+\.?\d*|\.\d+)\s*(?P<percent>%?)\s*'
)


class ConditionError(BallbotError):
    """A condition that is malformed or names an unknown metric."""


@dataclass(frozen=True)
class Condition:
    """A limit on the change of a metric.

    With the sign ``>``, the metric rose by more than `amount`; with ``<``, it fell by more. The
    amount is in percent of the reference's magnitude, or in the metric's own unit; not negative.
    """

    metric: str
    sign: str
    amount: float
    percent: bool

    def __str__(self) -> str:
        """Return the condition in its input form."""
        return f'{self.metric}{self.sign}{self.amount:.12g}{"%" if self.percent else ""}'

    def holds(self, reference: float, value: float) -> bool:
        """Return whether `value` has changed by more than the limit from `reference`.

        If only `value` is missing (NaN), the metric counts as worse: the condition holds. If the
        reference is missing, it does not hold. A change from a reference of 0 exceeds any
        percentage.
        """
        if math.isnan(reference):
            return False
        if math.isnan(value):
            return True
        rise = value - reference if self.sign == '>' else reference - value
        return rise > (abs(reference) * self.amount / 100.0 if self.percent else self.amount)


def parse_condition(text: str, metrics: Iterable[str]) -> Condition:
    """Parse a condition.

    Raises
    ------
    ConditionError
        If `text` is not of the form ``metric>5%`` or ``metric<0.1``, or its metric is not one of
        the `metrics`.
    """
    match = _FORM.fullmatch(text)
    if not match:
        raise ConditionError(
            f'--fail-if {text!r}: not of the form metric>5%, metric>0.1, metric<5% or metric<0.1'
        )
    known = list(metrics)
    name = match['metric']
    if name not in known:
        found = similar(name, known)
        hint = f'did you mean {found}?' if found else f'known: {", ".join(known)}'
        raise ConditionError(f'--fail-if {text!r}: unknown metric {name!r}; {hint}')
    return Condition(name, match['sign'], float(match['amount']), bool(match['percent']))
