"""The recorder's part in the runs: what belongs to which run, and what is complete."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from ballbot_ros.lockstep.lockstep import RunIdentity
from ballbot_ros.lockstep.recording_order import RecordedTicks, RecordingGate, Stream, Writer
from ballbot_ros.lockstep.run_actions import Outcome


@dataclass(frozen=True)
class RunStatus:
    """The plant's status of a run, published at its first tick and at its end.

    `run` is the name of the run in ``plant/run``, and `result` has the `OUTCOME_KEYS` of a run that
    has ended.
    """

    run: str
    is_lockstep: bool
    periodic_topics: tuple[str, ...]
    participants: Mapping[str, str]
    result: Mapping[str, str] = field(default_factory=dict)


class RunRecording:
    """Passes the messages of each run to the gate, and detects complete ticks.

    `streams` returns the streams to record by the names of their topics. `outcome` and `members`
    are the result and the participants of the run according to its status.
    """

    def __init__(self, writer: Writer, streams: Callable[[], Iterable[tuple[str, Stream]]]) -> None:
        self._writer, self._streams = writer, streams
        self.gate, self.ticks = RecordingGate(writer), RecordedTicks()
        self.run: str | None = None
        self.outcome: Mapping[str, str] = {}
        self.members: Mapping[str, str] = {}
        self._announced: RunIdentity | None = None
        self._status: RunStatus | None = None
        self._stop: tuple[Stream, int, bytes, int] | None = None

    def join(self, run: RunIdentity) -> None:
        """Begin a run in which the recorder takes part."""
        self.gate.takes_part = True
        self.write_stop()
        self._begin(run)

    def announces(self, run: RunIdentity) -> bool:
        """Note an announced run; return whether the announcement is to be recorded.

        It begins the first run: a player announces runs, but does not call the roll.
        """
        if run == self._announced:
            return False
        if self.run is None:
            self._begin(run)
        self._announced = run
        return True

    def _begin(self, run: RunIdentity) -> None:
        self.run, self.outcome, self.members, self._stop = run.name, {}, {}, None
        if self.gate.begin(run, [stream for _, stream in self._streams()]):
            self.ticks.begin()
        self._take_status()

    def note_status(self, status: RunStatus) -> None:
        """Note from the plant's status what the run requires, and how it ended."""
        self._status = status
        self._take_status()

    def _take_status(self) -> None:
        status = self._status
        if status and status.run == self.run:
            self.gate.is_lockstep = status.is_lockstep
            required = status.periodic_topics
            self.ticks.require(stream for name, stream in self._streams() if name in required)
            self.outcome, self.members = status.result, status.participants

    def hold_stop(self, stream: Stream, stamp_ns: int, data: bytes, sequence: int) -> None:
        """Hold a motor stop back: it is recorded only if the run does not complete.

        A controller that leaves in mid-run sends one, too.
        """
        self._stop = self._stop or (stream, stamp_ns, data, sequence)

    def write_stop(self) -> None:
        """Write that the motors are off, unless the run has completed."""
        if self._stop and self.outcome.get('outcome') != Outcome.COMPLETED:
            self._writer.keep(*self._stop)

    @property
    def is_under_way(self) -> bool:
        """Whether a run in which the recorder takes part has begun, and more of it may arrive."""
        if not (self.gate.takes_part and self.gate.now_ns):
            return False
        if self._stop is None:
            return self.outcome.get('outcome') != Outcome.COMPLETED
        # The samples that the last duty answers may arrive after it, and after the stop.
        return self.gate.is_lockstep and self._stop[0].newest_ns > self.ticks.acked_ns
