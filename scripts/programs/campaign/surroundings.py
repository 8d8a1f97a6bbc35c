"""Faults around a run: a full disk, a busy machine."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from campaign.fault import Verdict
from campaign.run import (
    Run,
    judge_completed,
    judge_end,
    judge_failed,
    judge_printed,
    judge_recording,
    ticks_of,
    undisturbed,
    undisturbed_duties,
)
from campaign.signals import LONG_S, SHORT_S, Moment
from campaign.site import Site

DISK_BOUND_S = 45.0
BUSY_BOUND_S = 120.0
NO_SPACE = 'No space left on device'
DISK_MB = 32

BUSY_LOOPS = 4
LOOP = 'while True: pass'
RUNS_AT_ONCE = 3


@contextmanager
def file_system(folder: Path, size_kb: int, access: str = 'rw') -> Iterator[None]:
    """Mount a separate file system of this size [KiB] in a folder; `access` is 'rw' or 'ro'."""
    folder.mkdir(exist_ok=True)
    options = ['-o', f'size={size_kb}k,{access}']
    subprocess.run(['mount', '-t', 'tmpfs', *options, 'tmpfs', folder], check=True)
    try:
        yield
    finally:
        subprocess.run(['umount', '--lazy', folder], check=True)


class Disk(Enum):
    """Content of the disk that fills up."""

    RECORDING = 'the recording'
    TEMPORARY = 'temporary files'


@dataclass(frozen=True)
class FullDisk:
    """A disk that fills up during a run.

    Attributes
    ----------
    disk : Disk
    size_kb : int
        Size of the disk [KiB].
    """

    disk: Disk
    size_kb: int

    def __str__(self) -> str:
        return f'{self.size_kb} KiB for {self.disk.value}'

    @classmethod
    def draw(cls, generator: random.Random, index: int) -> FullDisk:
        """Draw a disk that is full at once or after some seconds; the two disks alternate."""
        disk = list(Disk)[index % len(Disk)]
        sizes = (4, 16, 64, 256, 1024) if disk is Disk.RECORDING else (4, 8, 16, 32)
        return cls(disk, generator.choice(sizes) + generator.choice((0, 4)))

    def carry_out(self, site: Site) -> Verdict:
        """Run until the disk is full."""
        output = site.folder / 'disk'
        is_of_recording = self.disk is Disk.RECORDING
        with file_system(output if is_of_recording else site.temporary, self.size_kb):
            duration = LONG_S if is_of_recording else SHORT_S
            run = Run(site, duration, output=output / 'run', real_time_factor=0.0)
            end = run.await_end(DISK_BOUND_S)
        expected = undisturbed_duties(site, end.most_ticks)
        failures = judge_printed(end.text) + judge_end(end.end, DISK_BOUND_S)
        if end.completed and not is_of_recording:
            sha256 = undisturbed(site, ticks_of(SHORT_S)).duty_sha256
            failures += judge_completed(end, sha256)
        elif end.result:
            # The recording remains the reason if the picture can't be written, either.
            named = f'{run.recording.name}: {NO_SPACE}' if is_of_recording else NO_SPACE
            failures += judge_failed(end, [named])
        elif end.end.status not in (1, 2) or NO_SPACE not in end.text:
            failures.append(f'status {end.end.status}, without mentioning {NO_SPACE!r}')
        failures += judge_recording(end, expected, lost_ticks=end.ticks, must_be_finished=False)
        return Verdict(tuple(failures), end.end.took_s, DISK_BOUND_S)


@contextmanager
def failing_disk(folder: Path, image: Path) -> Iterator[Callable[[], None]]:
    """Mount a disk of its own in a folder; yield what makes it fail, and so read-only."""
    folder.mkdir()
    with image.open('wb') as file:
        file.truncate(DISK_MB << 20)
    subprocess.run(['mkfs.ext4', '-q', image], check=True)
    subprocess.run(['mount', '-o', 'loop,errors=remount-ro', image, folder], check=True)
    device = folder.stat().st_dev
    name = Path(f'/sys/dev/block/{os.major(device)}:{os.minor(device)}').resolve().name
    try:
        yield lambda: _fail(name)
    finally:
        subprocess.run(['umount', '--lazy', folder], check=True)


def _fail(disk: str) -> None:
    Path(f'/sys/fs/ext4/{disk}/trigger_fs_error').write_text('1')


@dataclass(frozen=True)
class FailingDisk:
    """The recording's disk fails in mid-run, so that the system makes it read-only.

    Attributes
    ----------
    delay_s : float
        Delay from the first tick [s].
    """

    delay_s: float

    def __str__(self) -> str:
        return f"the recording's disk fails after {self.delay_s:.3f} s"

    @classmethod
    def draw(cls, generator: random.Random, index: int) -> FailingDisk:
        """Draw the moment."""
        return cls(Moment.MIDDLE.delay_s(generator))

    def carry_out(self, site: Site) -> Verdict:
        """Let the disk fail, and judge the end of the run."""
        output = site.folder / 'disk'
        with failing_disk(output, site.folder / 'image') as fail:
            run = Run(site, LONG_S, output=output / 'run')
            run.await_ticks()
            time.sleep(self.delay_s)
            fail()
            end = run.await_end(DISK_BOUND_S)
        expected = undisturbed_duties(site, end.most_ticks)
        failures = judge_printed(end.text) + judge_end(end.end, DISK_BOUND_S)
        failures += judge_failed(end, [f'{run.recording.name}: '])
        failures += judge_recording(end, expected, lost_ticks=end.ticks, must_be_finished=False)
        return Verdict(tuple(failures), end.end.took_s, DISK_BOUND_S)


@dataclass(frozen=True)
class BusyMachine:
    """Simultaneous runs next to processes that compute forever."""

    def __str__(self) -> str:
        return f'{RUNS_AT_ONCE} simultaneous runs next to {BUSY_LOOPS} busy loops'

    @classmethod
    def draw(cls, generator: random.Random, index: int) -> BusyMachine:
        """Return the fault, which has no random choices."""
        return cls()

    def carry_out(self, site: Site) -> Verdict:
        """Keep the machine busy, and judge each run."""
        sha256 = undisturbed(site, ticks_of(SHORT_S)).duty_sha256
        failures = []
        with ExitStack() as stack:
            loops = [subprocess.Popen([sys.executable, '-c', LOOP]) for _ in range(BUSY_LOOPS)]
            for loop in loops:
                stack.callback(loop.wait)
                stack.callback(loop.kill)
            busy = [loop.pid for loop in loops]
            runs = [
                Run(site, SHORT_S, name=f'run_{domain}', domain=domain, real_time_factor=0.0)
                for domain in site.domains[:RUNS_AT_ONCE]
            ]
            ends = [run.await_end(BUSY_BOUND_S, beside=busy) for run in runs]
        for end in ends:
            failures += judge_printed(end.text) + judge_completed(end, sha256)
        took_s = max(end.end.took_s for end in ends)
        return Verdict(tuple(failures), took_s, BUSY_BOUND_S)
