"""The result of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from ballbot_ros.analysis.metrics import Judgement
from ballbot_ros.analysis.verdict import Verdict
from ballbot_ros.simulation.outcome import Outcome
from ballbot_ros.simulation.trajectory import Trajectory


class RoundTrip(NamedTuple):
    """Time from asking for the duties of a tick to having them [ms], over all ticks."""

    p50: float
    p99: float
    max: float


@dataclass(frozen=True)
class RunResult:
    """Outcome, measurements, metrics and files of a run.

    Attributes
    ----------
    outcome : Outcome
        How the run itself ended, whatever came of its expectations.
    failure : str
        Why it has failed; otherwise ''.
    failure_status : int
        Exit status of a run that has not completed: 1, 2 for a mistake of the user, 128 plus the
        number of a signal, 0 for a run that made way for another one.
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
    metrics : mapping of str to float
        By name; NaN where there is nothing to measure.
    judgements : sequence of Judgement
        The scenario's expectations with what was measured.
    recording, picture : Path or None
        The files, where there are any.
    picture_failure : str
        Why the picture could not be written; otherwise ''.
    """

    outcome: Outcome
    failure: str = ''
    failure_status: int = 1
    ticks: int = 0
    duty_sha256: str | None = None
    real_time_factor: float | None = None
    late_ticks: int | None = None
    resends: int | None = None
    round_trip: RoundTrip | None = None
    participants: Sequence[Mapping[str, object]] = ()
    trajectory: Trajectory | None = None
    metrics: Mapping[str, float] = field(default_factory=dict)
    judgements: Sequence[Judgement] = ()
    recording: Path | None = None
    picture: Path | None = None
    picture_failure: str = ''

    @classmethod
    def from_summary(cls, summary: Mapping[str, Any], trajectory: Trajectory) -> RunResult:
        """Return the result in a summary as JSON, of a plant or of a run without a graph."""
        trip = summary['round_trip_ms']
        return cls(
            outcome=Outcome(summary['outcome']),
            failure=summary['reason'],
            ticks=summary['ticks'],
            duty_sha256=summary['duty_sha256'],
            real_time_factor=summary['real_time_factor'],
            late_ticks=summary['late_ticks'],
            resends=summary['resends'],
            round_trip=RoundTrip(**trip) if trip else None,
            participants=summary['participants'],
            trajectory=trajectory,
        )

    def failed(self, reason: str) -> RunResult:
        """Return the result of a run that failed for a reason that the plant does not know."""
        return replace(self, outcome=Outcome.FAILED, failure=reason)

    @property
    def is_complete(self) -> bool:
        """Whether the run came to its end, so that its expectations hold or do not."""
        return self.outcome is Outcome.COMPLETED

    @property
    def passed(self) -> bool:
        """Whether the run came to its end and all expectations hold."""
        return self.verdict is Verdict.PASSED

    @property
    def verdict(self) -> Verdict:
        """The result in one word."""
        if not self.is_complete:
            return Verdict(self.outcome.value)
        if self._missed:
            return Verdict.NOT_MET
        return Verdict.FAILED if self.picture_failure else Verdict.PASSED

    @property
    def reason(self) -> str:
        """Why the run did not pass, in one line; '' if it did."""
        reason = ', '.join(map(str, self._missed)) if self.is_complete else self.failure
        return '; '.join(filter(None, (reason, self.picture_failure)))

    @property
    def exit_status(self) -> int:
        """Exit status of a command after this run."""
        status = self.failure_status if not self.is_complete else int(not self.passed)
        return status or int(bool(self.picture_failure))

    @property
    def _missed(self) -> list[Judgement]:
        return [each for each in self.judgements if not each.holds]
