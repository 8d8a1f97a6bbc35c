"""What the master of a run tells its node to do.

A master is handed events with their time and answers each with a list of these actions; the node
carries them out in that order.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum, auto

from ballbot_ros.plant.truth import GroundTruth, Push
from ballbot_ros.simulation.lockstep import Run
from ballbot_ros.simulation.outcome import Outcome
from ballbot_ros.simulation.participants import Membership, Participant
from ballbot_ros.world.world import World


class Severity(Enum):
    """How a log message is shown."""

    INFO = auto()
    WARNING = auto()


@dataclass(frozen=True)
class AnnounceRun:
    """Announce a run, for its participants to join it."""

    run: Run


@dataclass(frozen=True)
class CallRoll:
    """Ask every participant of a run to announce itself; the plant does so, too."""

    run: Run
    plant: Participant


@dataclass(frozen=True)
class PublishStatus:
    """Publish the account of a run.

    Attributes
    ----------
    run : Run
    is_lockstep : bool
    topics : tuple of str
        What the participants publish periodically.
    members : tuple of Membership
        Everybody who has taken part.
    summary : RunSummary or None
        None while the run goes on.
    """

    run: Run
    is_lockstep: bool
    topics: tuple[str, ...]
    members: tuple[Membership, ...]
    summary: RunSummary | None = None


@dataclass(frozen=True)
class BeginRun:
    """Publish what a run begins with: its map, if it has one, and that no wall is hit.

    Attributes
    ----------
    start_ns : int
        Stamp of the first tick [ns].
    world : World or None
    ball_radius : float
        Height of the ball's centre [m].
    """

    start_ns: int
    world: World | None
    ball_radius: float


@dataclass(frozen=True)
class ForgetMap:
    """Stop offering the map of an earlier run to late subscribers."""


@dataclass(frozen=True)
class PublishPush:
    """Publish when the push of this number begins and ends."""

    push: Push
    number: int


@dataclass(frozen=True)
class PublishTruth:
    """Publish the truth of a tick, and the time with it.

    Attributes
    ----------
    truth : GroundTruth
    wall_hit : bool
    is_resend : bool
        Whether it was published before.
    """

    truth: GroundTruth
    wall_hit: bool
    is_resend: bool = False


@dataclass(frozen=True)
class AskDrivers:
    """Publish again what the drivers answer at an earlier tick; the time stays what it is."""

    truth: GroundTruth


@dataclass(frozen=True)
class StopMotors:
    """Publish that the motors are off from the tick after `last_ns` on [ns]."""

    last_ns: int


@dataclass(frozen=True)
class Log:
    """Write a line to the log.

    Attributes
    ----------
    text : str
    severity : Severity
    is_throttled : bool
        Whether at most one such line a second is written.
    """

    text: str
    severity: Severity = Severity.INFO
    is_throttled: bool = False


@dataclass(frozen=True)
class Warn:
    """Show a warning in the diagnostics until it is cleared."""

    text: str


@dataclass(frozen=True)
class ClearWarning:
    """Take back the warning."""


@dataclass(frozen=True)
class RaiseError:
    """Show an error in the diagnostics until it is cleared."""

    text: str


@dataclass(frozen=True)
class ClearError:
    """Take back the error."""


@dataclass(frozen=True)
class Report:
    """Publish the diagnostics now."""


@dataclass(frozen=True)
class WakeIn:
    """Call ``on_wake`` once, after `delay_s` [s]; an earlier request is replaced."""

    delay_s: float


@dataclass(frozen=True)
class CancelWake:
    """Do not call ``on_wake``."""


@dataclass(frozen=True)
class EndRun:
    """Finish: the run has ended.

    Attributes
    ----------
    summary : RunSummary
    exit_status : int
        0, 1 if the run has failed, 2 for a mistake of the user.
    """

    summary: RunSummary
    exit_status: int


@dataclass(frozen=True)
class RunSummary:
    """Outcome and measurements of a run.

    Attributes
    ----------
    outcome : Outcome
    reason : str
        Why it has failed; otherwise ''.
    ticks : int
    duty_sha256 : str
        Hash of all duties.
    real_time_factor : float
        Sim time per wall time.
    late_ticks : int
        Ticks that came more than a period late.
    resends : int
        How often the plant asked again for a tick.
    round_trips_s : tuple of float
        Times from asking for duties to having them [s]; empty if they were not measured.
    start_ns : int
        Stamp of the first tick [ns].
    members : tuple of Membership
        Everybody who has taken part.
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


Action = (
    AnnounceRun
    | CallRoll
    | PublishStatus
    | BeginRun
    | ForgetMap
    | PublishPush
    | PublishTruth
    | AskDrivers
    | StopMotors
    | Log
    | Warn
    | ClearWarning
    | RaiseError
    | ClearError
    | Report
    | WakeIn
    | CancelWake
    | EndRun
)
Actions = list[Action]
