"""The result of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from ballbot_ros.simulation.outcome import Outcome
from ballbot_ros.simulation.trajectory import Trajectory


class RoundTrip(NamedTuple):
    """Time from asking for the duties of a tick to having them [ms], over all ticks."""

    p50: float
    p99: float
    max: float


@dataclass(frozen=True)
class RunResult:
    """Outcome, measurements and trajectory of a run.

    Attributes
    ----------
    outcome : Outcome
    reason : str
        Why it has failed; otherwise ''.
    exit_status : int
        The status with which a command ends after this run.
    ticks : int
    duty_sha256 : str or None
        Hash of all duties; like all further measurements None if the plant did not live to tell.
    real_time_factor : float or None
        Sim time per wall time.
    late_ticks : int or None
        Ticks that came more than a period late.
    resends : int or None
        How often the plant asked again for a tick.
    round_trip : RoundTrip or None
        None if it was not measured.
    participants : sequence of mapping
        Everybody who has taken part, as in the JSON of the command.
    trajectory : Trajectory or None
    """

    outcome: Outcome
    reason: str = ''
    exit_status: int = 1
    ticks: int = 0
    duty_sha256: str | None = None
    real_time_factor: float | None = None
    late_ticks: int | None = None
    resends: int | None = None
    round_trip: RoundTrip | None = None
    participants: Sequence[Mapping[str, Any]] = field(default_factory=list)
    trajectory: Trajectory | None = None

    @classmethod
    def of_plant(cls, summary: Mapping[str, Any], trajectory: Trajectory) -> RunResult:
        """Return the result that the plant's summary tells, as JSON has it."""
        trip = summary['round_trip_ms']
        return cls(
            outcome=Outcome(summary['outcome']),
            reason=summary['reason'],
            ticks=summary['ticks'],
            duty_sha256=summary['duty_sha256'],
            real_time_factor=summary['real_time_factor'],
            late_ticks=summary['missed_ticks'],
            resends=summary['asked_again'],
            round_trip=RoundTrip(**trip) if trip else None,
            participants=summary['participants'],
            trajectory=trajectory,
        )

    def failed(self, reason: str) -> RunResult:
        """Return the result of a run that failed for a reason that the plant does not know."""
        return replace(self, outcome=Outcome.FAILED, reason=reason)
