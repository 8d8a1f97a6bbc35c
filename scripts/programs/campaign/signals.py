"""Signals to a node or to the command, at a random moment of a run."""

from __future__ import annotations

import os
import random
import time
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from functools import partial
from signal import Signals

from ballbot_ros.parameters import NODES, PLANT, RECORDER
from ballbot_ros.parameters.timing import SECOND_NS, TICK_NS
from campaign.fault import Verdict
from campaign.run import (
    Run,
    RunEnd,
    judge_completed,
    judge_end,
    judge_failed,
    judge_printed,
    judge_recording,
    ticks_of,
    undisturbed,
    undisturbed_duties,
)
from campaign.site import Site, wait_until

LONG_S, SHORT_S = 60.0, 1.5
"""Sim time of a run that outlasts the fault, and of one that may end before it [s]."""

STARTUP_TIMEOUT_S = 10.0
HANG_AT_START_S = 30.0
"""Time after which the command gives up a plant that has never reported [s]."""

STOP_S = 15.0
"""Time limit to name a fault, stop the nodes and finish the recording, of which 3, 1.5 and 5 s are
guaranteed; the rest is for the end of the processes [s]."""

LOSS_TICKS = SECOND_NS // TICK_NS + 50
"""Ticks that a killed recorder may lose: those of a second, and of the plant's lead."""


class Moment(Enum):
    """The moment of a signal; its text follows the name of a fault."""

    START = 'before the first tick'
    MIDDLE = 'in mid-run'
    END = 'near the end'

    @property
    def duration_s(self) -> float:
        """Sim time of the run [s]."""
        return SHORT_S if self is Moment.END else LONG_S

    def delay_s(self, generator: random.Random) -> float:
        """Draw the delay [s], from the victim's start for `START`, else from the first tick."""
        earliest, latest = {
            Moment.START: (0.0, 1.5),
            Moment.MIDDLE: (0.0, 2.5),
            Moment.END: (0.4, SHORT_S + 0.5),
        }[self]
        return generator.uniform(earliest, latest)


@dataclass(frozen=True)
class NodeSignal:
    """A signal to a node of a run.

    Attributes
    ----------
    victim : str
    number : Signals
    moment : Moment
    delay_s : float
        Delay from the moment [s].
    """

    victim: str
    number: Signals
    moment: Moment
    delay_s: float

    def __str__(self) -> str:
        return (
            f'{self.number.name} to {self.victim} {self.moment.value}, after {self.delay_s:.3f} s'
        )

    @classmethod
    def draw(
        cls,
        generator: random.Random,
        index: int,
        *,
        moment: Moment,
        signals: tuple[Signals, ...],
    ) -> NodeSignal:
        """Draw a signal; in seven consecutive trials each node is the victim once."""
        victim = NODES[index % len(NODES)]
        return cls(victim, generator.choice(signals), moment, moment.delay_s(generator))

    @property
    def hangs_at_start(self) -> bool:
        """Whether only a timeout can distinguish the victim from a node that starts slowly."""
        return self.moment is Moment.START and self.number == Signals.SIGSTOP

    @property
    def bound_s(self) -> float:
        """Time limit until everything has ended [s]."""
        if self.hangs_at_start:
            return STOP_S + (HANG_AT_START_S if self.victim == PLANT else STARTUP_TIMEOUT_S)
        return STOP_S

    def carry_out(self, site: Site) -> Verdict:
        """Send the signal, and judge the end of the run."""
        # Shorten the default timeout of 30 s, after which a hung node is named.
        settings = [f'{PLANT}.startup_timeout={STARTUP_TIMEOUT_S}'] if self.hangs_at_start else []
        run = Run(site, self.moment.duration_s, *settings)
        if self.moment is Moment.START:
            wait_until(lambda: self.victim in run.program.nodes(), self.victim)
        else:
            run.await_ticks()
        victim = run.program.nodes().get(self.victim)
        time.sleep(self.delay_s)
        # Send nothing to a node that has ended: its process id may belong to another process.
        if victim and victim in site.alive():
            with suppress(ProcessLookupError):
                os.kill(victim, self.number)
        end = run.await_end(self.bound_s)
        expected = undisturbed_duties(site, end.most_ticks)
        failures = self.judge(end, expected, undisturbed(site, ticks_of(SHORT_S)).duty_sha256)
        return Verdict(tuple(failures), end.end.took_s, self.bound_s)

    def judge(
        self, run: RunEnd, expected: list[tuple[float, float]], short_sha256: str
    ) -> list[str]:
        """Return the broken guarantees.

        Parameters
        ----------
        run : RunEnd
        expected : list of tuple
            The duties of an undisturbed run.
        short_sha256 : str
            Hash of the duties of a short run.
        """
        failures = judge_printed(run.text) + judge_end(run.end, self.bound_s)
        if run.end.status is None:
            return failures
        completed = self.moment is Moment.END and run.completed
        if completed:
            failures += judge_completed(run, short_sha256)
        else:
            failures += judge_failed(run, [self.victim])
        of_recorder = self.victim == RECORDER
        failures += judge_recording(
            run,
            expected,
            lost_ticks=LOSS_TICKS if of_recorder and not completed else 0,
            must_be_finished=not of_recorder,
            motors_off=not (of_recorder or completed or _has_every_tick(run)),
        )
        return failures


@dataclass(frozen=True)
class CommandSignal:
    """A signal to the command.

    Attributes
    ----------
    number : Signals
    moment : Moment
    delay_s : float
        Delay from the moment [s].
    """

    number: Signals
    moment: Moment
    delay_s: float

    def __str__(self) -> str:
        return f'{self.number.name} to ballbot run {self.moment.value}, after {self.delay_s:.3f} s'

    @classmethod
    def draw(
        cls, generator: random.Random, index: int, *, signals: tuple[Signals, ...]
    ) -> CommandSignal:
        """Draw a signal; the moments alternate."""
        moment = list(Moment)[index % len(Moment)]
        return cls(generator.choice(signals), moment, moment.delay_s(generator))

    def carry_out(self, site: Site) -> Verdict:
        """Send the signal, and judge the end of the command and its nodes."""
        run = Run(site, self.moment.duration_s)
        if self.moment is Moment.START:
            wait_until(lambda: bool(run.program.nodes()), 'the first node')
        else:
            run.await_ticks()
        time.sleep(self.delay_s)
        run.program.send(self.number)
        end = run.await_end(STOP_S)
        expected = undisturbed_duties(site, end.most_ticks)
        failures = self.judge(end, expected, undisturbed(site, ticks_of(SHORT_S)).duty_sha256)
        return Verdict(tuple(failures), end.end.took_s, STOP_S)

    def judge(
        self, run: RunEnd, expected: list[tuple[float, float]], short_sha256: str
    ) -> list[str]:
        """Return the broken guarantees; arguments as for a node's signal."""
        killed = self.number == Signals.SIGKILL
        failures = judge_printed(run.text)
        if killed:
            # A killed command does not stop its nodes, so they end by themselves, and later.
            if run.end.took_s > STOP_S:
                failures.append(f'nodes still alive {STOP_S:.0f} s after the command was killed')
        else:
            failures += judge_end(run.end, STOP_S)
        if run.end.status is None:
            return failures
        completed = run.completed and self.moment is Moment.END
        if completed:
            failures += judge_completed(run, short_sha256)
        elif run.end.status not in (128 + self.number, -self.number):
            failures.append(f'status {run.end.status}, expected {128 + self.number}')
        failures += judge_recording(
            run,
            expected,
            must_be_finished=not killed,
            motors_off=not (completed or _has_every_tick(run)),
        )
        return failures


class Helper(Enum):
    """A process that belongs to a run, but is none of its nodes."""

    FORK_SERVER = 'fork_server'
    END_GUARD = 'end_guard'

    @property
    def processes(self) -> str:
        """The way of running that has this process."""
        return 'separate' if self is Helper.FORK_SERVER else 'one'


class HelperMoment(Enum):
    """The moment of a signal to a helper."""

    START = 'before the first fork'
    NODES = 'before the first tick'
    MIDDLE = 'in mid-run'
    END = 'near the end'


@dataclass(frozen=True)
class HelperSignal:
    """A signal to a helper of a run.

    Attributes
    ----------
    helper : Helper
    number : Signals
    moment : HelperMoment
    delay_s : float
        Delay from the moment [s].
    """

    helper: Helper
    number: Signals
    moment: HelperMoment
    delay_s: float

    def __str__(self) -> str:
        what = f'{self.number.name} to {self.helper.value} {self.moment.value}'
        return f'{what}, after {self.delay_s:.3f} s'

    @classmethod
    def draw(cls, generator: random.Random, index: int) -> HelperSignal:
        """Draw a signal; in twelve consecutive trials the fork server gets each at each moment."""
        moments = list(HelperMoment)
        numbers = (Signals.SIGSTOP, Signals.SIGKILL, Signals.SIGTERM)
        moment, number = moments[index % 4], numbers[index // 4 % 3]
        helper = Helper.END_GUARD if generator.random() < 0.2 else Helper.FORK_SERVER
        delay = {
            HelperMoment.START: 0.3,
            HelperMoment.NODES: 0.6,
            HelperMoment.MIDDLE: 2.5,
            HelperMoment.END: SHORT_S + 0.5,
        }[moment]
        return cls(helper, number, moment, generator.uniform(0.0, delay))

    def carry_out(self, site: Site) -> Verdict:
        """Send the signal, and judge the end of the run."""
        duration = SHORT_S if self.moment is HelperMoment.END or self._is_guard else LONG_S
        run = Run(site, duration, processes=self.helper.processes)
        find = partial(run.program.find, self.helper.value)
        wait_until(lambda: bool(find()) or run.program.status is not None, self.helper.value)
        if self.moment is HelperMoment.NODES and not self._is_guard:
            wait_until(lambda: bool(run.program.nodes()), 'the first node')
        elif self.moment is not HelperMoment.START:
            run.await_ticks()
        time.sleep(self.delay_s)
        if helper := find():
            with suppress(ProcessLookupError):
                os.kill(helper, self.number)
        end = run.await_end(STOP_S)
        expected = undisturbed_duties(site, end.most_ticks)
        failures = self.judge(end, expected, undisturbed(site, ticks_of(SHORT_S)).duty_sha256)
        return Verdict(tuple(failures), end.end.took_s, STOP_S)

    @property
    def _is_guard(self) -> bool:
        return self.helper is Helper.END_GUARD

    def judge(
        self, run: RunEnd, expected: list[tuple[float, float]], short_sha256: str
    ) -> list[str]:
        """Return the broken guarantees; arguments as for a node's signal."""
        failures = judge_printed(run.text) + judge_end(run.end, STOP_S)
        if run.end.status is None:
            return failures
        completed = run.completed and (self._is_guard or self.moment is HelperMoment.END)
        if completed or self._is_guard:
            return failures + judge_completed(run, short_sha256) + judge_recording(run, expected)
        if run.result:
            failures += judge_failed(run, [self.helper.value])
        elif run.end.status != 2 or self.helper.value not in run.text:
            failures.append(f'status {run.end.status}, without naming {self.helper.value}')
        return failures + judge_recording(run, expected)


def _has_every_tick(run: RunEnd) -> bool:
    """Whether every tick of a short run is recorded: it may have ended before the fault."""
    return run.remains is not None and len(run.remains.duties) == ticks_of(SHORT_S)
