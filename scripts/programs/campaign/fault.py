"""Definition of a fault in the campaign, and the verdict of a trial."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from campaign.site import Site


class Verdict(NamedTuple):
    """Outcome of a trial.

    Attributes
    ----------
    failures : tuple of str
        The broken guarantees; empty if all held.
    took_s : float
        Available processor time from the fault to the end of all affected processes [s].
    bound_s : float
        Upper bound of that time [s].
    """

    failures: tuple[str, ...]
    took_s: float
    bound_s: float

    @property
    def holds(self) -> bool:
        """Whether all guarantees held."""
        return not self.failures


class Attempt(Protocol):
    """A fault with all its random choices; `str` of it describes the actions."""

    def carry_out(self, site: Site) -> Verdict:
        """Apply the fault to a run, and judge the outcome."""


@dataclass(frozen=True)
class Fault:
    """A kind of fault.

    Attributes
    ----------
    name : str
    draw : callable
        Takes a generator and the number of the trial, for alternating choices; returns the attempt.
    lasts_s : float
        Expected duration of a trial [s].
    alone : bool
        Whether it must run alone, because it keeps the machine busy.
    needs_mounts : bool
        Whether a trial needs its own file systems.
    """

    name: str
    draw: Callable[[random.Random, int], Attempt]
    lasts_s: float
    alone: bool = False
    needs_mounts: bool = False

    def attempt(self, seed: int, number: int) -> Attempt:
        """Return the actions of trial `number`, counted from 0, of a campaign with this seed."""
        first = random.Random(f'{seed} {self.name}').randrange(1_000_000)
        return self.draw(random.Random(f'{seed} {self.name} {number}'), first + number)
