"""The actions that the master of a run requests from its node.

A master receives timed events and answers each with a list of these actions, which the node carries
out in that order.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from ballbot_ros.engine.plant import Plant
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.errors import printable
from ballbot_ros.lockstep.lockstep import RunIdentity
from ballbot_ros.lockstep.participants import Membership, Participant
from ballbot_ros.parameters import PlantParameters, Value, value_text
from ballbot_ros.parameters.parameter import TextEnum
from ballbot_ros.parameters.timing import SECOND_NS, TICK_NS
from ballbot_ros.robot.brick.faults import Fault, performer_of
from ballbot_ros.robot.plant.ground_truth import GroundTruth, Push
from ballbot_ros.robot.world.world import World


class Outcome(TextEnum):
    """Outcome of a run; the values appear in its status, recording and JSON."""

    COMPLETED = 'completed'
    FAILED = 'failed'
    STOPPED = 'stopped'


_MAX_LISTED = 3


class ParameterChange(NamedTuple):
    """Another value of a node's parameter, from a time on that counts from the run's start [s]."""

    time: float
    node: str
    name: str
    value: Value

    @classmethod
    def of_fault(cls, fault: Fault) -> ParameterChange:
        """Return the change by which a node was given a fault."""
        return cls(fault.time, performer_of(fault.component), 'faults', str(fault))

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> ParameterChange:
        """Return a change from the JSON of a run."""
        value = content['value']
        value = tuple(value) if isinstance(value, list) else value
        return cls(content['time_s'], content['node'], content['parameter'], value)

    def as_json(self) -> dict[str, object]:
        """Return the change as JSON; a value that JSON does not have, such as NaN, is a text."""
        is_json = isinstance(self.value, str) or bool(np.isfinite(self.value).all())
        return {
            'time_s': self.time,
            'tick': self.tick,
            'node': self.node,
            'parameter': self.name,
            'value': self.value if is_json else value_text(self.value),
        }

    @property
    def tick(self) -> int:
        """The first tick with the new value, from 0."""
        return round(self.time * SECOND_NS / TICK_NS)

    def __str__(self) -> str:
        value = printable(value_text(self.value))
        name = printable(f'{self.node}.{self.name}')
        return f'{name} was set to {value} at {self.time:.3f} s (tick {self.tick})'


def changes_text(changes: Iterable[ParameterChange]) -> str:
    """Return the first changes of a run on one line; '' if there are none."""
    listed = [str(each) for each in islice(changes, _MAX_LISTED + 1)]
    return '; '.join([*listed[:_MAX_LISTED], *('…' for _ in listed[_MAX_LISTED:])])


@dataclass(frozen=True)
class AnnounceRun:
    """Announce a run, so that its participants join it."""

    run: RunIdentity


@dataclass(frozen=True)
class CallRoll:
    """Ask every participant of a run, including the plant, to announce itself."""

    run: RunIdentity
    plant: Participant


@dataclass(frozen=True)
class PublishStatus:
    """Publish the status of a run; `summary` is None while it is in progress."""

    run: RunIdentity
    is_lockstep: bool
    topics: tuple[str, ...]
    members: tuple[Membership, ...]
    summary: RunSummary | None = None


@dataclass(frozen=True)
class BeginRun:
    """Publish the initial state of a run: its map, if any, and that no wall is hit."""

    start_ns: int
    world: World | None
    ball_radius: float


@dataclass(frozen=True)
class ClearMap:
    """Stop offering the map of an earlier run to late subscribers."""


@dataclass(frozen=True)
class PublishPush:
    """Publish the start and the end of the push with this number."""

    push: Push
    number: int


@dataclass(frozen=True)
class PublishTruth:
    """Publish the truth of a tick, the true state of the robot, together with its sim time."""

    truth: GroundTruth
    wall_hit: bool
    is_resend: bool = False


@dataclass(frozen=True)
class ResendToDrivers:
    """Publish the truth of an earlier tick again for the drivers, without its time."""

    truth: GroundTruth


@dataclass(frozen=True)
class StopMotors:
    """Publish that the motors are off from the tick after `last_ns` [ns]."""

    last_ns: int


@dataclass(frozen=True)
class Log:
    """Write a line to the log; of throttled warnings, at most one a second."""

    text: str
    is_warning: bool = False
    is_throttled: bool = False


@dataclass(frozen=True)
class Warn:
    """Show a warning in the diagnostics until it is cleared."""

    text: str


@dataclass(frozen=True)
class ClearWarning:
    """Clear the warning."""


@dataclass(frozen=True)
class RaiseError:
    """Show an error in the diagnostics until it is cleared."""

    text: str


@dataclass(frozen=True)
class ClearError:
    """Clear the error."""


@dataclass(frozen=True)
class Report:
    """Publish the diagnostics now."""


@dataclass(frozen=True)
class WakeIn:
    """Call ``on_wake`` once, after `delay_s` [s]; this replaces an earlier request."""

    delay_s: float


@dataclass(frozen=True)
class CancelWake:
    """Cancel the call of ``on_wake``."""


@dataclass(frozen=True)
class EndRun:
    """Finish: the run has ended. The exit status is 1 for a failure, 2 for a user's mistake."""

    summary: RunSummary
    exit_status: int


@dataclass(frozen=True)
class RunSummary:
    """Outcome and measurements of a run.

    Attributes
    ----------
    reason : str
        Why it failed; otherwise ''.
    real_time_factor : float
        Sim time per wall time.
    round_trips_s : tuple of float
        Times from publishing a truth to receiving its duties [s]; empty if not measured.
    external_pushes : tuple of Push
        The pushes that came from outside, not from the scenario.
    parameter_changes : tuple of ParameterChange
        The parameters that somebody set during the run, or between the first run and this one.
    """

    outcome: Outcome
    reason: str
    ticks: int
    duty_sha256: str
    real_time_factor: float
    late_ticks: int
    resends: int
    round_trips_s: tuple[float, ...]
    start_ns: int
    members: tuple[Membership, ...] = field(default=())
    external_pushes: tuple[Push, ...] = ()
    parameter_changes: tuple[ParameterChange, ...] = ()


Action = (
    AnnounceRun | CallRoll | PublishStatus | BeginRun | ClearMap | PublishPush | PublishTruth
    | ResendToDrivers | StopMotors | Log | Warn | ClearWarning | RaiseError | ClearError | Report
    | WakeIn | CancelWake | EndRun
)  # fmt: skip
Actions = list[Action]


@dataclass(frozen=True)
class RunSetup:
    """Components of a run; without a world, the floor is unlimited and without walls."""

    parameters: PlantParameters
    plant: Plant
    world: World | None
    scenario: Scenario
    participant: Participant
