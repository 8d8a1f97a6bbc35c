"""The result of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from ballbot_ros.analysis.metrics import Judgement, PropertyJudgement, Verdict
from ballbot_ros.analysis.recorded_scenario import RecordedPush, external_push
from ballbot_ros.analysis.run_data import RunData
from ballbot_ros.engine.trajectory import Engine, Trajectory
from ballbot_ros.lockstep.run_actions import Outcome, ParameterChange, changes_text


class RoundTrip(NamedTuple):
    """Time from publishing the plant's true state to receiving the duty [ms], over all ticks."""

    p50: float
    p99: float
    max: float


@dataclass(frozen=True)
class RunResult:
    """Outcome, measurements, metrics and files of a run.

    Attributes
    ----------
    outcome : Outcome
        How the run ended, regardless of its expectations and properties.
    failure : str
        Why it failed; otherwise ''.
    failure_status : int
        Exit status of an incomplete run: 1, 2 for a mistake of the user, 128 plus a signal number,
        0 for a run replaced by another one.
    duty_sha256 : str or None
        Hash of all duties; like the following measurements, None if the plant did not survive.
    real_time_factor : float or None
        Sim time per wall time.
    late_ticks : int or None
        Ticks that came more than a period late.
    resends : int or None
        Number of times that a tick was sent again.
    round_trip : RoundTrip or None
        None if it was not measured.
    participants : sequence of mapping
        The participants, as in the command's JSON.
    metrics : mapping of str to float
        By name; NaN if there are no data.
    judgements : sequence of Judgement
        The scenario's expectations with the measured values.
    properties : sequence of PropertyJudgement
        Its properties with their robustness.
    recording, figure : Path or None
        The files, if written.
    figure_failure : str
        Why the figure was not written; otherwise ''.
    external_pushes : tuple of RecordedPush
        The pushes that came from outside, not from the scenario.
    parameter_changes : tuple of ParameterChange
        The parameters that somebody set during the run.
    engine : Engine
        What computed its ticks.
    data : RunData or None
        The data of its recording, if they were collected during the run.
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
    properties: Sequence[PropertyJudgement] = ()
    recording: Path | None = None
    figure: Path | None = None
    figure_failure: str = ''
    external_pushes: tuple[RecordedPush, ...] = ()
    parameter_changes: tuple[ParameterChange, ...] = ()
    engine: Engine = Engine.INTERPRETED
    data: RunData | None = None

    @classmethod
    def from_summary(cls, summary: Mapping[str, Any], trajectory: Trajectory) -> RunResult:
        """Return the result for a summary as JSON, from a plant or from a run without a graph."""
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
            external_pushes=tuple(map(external_push, summary['external_pushes'])),
            parameter_changes=tuple(map(ParameterChange.from_json, summary['parameter_changes'])),
            trajectory=trajectory,
        )

    def failed(self, reason: str) -> RunResult:
        """Return this result as failed, for a reason that the plant does not know."""
        return replace(self, outcome=Outcome.FAILED, failure=reason)

    @property
    def is_complete(self) -> bool:
        """Whether the run reached its end, so that its expectations can be judged."""
        return self.outcome is Outcome.COMPLETED

    @property
    def passed(self) -> bool:
        """Whether the specified run reached its end, expectations hold, and a figure is drawn."""
        return self.verdict is Verdict.PASSED

    @property
    def verdict(self) -> Verdict:
        """The result in one word."""
        if not self.is_complete:
            return Verdict(self.outcome.value)
        if self._missed:
            return Verdict.NOT_MET
        if self.figure_failure:
            return Verdict.FAILED
        return Verdict.CHANGED if self.parameter_changes else Verdict.PASSED

    @property
    def reason(self) -> str:
        """Why the run did not pass, on one line; '' if it did."""
        reason = ', '.join(map(str, self._missed)) if self.is_complete else self.failure
        changes = changes_text(self.parameter_changes)
        return '; '.join(filter(None, (reason, self.figure_failure, changes)))

    @property
    def exit_status(self) -> int:
        """Exit status of a command after this run."""
        status = self.failure_status if not self.is_complete else int(not self.passed)
        return status or int(bool(self.figure_failure))

    @property
    def _missed(self) -> list[Judgement | PropertyJudgement]:
        judged: list[Judgement | PropertyJudgement] = [*self.judgements, *self.properties]
        return [each for each in judged if not each.holds]
