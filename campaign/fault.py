"""What a fault of the campaign is, and what a trial of it tells."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from campaign.site import Site


class Verdict(NamedTuple):
    """What became of a trial.

    Attributes
    ----------
    complaints : tuple of str
        What did not hold; empty if all did.
    took_s : float
        From the fault to the end of everything that it hit, in time that the machine gave [s].
    bound_s : float
        What that may be at most [s].
    """

    complaints: tuple[str, ...]
    took_s: float
    bound_s: float

    @property
    def holds(self) -> bool:
        """Whether everything held."""
        return not self.complaints


class Attempt(Protocol):
    """A fault with everything drawn that is random about it; its text says what is done."""

    def carry_out(self, site: Site) -> Verdict:
        """Do it to a run, and judge what becomes of that."""


@dataclass(frozen=True)
class Fault:
    """A kind of fault.

    Attributes
    ----------
    name : str
    draw : callable
        Takes a generator, and a number that grows by one from trial to trial, for what takes turns;
        returns the attempt.
    lasts_s : float
        How long a trial is expected to take [s].
    alone : bool
        Whether no other trial may run meanwhile, as this one keeps the machine busy.
    needs_mounts : bool
        Whether a trial needs file systems of its own.
    """

    name: str
    draw: Callable[[random.Random, int], Attempt]
    lasts_s: float
    alone: bool = False
    needs_mounts: bool = False

    def attempt(self, seed: int, number: int) -> Attempt:
        """Return what trial `number`, counted from 0, of a campaign with this seed does."""
        first = random.Random(f'{seed} {self.name}').randrange(1_000_000)
        return self.draw(random.Random(f'{seed} {self.name} {number}'), first + number)
