"""Installs packages with progress: for the scripts, and for commands that need more than they have.

It needs only the standard library, since it installs everything else.
"""

from __future__ import annotations

import importlib.metadata
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import IO, NamedTuple

from ballbot_ros.errors import BallbotError

LINE_PERIOD_S = 10.0

CORE_MB = 450
"""Space that the package takes with ROS, without other extras [MB]."""

COMPRESSION = 0.31
"""Size of a download, as a share of the space that it takes."""


class Extra(NamedTuple):
    """What an extra of setup.py is for, and the space that it takes [MB]."""

    purpose: str
    size_mb: int


EXTRAS = {
    'all': Extra('everything', 880),
    'drive': Extra('gamepads and keyboard', 36),
    'viewer': Extra('the robot in 3D in the browser', 17),
    'film': Extra('pictures and films of the 3D scene', 345),
    'report': Extra('reports with interactive figures', 43),
    'study': Extra('studies, and compiled runs', 415),
    'search': Extra('searches by CMA-ES', 2),
    'parquet': Extra('tables as Parquet', 171),
    'pandas': Extra('data frames', 44),
    'gym': Extra('environments for reinforcement learning', 2),
    'mpc': Extra('the controller mpc', 2),
    'cluster': Extra('studies on a Dask cluster', 385),
}
"""The extras that a command may need; test/packaging/test_installation.py checks their sizes."""


class InstallationError(BallbotError):
    """Packages can't be installed."""


def requirements(extra: str) -> list[str]:
    """Return the requirements of an extra; none if this package is not installed."""
    try:
        declared = importlib.metadata.requires('ballbot_ros') or []
    except importlib.metadata.PackageNotFoundError:
        return []
    marked = re.compile(rf'(.+?)\s*;\s*extra == ["\']{extra}["\']')
    return [found[1] for each in declared if (found := marked.fullmatch(each))]


def missing(extra: str) -> list[str]:
    """Return the requirements of an extra that are not installed."""
    return [each for each in requirements(extra) if not _is_installed(each)]


def name_of(requirement: str) -> str:
    """Return the name of the package in a requirement."""
    return re.split(r'[\s<>=!~;\[]', requirement, maxsplit=1)[0]


def _is_installed(requirement: str) -> bool:
    try:
        importlib.metadata.version(name_of(requirement))
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def install(wanted: Sequence[str], size_mb: float, log: Path) -> None:
    """Install requirements into this environment, and show progress.

    It raises InstallationError if they can't be installed.

    Parameters
    ----------
    wanted : sequence of str
        Requirements, or arguments, of pip.
    size_mb : float
        Space that they take [MB], about.
    log : Path
        File for the output of the installer.
    """
    here = [sys.executable, '-m', 'pip', 'install', '--no-input', '--no-compile']
    installers = [here]
    if uv := shutil.which('uv'):
        # It does not read pip's configuration, so pip may succeed where it fails.
        installers.insert(0, [uv, 'pip', 'install', '--python', sys.executable])
    for installer in installers:
        with log.open('w') as file:
            if _run([*installer, *wanted], size_mb, file) == 0:
                return
    reasons = re.findall('(?i:error): .*', log.read_text())
    reason = reasons[-1] if reasons else ''
    raise InstallationError(
        f'cannot install the packages (no network?): {reason} (details in {log})'
    )


def _run(command: list[str], size_mb: float, log: IO[str]) -> int:
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as installer:
        assert installer.stdout
        with _Display(Downloads(size_mb)) as display:
            for line in installer.stdout:
                log.write(line)
                display.show(line)
        return installer.wait()


class _Display:
    """Shows what an installer does: on one line of a terminal, else now and then on a new one."""

    def __init__(self, downloads: Downloads) -> None:
        self._is_terminal = sys.stderr.isatty()
        self._downloads = downloads
        self._shown = time.monotonic()

    def __enter__(self) -> _Display:
        return self

    def __exit__(self, *error: object) -> None:
        if self._is_terminal:
            print('\r\x1b[K', end='', file=sys.stderr, flush=True)

    def show(self, line: str) -> None:
        """Take a line of the installer."""
        text = self._downloads.take(line)
        if self._is_terminal and text:
            width = shutil.get_terminal_size().columns - 1
            print(f'\r\x1b[K{f"  {text}"[:width]}', end='', file=sys.stderr, flush=True)
        elif text and time.monotonic() - self._shown > LINE_PERIOD_S:
            self._shown = time.monotonic()
            print(f'  {text}', file=sys.stderr, flush=True)


_UNITS_MB = {'B': 1e-6, 'bytes': 1e-6, 'kB': 1e-3, 'KiB': 1e-3, 'MB': 1.0, 'MiB': 1.05, 'GB': 1e3}


class Downloads:
    """Understands the output of pip and uv; `size_mb`: space of what they install, about."""

    def __init__(self, size_mb: float) -> None:
        self._total_mb = COMPRESSION * size_mb
        self._mb = 0.0

    def take(self, line: str) -> str:
        """Take a line; return what happens now, '' if that has not changed."""
        line = line.strip()
        if line.startswith('Installing collected packages:'):
            return f'installing {line.count(",") + 1} packages'
        if local := re.match(r'Processing (\S+\.whl)', line):
            return self._add(Path(local[1]).name, Path(local[1]).stat().st_size / 1e6)
        found = re.match(r'(?:Downloading|Using cached) (\S+) \(([\d.]+) ?(\w+)\)', line)
        if found and not found[1].endswith('.metadata'):
            return self._add(found[1], float(found[2]) * _UNITS_MB.get(found[3], 0.0))
        return ''

    def _add(self, file: str, size_mb: float) -> str:
        self._mb += size_mb
        name = '-'.join(Path(file).name.removesuffix('.whl').split('-')[:2])
        return f'{name}, {self._mb:.0f} of about {max(self._total_mb, self._mb):.0f} MB'


def main() -> int:
    """Install requirements for a script: its name, a log, requirements such as ``.[ros,drive]``."""
    program, log, *wanted = sys.argv[1:]
    extras = {each for one in wanted for each in re.findall(r'\w+', one.partition('[')[2])}
    size_mb = CORE_MB + sum(EXTRAS[each].size_mb for each in extras & EXTRAS.keys())
    try:
        install(wanted, size_mb, Path(log))
    except KeyboardInterrupt:
        return 130
    except InstallationError as error:
        print(f'{program}: {error}', file=sys.stderr)
        return 2
    return 0


if __name__ == '__main__':
    sys.exit(main())
