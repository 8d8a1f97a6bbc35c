"""Environments in which a run works, or says in one line why it does not."""

from __future__ import annotations

import os
import random
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path

from campaign.fault import Verdict
from campaign.run import (
    Run,
    RunEnd,
    judge_completed,
    judge_end,
    judge_printed,
    judge_recording,
    ticks_of,
    undisturbed,
)
from campaign.signals import SHORT_S
from campaign.site import Site
from campaign.surroundings import file_system

BOUND_S = 45.0
LARGE_VARIABLES = {f'LARGE_{number}': 100_000 * 'x' for number in range(3)}


@dataclass(frozen=True)
class Environment:
    """What differs from the usual environment of a command.

    Attributes
    ----------
    name : str
    variables : mapping
        Environment variables; None removes one.
    shell : str
        What ``sh -c`` does with the command, which is ``"$@"``.
    folder : bytes
        Name of the output folder.
    mount : callable
        Returns the context of a file system, for the site and the output folder.
    refusal : str
        A part of the one-line error with which the run is refused; '' if it works.
    shows_result : bool
        Whether standard output gets the result.
    """

    name: str
    variables: Mapping[str, str | None] = field(default_factory=dict)
    shell: str = 'exec "$@"'
    folder: bytes = b'output'
    mount: Callable[[Site, Path], AbstractContextManager[None]] = lambda site, output: nullcontext()
    refusal: str = ''
    shows_result: bool = True


def _read_only(site: Site, output: Path) -> AbstractContextManager[None]:
    return file_system(output, 64, 'ro')


@contextmanager
def _full_temporary(site: Site, output: Path) -> Iterator[None]:
    with file_system(site.temporary, 4):
        (site.temporary / 'full').write_bytes(bytes(4096))
        yield


ENVIRONMENTS = (
    Environment('PYTHONSAFEPATH', {'PYTHONSAFEPATH': '1'}),
    Environment('300 KB of variables', LARGE_VARIABLES),
    Environment('no HOME', {'HOME': None, 'ROS_LOG_DIR': None, 'ROS_HOME': None}),
    Environment('LANG=C', {'LANG': 'C', 'LC_ALL': 'C'}),
    Environment('a folder that is not UTF-8', folder=b'caf\xe9', refusal='is not UTF-8'),
    Environment('closed streams', shell='exec "$@" <&- >&- 2>&-', shows_result=False),
    Environment('full streams', shell='exec "$@" >/dev/full 2>/dev/full', shows_result=False),
    Environment('64 open files', shell='ulimit -n 64; exec "$@"'),
    Environment('a read-only folder', mount=_read_only, refusal='Read-only file system'),
    Environment('a full TMPDIR', mount=_full_temporary),
)


@dataclass(frozen=True)
class UnusualEnvironment:
    """A run in one of the environments."""

    environment: Environment

    def __str__(self) -> str:
        return self.environment.name

    @classmethod
    def draw(cls, generator: random.Random, index: int) -> UnusualEnvironment:
        """Return the next environment."""
        return cls(ENVIRONMENTS[index % len(ENVIRONMENTS)])

    def carry_out(self, site: Site) -> Verdict:
        """Run the robot there, and judge whether it works or is refused as it should be."""
        output = site.folder / os.fsdecode(self.environment.folder)
        site.variables, site.shell = self.environment.variables, self.environment.shell
        with self.environment.mount(site, output):
            end = Run(site, SHORT_S, output=output, real_time_factor=0.0).await_end(BOUND_S)
        log = undisturbed(site, ticks_of(SHORT_S))
        failures = self.judge(end, log.duty_sha256, [*map(tuple, log.trajectory().duty.tolist())])
        return Verdict(tuple(failures), end.end.took_s, BOUND_S)

    def judge(
        self, end: RunEnd, duty_sha256: str, duties: Collection[tuple[float, float]]
    ) -> list[str]:
        """Return the broken guarantees, given hash and duties of an undisturbed run."""
        failures = judge_printed(end.text) + judge_end(end.end, BOUND_S)
        if refusal := self.environment.refusal:
            lines = end.text.splitlines()
            if end.end.status != 2 or len(lines) != 1 or refusal not in lines[0]:
                failures.append(f'status {end.end.status}, and not one line with {refusal!r}')
            return failures
        if self.environment.shows_result:
            failures += judge_completed(end, duty_sha256)
        elif end.remains is None or len(end.remains.duties) != len(duties):
            failures.append('the recording is not complete')
        return failures + judge_recording(end, duties)
