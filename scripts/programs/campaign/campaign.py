"""Breaks runs on purpose and judges the outcome: ``python -m campaign.campaign``."""

from __future__ import annotations

import fcntl
import json
import os
import random
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from datetime import datetime
from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape

from ballbot_ros.cli.command import invoke
from ballbot_ros.errors import BallbotError
from ballbot_ros.process import StopRequest
from campaign.fault import Verdict
from campaign.faults import BY_NAME, FAULTS
from campaign.schedule import Schedule, Trial, table_of
from campaign.site import DOMAINS_EACH, MARK, end_all
from campaign.trial import OWN_MEMORY

DOMAINS = range(20, 50)
"""ROS domains of the trials: neither the default domain nor those of the tests."""

AT_ONCE = 2
LIMIT_S = 300.0
"""Time limit of a trial, which then fails [s]."""

OVERTIME_S = 60.0
"""Time after the campaign's end at which running trials are cut off and do not count [s]."""

WIDTH = 100
"""Width of the table without a terminal."""

POLL_S = 0.1


@click.command(
    context_settings={'help_option_names': ['-h', '--help'], 'max_content_width': 100},
    epilog='\b\nFaults:\n' + '\n'.join(f'  {name}' for name in BY_NAME),
)
@click.option(
    '--minutes',
    type=click.FloatRange(0.1, 1440.0),
    default=10.0,
    show_default=True,
    help='Time for trials; a trial begins only if it is expected to end within this time.',
)
@click.option(
    '--seed', type=click.IntRange(0), help='Seed of all random choices.  [default: random]'
)
@click.option(
    '--only',
    type=click.Choice(list(BY_NAME)),
    metavar='FAULT',
    multiple=True,
    help='Test this fault; can be repeated.  [default: all, in the order of the list below]',
)
@click.option('--trial', type=click.IntRange(0), help='Run only this trial of the fault.')
@click.option(
    '--simulated',
    is_flag=True,
    help='Simulate the whole protocol without processes, thousands of trials a minute.',
)
@click.option(
    '--output',
    type=click.Path(path_type=Path, file_okay=False),
    help='Folder for the files of failed trials.  [default: runs/<date>_campaign]',
)
def campaign(
    minutes: float,
    seed: int | None,
    only: tuple[str, ...],
    trial: int | None,
    simulated: bool,
    output: Path | None,
) -> int:
    """Break runs at random moments, and judge the outcome.

    Prints the faults, how often the guarantees of docs/reliability.md held, and the longest time
    until everything had ended. The exit status is 0 if everything held, else 1, with the command
    that repeats each failed trial. Ctrl-C ends the campaign with the table so far.
    """
    if simulated and only:
        raise click.UsageError('--simulated draws all faults: leave out --only')
    if trial is not None and len(only) != 1 and not simulated:
        raise click.UsageError('--trial requires one fault: give --only once')
    seed = random.randrange(1_000_000) if seed is None else seed
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = WIDTH
    output = output or Path('runs', f'{datetime.now():%Y-%m-%d_%H-%M-%S}_campaign')
    if simulated:
        return simulate(seed, minutes, trial, output, console)
    wanted = [fault for fault in FAULTS if fault.name in (only or BY_NAME)]
    mounts = own_mounts()
    impossible = [fault.name for fault in wanted if fault.needs_mounts and not mounts]
    possible = [fault for fault in wanted if fault.name not in impossible]
    console.print(f'seed {seed}, {minutes:g} min')
    schedule = Schedule(possible, 60.0 * minutes)
    # Handle SIGINT here, so that the trials do not ignore it: in a shell's background job they
    # would inherit an ignored SIGINT.
    with StopRequest() as stop, Campaign(seed, output, mounts, console, stop) as conduct:
        if trial is None:
            conduct.follow(schedule)
        elif possible:
            conduct.follow_one(Trial(possible[0], trial))
    console.print(table_of(wanted, conduct.verdicts, impossible))
    if conduct.failures:
        console.print(f'Failed trials: {len(conduct.failures)}; their files are in {output}')
        for command in conduct.failures:
            console.print(f'  {command}', soft_wrap=True, markup=False)
    return 128 + stop.signal if stop.signal else 1 if conduct.failures else 0


def simulate(seed: int, minutes: float, trial: int | None, output: Path, console: Console) -> int:
    """Run simulated trials, or one of them; return the exit status."""
    # Imported only here: its modules are in test/.
    from campaign.simulated import SimulatedCampaign

    with StopRequest() as stop:
        conduct = SimulatedCampaign(seed, output, console, stop)
        if trial is None:
            console.print(f'seed {seed}, {minutes:g} min, simulated')
            conduct.follow(60.0 * minutes)
            conduct.print_summary()
        else:
            conduct.follow_one(trial)
    return 128 + stop.signal if stop.signal else 1 if conduct.failures else 0


class Campaign:
    """Runs trials, two at a time, each as a separate process.

    Parameters
    ----------
    seed : int
    output : Path
        Folder for the files of failed trials.
    mounts : sequence of str
        Prefix of a command that may mount; empty if there is none.
    console : Console
    stop : StopRequest
        Ends the campaign.

    Attributes
    ----------
    verdicts : dict of str to list of Verdict
        By the fault's name.
    failures : list of str
        The commands that repeat the failed trials.
    """

    def __init__(
        self,
        seed: int,
        output: Path,
        mounts: Sequence[str],
        console: Console,
        stop: StopRequest,
    ) -> None:
        self.verdicts: dict[str, list[Verdict]] = {}
        self.failures: list[str] = []
        self._seed = seed
        self._output = output
        self._mounts = mounts
        self._console = console
        self._stop = stop
        self._running: list[TrialProcess] = []
        self._stack = ExitStack()
        self._begun_s = time.monotonic()

    def __enter__(self) -> Campaign:
        self._scratch = Path(self._stack.enter_context(_scratch_folder()))
        self._domains = [self._stack.enter_context(free_domains()) for _ in range(AT_ONCE)]
        return self

    def __exit__(self, *error: object) -> None:
        for process in self._running:
            process.end()
        self._stack.close()

    def follow(self, schedule: Schedule) -> None:
        """Run the trials of a schedule."""
        while not self._stop.signal:
            now_s = time.monotonic() - self._begun_s
            while len(self._running) < AT_ONCE and (
                trial := schedule.next(now_s, [each.trial.fault for each in self._running])
            ):
                self._begin(trial)
            if now_s > schedule.length_s + OVERTIME_S:
                self._cut_off()
            if not self._running and not schedule.has_more(now_s):
                return
            for process in self._reap():
                schedule.took(process.trial.fault, process.age_s)
            time.sleep(POLL_S)

    def follow_one(self, trial: Trial) -> None:
        """Run one trial."""
        self._begin(trial)
        while self._running and not self._stop.signal:
            self._reap()
            time.sleep(POLL_S)

    def _begin(self, trial: Trial) -> None:
        taken = [process.domains for process in self._running]
        domains = next(each for each in self._domains if each not in taken)
        name = f'{trial.fault.name} {trial.number}'.replace(' ', '_').replace('/', '_')
        process = TrialProcess(trial, self._seed, self._scratch / name, domains, self._mounts)
        self._running.append(process)

    def _cut_off(self) -> None:
        for process in self._running:
            process.end()
            self._console.print(f'       cut off: {process.trial.fault.name}')
        self._running.clear()

    def _reap(self) -> list[TrialProcess]:
        ended = [process for process in self._running if process.has_ended]
        for process in ended:
            self._running.remove(process)
            attempt, verdict = process.verdict()
            trial = process.trial
            self.verdicts.setdefault(trial.fault.name, []).append(verdict)
            now_s = time.monotonic() - self._begun_s
            mark = '[green]held[/]' if verdict.holds else '[red]did not hold[/]'
            line = f'{now_s:5.0f} s  {mark}  {trial.fault.name}: {escape(attempt)}'
            self._console.print(line, soft_wrap=True)
            if not verdict.holds:
                self._keep(process, verdict)
            shutil.rmtree(process.folder, ignore_errors=True)
        return ended

    def _keep(self, process: TrialProcess, verdict: Verdict) -> None:
        for failure in verdict.failures:
            self._console.print(f'         {failure}', markup=False, soft_wrap=True)
        self._output.mkdir(parents=True, exist_ok=True)
        shutil.copytree(process.folder, self._output / process.folder.name, dirs_exist_ok=True)
        words = ['scripts/campaign', '--seed', str(self._seed), '--only', process.trial.fault.name]
        self.failures.append(shlex.join([*words, '--trial', str(process.trial.number)]))


class TrialProcess:
    """A running trial.

    Parameters
    ----------
    trial : Trial
    seed : int
        Seed of the campaign.
    folder : Path
        Folder for everything that it writes.
    domains : sequence of int
    mounts : sequence of str
        Prefix of a command that may mount; empty if there is none.
    """

    def __init__(
        self,
        trial: Trial,
        seed: int,
        folder: Path,
        domains: Sequence[int],
        mounts: Sequence[str],
    ) -> None:
        self.trial, self.folder, self.domains = trial, folder, domains
        self._begun_s = time.monotonic()
        folder.mkdir(parents=True)
        words = [trial.fault.name, seed, trial.number, folder, *domains]
        command = [*mounts, sys.executable, '-m', 'campaign.trial', *map(str, words)]
        self._output = folder / 'trial.txt'
        with self._output.open('wb') as output:
            self._process = subprocess.Popen(
                [*command, OWN_MEMORY] if mounts else command,
                env={**os.environ, MARK: str(folder)},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    @property
    def age_s(self) -> float:
        """Time since it began [s]."""
        return time.monotonic() - self._begun_s

    @property
    def has_ended(self) -> bool:
        """Whether it has ended, or exceeded its limit."""
        if self._process.poll() is None and self.age_s > LIMIT_S:
            self.end()
        return self._process.poll() is not None

    def end(self) -> None:
        """Kill it and all its processes."""
        end_all(self.folder)
        self._process.wait()

    def verdict(self) -> tuple[str, Verdict]:
        """Return a description of the trial, and the verdict.

        A trial without a verdict counts as failed.
        """
        last = self._output.read_text(errors='replace').strip().rpartition('\n')[2]
        try:
            found = json.loads(last)
            attempt = found.pop('attempt')
            return attempt, Verdict(tuple(found.pop('failures')), **found)
        except (ValueError, AttributeError, KeyError, TypeError):
            how = f'trial {self.trial.number} ended with status {self._process.returncode}: {last}'
            return 'no verdict', Verdict((how,), self.age_s, LIMIT_S)


def own_mounts() -> list[str]:
    """Return the prefix of a command that gets its own mounts and ``/dev/shm``.

    The list is empty if the machine does not allow this.
    """
    as_root = [] if os.geteuid() == 0 else ['--map-root-user']
    script = 'mount -t tmpfs tmpfs /dev/shm && exec "$@"'
    command = ['unshare', *as_root, '--mount', 'sh', '-c', script, 'sh']
    try:
        done = subprocess.run([*command, 'true'], capture_output=True, check=False)
    except FileNotFoundError:
        return []
    return [] if done.returncode else command


@contextmanager
def free_domains() -> Iterator[tuple[int, ...]]:
    """Yield ROS domains that no other campaign on this machine uses.

    Raises
    ------
    BallbotError
        If there are none.
    """
    with ExitStack() as locks:
        found: list[int] = []
        for domain in DOMAINS:
            path = Path(tempfile.gettempdir(), f'ballbot_campaign_domain_{domain}.lock')
            lock = path.open('w')
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                lock.close()
                continue
            locks.enter_context(lock)
            found.append(domain)
            if len(found) == DOMAINS_EACH:
                yield tuple(found)
                return
    raise BallbotError('other campaigns use all ROS domains: wait until one of them has ended')


def _scratch_folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix='ballbot_campaign_')


if __name__ == '__main__':
    sys.exit(invoke(campaign, 'scripts/campaign'))
