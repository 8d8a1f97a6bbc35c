"""A run in a trial: starting it, and judging its end."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.scenario.reader import load_scenario
from ballbot_ros.engine.trajectory import TrajectoryLog
from ballbot_ros.parameters import PLANT
from ballbot_ros.parameters.timing import SECOND_NS, TICK_NS
from campaign.remains import Remains, read_remains
from campaign.site import BALLBOT, End, Program, Site, wait_until

NAME = 'balance'
START_PITCH_DEG = 4.0
SCENARIO = f"""purpose: balances from a pitch of {START_PITCH_DEG:g} degrees, whatever it takes
duration: 60.0
start:
  pitch_x_deg: {START_PITCH_DEG}
"""
"""Like the scenario `stationary`, but without expectations: a short run passes, too."""

FIRST_TICKS_BYTES = 20_000
"""Size of a file above which it contains messages, not only attachments [byte]."""

CRASH = re.compile(
    r'Traceback \(most recent call last\)|Segmentation fault|core dumped|terminate called'
    r'|Fatal Python error|was killed by SIG(?:SEGV|ABRT|BUS|FPE|ILL)'
)


@dataclass(frozen=True)
class RunEnd:
    """The end of a run: exit status, output, result and recording.

    Attributes
    ----------
    end : End
        End of its processes.
    text : str
        All its output.
    result : mapping
        Its result as JSON; empty if none was printed.
    remains : Remains or None
        Content of the recording; None if there is none.
    """

    end: End
    text: str
    result: Mapping[str, Any]
    remains: Remains | None

    @property
    def ticks(self) -> int:
        """Ticks of the run according to its result."""
        return int(self.result.get('ticks') or 0)

    @property
    def most_ticks(self) -> int:
        """Ticks according to the result or the recording, whichever has more."""
        return max(self.ticks, len(self.remains.duties) if self.remains else 0)

    @property
    def reason(self) -> str:
        """Why it failed; without a result, the last line that it has printed."""
        last = self.text.splitlines()[-1:]
        return str(self.result.get('reason', ''.join(last)))

    @property
    def completed(self) -> bool:
        """Whether it reached its end despite the fault."""
        return self.result.get('outcome') == 'passed'


class Run:
    """`ballbot run` as a process of a trial.

    Parameters
    ----------
    site : Site
    duration : float
        Sim time [s].
    *settings : str
        More parameters of the run, as ``node.param=value``.
    output : Path, optional
        Folder of the recording; by default in the site's folder.
    name : str
        Name of its output files.
    domain : int, optional
        A domain other than the site's first.
    real_time_factor : float
    processes : str
    """

    def __init__(
        self,
        site: Site,
        duration: float,
        *settings: str,
        output: Path | None = None,
        name: str = 'run',
        domain: int | None = None,
        real_time_factor: float = 1.0,
        processes: str = 'separate',
    ) -> None:
        folder = output or site.folder / f'{name}_output'
        words = ['run', write_scenario(site.folder), '--json', '--output', folder]
        words += ['--real-time-factor', real_time_factor, '--processes', processes]
        for setting in (f'{PLANT}.duration={duration}', *settings):
            words += ['--set', setting]
        self._site = site
        self.recording = folder / f'{NAME}.mcap'
        self.program: Program = site.start(name, *BALLBOT, *words, domain=domain)

    def has_ticks(self) -> bool:
        """Whether the first ticks are in the recording."""
        try:
            return self.recording.stat().st_size > FIRST_TICKS_BYTES
        except OSError:
            return False

    def await_ticks(self) -> None:
        """Wait until the first ticks are in the recording, or the run has ended."""
        wait_until(lambda: self.has_ticks() or self.program.status is not None, 'the first tick')

    def await_end(self, bound_s: float, beside: Collection[int] = ()) -> RunEnd:
        """Wait until the run and all other processes of the trial except `beside` have ended."""
        end = self._site.await_end(self.program, bound_s, beside)
        return RunEnd(
            end, self.program.text, self.result(), read_remains(self.recording, self._site.folder)
        )

    def result(self) -> dict[str, Any]:
        """Return the printed result; empty if there is none."""
        try:
            found = json.loads(self.program.stdout)
        except ValueError:
            return {}
        return found if isinstance(found, dict) else {}


def write_scenario(folder: Path) -> Path:
    """Write the scenario of the trials, and return its file."""
    path = folder / f'{NAME}.yaml'
    path.write_text(SCENARIO)
    return path


def undisturbed(site: Site, ticks: int) -> TrajectoryLog:
    """Return the trajectory of an undisturbed run of this many ticks."""
    scenario = load_scenario(str(write_scenario(site.folder)))
    loop, log = ClosedLoop(scenario.parameters, scenario), TrajectoryLog()
    for _ in range(ticks):
        tick = loop.tick()
        log.add(tick.truth, *tick.outputs.duty)
    return log


def undisturbed_duties(site: Site, ticks: int) -> list[tuple[float, float]]:
    """Return the duties [%] of an undisturbed run of this many ticks."""
    duty = undisturbed(site, ticks).trajectory().duty
    return [(float(x), float(y)) for x, y in duty]


def ticks_of(duration: float) -> int:
    """Return the number of ticks in a time [s]."""
    return round(duration * SECOND_NS) // TICK_NS


# --- Judging ------------------------------------------------------------------------------------


def judge_printed(text: str) -> list[str]:
    """Judge whether anything has crashed."""
    found = CRASH.search(text)
    return [f'printed {found[0]!r}'] if found else []


def judge_end(end: End, bound_s: float) -> list[str]:
    """Judge whether everything has ended in time, and nothing has outlived the command."""
    if end.status is None:
        return [f'still running {bound_s:.0f} s after the fault']
    if end.survivors:
        return [f'left processes behind: {", ".join(end.survivors)}']
    return []


def judge_completed(run: RunEnd, duty_sha256: str) -> list[str]:
    """Judge whether a completed run has the duties of an undisturbed one, all recorded."""
    failures = []
    if run.result.get('outcome') != 'passed' or run.end.status != 0:
        outcome = run.result.get('outcome', 'none')
        failures.append(f'outcome {outcome}, status {run.end.status}: {run.reason}')
    elif run.result.get('duty_sha256') != duty_sha256:
        failures.append('the duties differ from those of an undisturbed run')
    recorded = len(run.remains.duties) if run.remains else 0
    if not failures and recorded != run.ticks:
        failures.append(f'recorded {recorded} duties of {run.ticks}')
    if run.remains and run.remains.motors_off:
        failures.append('completed, but with the motors off')
    return failures


def judge_failed(run: RunEnd, named: Collection[str], status: int = 1) -> list[str]:
    """Judge whether a run failed with this status, for a reason that contains one of `named`."""
    failures = []
    outcome = run.result.get('outcome', 'none')
    if run.end.status != status or outcome != 'failed':
        failures.append(
            f'outcome {outcome}, status {run.end.status}; expected outcome failed, status {status}'
        )
    if not any(name in run.reason for name in named):
        failures.append(f'the reason does not name {" or ".join(named)}: {run.reason!r}')
    return failures


def judge_recording(
    run: RunEnd,
    undisturbed: Collection[tuple[float, float]],
    *,
    lost_ticks: int = 0,
    must_be_finished: bool = True,
    motors_off: bool = False,
    beside_stranger: bool = False,
) -> list[str]:
    """Judge whether the recording is readable, and has the correct duties up to the end.

    Parameters
    ----------
    run : RunEnd
    undisturbed : collection of tuple
        Duties of an undisturbed run with as many ticks.
    lost_ticks : int
        Maximum number of ticks missing at its end.
    must_be_finished : bool
        Whether the recorder must have finished the file.
    motors_off : bool
        Whether the last duty must be a motor stop.
    beside_stranger : bool
        Whether a stranger's messages may be among those of the run.
    """
    remains = run.remains
    if remains is None:
        return (
            [f'no recording, although the run had {run.ticks} ticks']
            if run.ticks > lost_ticks
            else []
        )
    if remains.problem:
        return [f'the recording cannot be read: {remains.problem}']
    failures = []
    if must_be_finished and not remains.finished:
        failures.append('the recording is not finished')
    if must_be_finished and remains.missing:
        failures.append(f'the recording is incomplete: {remains.missing}')
    if remains.strange and not beside_stranger:
        failures.append(f'{remains.strange} recorded duties do not belong to the next tick')
    duties, expected = remains.duties, list(undisturbed)
    if len(duties) < run.ticks - lost_ticks:
        failures.append(f'recorded {len(duties)} duties of {run.ticks}')
    wrong = [tick for tick, pair in enumerate(duties) if pair != expected[tick]]
    if wrong:
        failures.append(
            f'from tick {wrong[0]} on, the duties differ from those of an undisturbed run'
        )
    if motors_off and duties and not remains.motors_off:
        failures.append(f'the last recorded duty is {duties[-1]}: the motors are not off')
    return failures
