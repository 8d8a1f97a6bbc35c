"""What the system tells of the processes of this machine."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ballbot_ros.simulation.patience import Activity

END_WITH_PARENT = 'BALLBOT_END_WITH_PARENT'
"""Environment variable: the process with which a node ends, the command that started it."""

_PROC = Path('/proc')
_DUE = ('R', 'D')
"""States of a thread that has a processor or waits for one, and of one that waits for a disk."""


def activity(process: int) -> Activity | None:
    """Return what the machine has given to a process, None if it is gone or nothing tells."""
    cpu_ns = queued_ns = 0
    states = []
    try:
        threads = [*(_PROC / str(process) / 'task').iterdir()]
    except OSError:
        return None
    for thread in threads:
        try:
            states.append((thread / 'stat').read_text().rpartition(')')[2].split()[0])
            cpu, queued, _ = (thread / 'schedstat').read_text().split()
        except OSError:  # it has just ended, or the kernel keeps no such account
            continue
        cpu_ns += int(cpu)
        queued_ns += int(queued)
    return Activity(cpu_ns * 1e-9, queued_ns * 1e-9, any(state in _DUE for state in states))


def activities(processes: Iterable[int]) -> dict[int, Activity]:
    """Return what the machine has given to those of the processes that it tells of."""
    found = {process: activity(process) for process in processes}
    return {process: each for process, each in found.items() if each is not None}


def children(parent: int) -> list[int]:
    """Return the processes that a process has started and that have not ended."""
    found = []
    for entry in _PROC.iterdir():
        if not entry.name.isdigit():
            continue
        try:
            fields = (entry / 'stat').read_text().rpartition(')')[2].split()
        except OSError:
            continue
        if int(fields[1]) == parent:
            found.append(int(entry.name))
    return found
