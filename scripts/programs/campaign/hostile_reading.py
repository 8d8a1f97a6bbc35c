"""Hostile recordings, read with every command in one process.

``python -m campaign.hostile_reading --count 10000``
"""

from __future__ import annotations

import os
import resource
import shutil
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from io import BytesIO, TextIOWrapper
from pathlib import Path
from unittest.mock import patch

import click

from ballbot_ros.cli.command import invoke, load_command
from ballbot_ros.cli.recordings import read_playback_runs
from ballbot_ros.recording.playback import Playback
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.run.execution import execute
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.spec import RunOptions, RunSpec
from campaign.hostile_files import Content, hostile_file

BOUND_S = 20.0
"""Processor time that a command may take [s]."""

BOUND_MB = 400
"""Memory by which this process may grow during a command [MB]."""

RARELY = 50
"""Every so many files the slow commands read one, too."""

FILE = 'hostile.mcap'


def commands(number: int) -> dict[str, tuple[str, ...]]:
    """Return the arguments of the commands that read the file of a number."""
    chosen = {
        'info': ('info', FILE, '--json') if number % 2 else ('info', FILE),
        'repair': ('repair', FILE, '--output', 'repaired.mcap'),
        'replay': ('replay', FILE),
        'export': ('export', FILE, '--to', 'csv', '--output', 'tables'),
        'compare': ('compare', FILE, FILE, '--json') if number % 2 else ('compare', FILE, FILE),
    }
    match number % RARELY:
        case 0:
            chosen['report'] = ('report', FILE, '--output', 'report')
        case 10 | 20 | 30 | 40:
            chosen['joined'] = ('export', FILE, '--to', 'csv', '--joined', '--output', 'joined')
        case 15 | 35:
            chosen['log'] = ('export', FILE, '--to', 'log', '--output', 'log')
        case 25:
            chosen['identify'] = ('identify', FILE)
        case 45:
            chosen['parquet'] = ('export', FILE, '--to', 'parquet', '--output', 'parquet')
    return chosen


def watch() -> None:
    """Read a recording as `ballbot view` and `ballbot render` do, and look at some times."""
    for run in read_playback_runs(Path(FILE), None):
        for moment in (0.0, 0.05, run.end, 1e9):
            run.snapshot(moment)
            run.trail(moment)
        for topic in run.topics():
            run.read_topic(topic, lambda done, total: None)


def play() -> None:
    """Play a recording as the player does."""
    with RecordingReader(FILE) as reader:
        playback = Playback(reader, None, rate=1.0, is_looping=False)
        for moment in (0.0, 0.1, 1e9):
            for _, _ in zip(range(10_000), playback.due(moment), strict=False):
                pass


def size_mb(which: str) -> float:
    """Return a size of this process [MB]: VmRSS now, VmHWM the largest since it was forgotten."""
    status = dict(line.split(':') for line in Path('/proc/self/status').read_text().splitlines())
    return int(status[which].split()[0]) / 1024


def _failures(name: str, command: click.Command, words: Sequence[str] = ()) -> Iterator[str]:
    """Run a command; yield what it must not do."""
    begin_s = time.process_time()
    Path('/proc/self/clear_refs').write_text('5')  # forget the largest size so far
    before_mb = size_mb('VmRSS')
    output, errors = (TextIOWrapper(BytesIO(), 'utf-8', 'backslashreplace') for _ in range(2))
    argv = patch.object(sys, 'argv', ['ballbot', *words])
    try:
        with redirect_stdout(output), redirect_stderr(errors), argv:
            invoke(command, 'ballbot')
    except BaseException as error:
        trace = ''.join(traceback.format_exception(error)[-9:])
        yield f'{name}: {type(error).__name__}: {str(error)[:200]}\n{trace}'
    took_s = time.process_time() - begin_s
    if took_s > BOUND_S:
        yield f'{name}: took {took_s:.1f} s'
    if (grown_mb := size_mb('VmHWM') - before_mb) > BOUND_MB:
        yield f'{name}: {grown_mb:.0f} MB of memory'
    for stream in (output, errors):
        stream.seek(0)
        for line in stream.read().split('\n'):
            if not line.isprintable():
                yield f'{name}: prints control characters: {line[-300:]!r}'
                break


def read_file(number: int) -> Iterator[str]:
    """Read the file in the current folder with all commands; yield their failures."""
    before = set(Path().iterdir())
    for name, (command, *words) in commands(number).items():
        yield from _failures(name, load_command(command), words)
    if number % 4 == 1:
        yield from _failures('view', click.command(watch))
        yield from _failures('play', click.command(play))
    for path in set(Path().iterdir()) - before:
        shutil.rmtree(path) if path.is_dir() else path.unlink()


def record_base(folder: Path) -> Content:
    """Record a short run on a map, from which the hostile files are made."""
    options = RunOptions(
        processes=Processes.NONE, output=folder, assignments=['plant_sim.duration=0.1']
    )
    return Content.of_file(execute(RunSpec.of_scenario('autonomous', options)).recording)


def read_files(base: Content, seed: int, first: int, count: int) -> Iterator[str]:
    """Make files from a recording and read them, in the current folder; yield all failures."""
    for number in range(first, first + count):
        if number % 1000 == 0:
            click.echo(f'{number} files', err=True)
        data, changed = hostile_file(base, f'{seed} {number}')
        Path(FILE).write_bytes(data)
        for failure in read_file(number):
            yield f'file {number} ({", ".join(changed)}): {failure}'


@click.command
@click.option('--seed', type=int, default=1, show_default=True, help='Seed of the files.')
@click.option('--first', type=int, default=0, show_default=True, help='Number of the first file.')
@click.option('--count', type=int, default=10_000, show_default=True, help='Number of files.')
def main(seed: int, first: int, count: int) -> None:
    """Read hostile recordings with every reading command; print failures, time and memory."""
    failed = 0
    with tempfile.TemporaryDirectory(prefix='ballbot_') as name:
        os.chdir(name)
        base = record_base(Path(name, 'base'))
        for failure in read_files(base, seed, first, count):
            failed += 1
            print(failure, flush=True)
        os.chdir('/')
    usage = resource.getrusage(resource.RUSAGE_SELF)
    print(
        f'{count} files, {failed} failures, {usage.ru_utime + usage.ru_stime:.0f} s of processor '
        f'time, {usage.ru_maxrss / 1024:.0f} MB'
    )
    sys.exit(failed > 0)


if __name__ == '__main__':
    main()
