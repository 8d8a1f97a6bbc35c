"""The order of the trials, and the table of their results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from rich.box import MARKDOWN
from rich.table import Table

from campaign.fault import Fault, Verdict


class Trial(NamedTuple):
    """Trial `number`, counted from 0, of a fault."""

    fault: Fault
    number: int


@dataclass
class Schedule:
    """Provides the trials in turn, as long as they are expected to end in time.

    Attributes
    ----------
    faults : sequence of Fault
        In the order in which they are tested.
    length_s : float
        Length of the campaign [s].
    """

    faults: Sequence[Fault]
    length_s: float
    _tried: dict[str, int] = field(default_factory=dict)
    _expected_s: dict[str, float] = field(default_factory=dict)

    def next(self, now_s: float, under_way: Sequence[Fault]) -> Trial | None:
        """Return the next trial to begin; None if there is none now.

        Parameters
        ----------
        now_s : float
            Time since the beginning [s].
        under_way : sequence of Fault
            Faults of the running trials.
        """
        if any(fault.alone for fault in under_way):
            return None
        left_s = self.length_s - now_s
        fitting = [fault for fault in self.faults if self._expects_s(fault) <= left_s]
        if not fitting:
            return None
        fault = min(fitting, key=lambda each: self._tried.get(each.name, 0))
        if fault.alone and under_way:
            return None
        number = self._tried.get(fault.name, 0)
        self._tried[fault.name] = number + 1
        return Trial(fault, number)

    def has_more(self, now_s: float) -> bool:
        """Whether another trial is still expected to end in time."""
        return any(self._expects_s(fault) <= self.length_s - now_s for fault in self.faults)

    def took(self, fault: Fault, wall_s: float) -> None:
        """Note the duration of a trial [s]."""
        self._expected_s[fault.name] = max(self._expects_s(fault), wall_s)

    def _expects_s(self, fault: Fault) -> float:
        return self._expected_s.get(fault.name, fault.lasts_s)


def table_of(
    faults: Sequence[Fault], verdicts: Mapping[str, Sequence[Verdict]], impossible: Sequence[str]
) -> Table:
    """Return the table of faults, results, and the worst times.

    Parameters
    ----------
    faults : sequence of Fault
    verdicts : mapping
        Verdicts of the trials, by the fault's name.
    impossible : sequence of str
        Names of the faults that can't be tested on this machine.
    """
    table = Table(box=MARKDOWN)
    for heading in ('fault', 'tried', 'held', 'worst'):
        table.add_column(heading, justify='left' if heading in ('fault', 'worst') else 'right')
    for fault in faults:
        found = verdicts.get(fault.name, ())
        held = sum(verdict.holds for verdict in found)
        if found:
            worst = worst_of(found)
        else:
            worst = 'not possible here' if fault.name in impossible else 'no time left'
        table.add_row(fault.name, str(len(found)), str(held), worst)
    return table


def worst_of(verdicts: Sequence[Verdict]) -> str:
    """Return the longest time of a trial relative to its bound, as text."""
    worst = max(verdicts, key=lambda verdict: verdict.took_s / verdict.bound_s)
    return f'{worst.took_s:.1f} s of {worst.bound_s:.0f} s'
