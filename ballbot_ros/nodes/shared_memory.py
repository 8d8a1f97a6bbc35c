"""Detection and removal of shared memory that killed processes leave behind.

Fast DDS (2.14) uses two kinds of resources. A *segment* holds the messages of one participant:
``fastrtps_<16 hexadecimal digits>``; its owner holds a lock (``flock``) on ``…_el``. A *port* is
the queue that a participant reads: ``fastrtps_port<number>``; its reader holds a lock on ``…_el``,
or on ``…_sl`` if several readers are allowed. A port that is only written to has no lock, but is
mapped. Ports are opened, created and removed under ``sem.fastrtps_port<number>_mutex``.

A process killed while it creates a port leaves one whose first word is not :data:`INITIALISED`.
Fast DDS waits for that word without a time limit, and ignores signals meanwhile.

A writer checks now and then that the readers of its ports are alive. It detects a reader that was
killed while waiting for a message, and removes its port. It never detects one that was killed
between two messages. If the reader was killed while taking a message, the writer may deadlock in
the recovery, on a lock that it already holds (Fast DDS issue 6485).
"""

from __future__ import annotations

import ctypes
import fcntl
import mmap
import os
import re
import stat
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NamedTuple

from ballbot_ros.errors import BallbotError
from ballbot_ros.nodes.port_readers import find_idle_readers, mark_as_waiting

SHARED_MEMORY = Path('/dev/shm')
SETTLED_S = 5.0
"""Age after which a resource can't still be under construction, which takes milliseconds."""

POLL_S = 0.05
INITIALISED, CORRUPTED = (2).to_bytes(4, 'little'), (3).to_bytes(4, 'little')
"""First word of a port."""

MIN_PORT_BYTES = 1024 * 20
"""Minimum size of a port with the state of 1024 readers. Opening a smaller one crashes."""

_FILE = re.compile(r'(?:sem\.)?(fastrtps_(?:port\d+|[0-9a-f]{16}))(?:_el|_sl|_mutex)?')
_LOCKED_FILE = re.compile(rb' ([0-9a-f]+:[0-9a-f]+):(\d+) ')
_LIBC = ctypes.CDLL(None)


class Leftover(NamedTuple):
    """A file that no living process holds, with its size in bytes."""

    path: Path
    size: int


def find_leftovers(
    folder: Path = SHARED_MEMORY, *, older_than_s: float = SETTLED_S
) -> list[Leftover]:
    """Return this user's files that no living process holds."""
    with _dead_resources(folder, older_than_s) as dead:
        return [leftover for resource in dead for leftover in resource.leftovers]


def sweep(folder: Path = SHARED_MEMORY, *, older_than_s: float = SETTLED_S) -> list[Leftover]:
    """Remove this user's files that no living process holds, and return them.

    A port that has been broken for :data:`SETTLED_S` is removed even if processes hold it: these
    processes, and all later ones, would wait for it forever. They are woken, and create a new port.
    """
    with _dead_resources(folder, older_than_s) as dead:
        removed = [leftover for resource in dead for leftover in resource.remove()]
    mark_dead_readers(folder)  # after the removal: a marked port counts as young
    if any(resource.blocks for resource in _resources(folder)):
        with _only_sweep(folder) as is_only:
            blocking = [resource for resource in _resources(folder) if is_only and resource.blocks]
            removed += [left for resource in blocking for left in resource.give_up()]
    return removed


def mark_dead_readers(folder: Path = SHARED_MEMORY) -> None:
    """Mark killed readers as waiting, so that their writers detect them and do not deadlock."""
    ports = [path for path in folder.glob('fastrtps_port*[0-9]') if find_idle_readers(path)]
    if not ports:
        return
    for resource in _unlocked([r for r in _resources(folder) if r.path in ports]):
        with ExitStack() as claims:
            if resource.claim(claims, with_semaphore=True):
                mark_as_waiting(resource.path)


def find_broken_ports(folder: Path = SHARED_MEMORY) -> list[Path]:
    """Return the ports that would hold up or crash a process of this user."""
    return [
        resource.path
        for resource in _resources(folder)
        if resource.is_broken and os.access(resource.path, os.R_OK | os.W_OK)
    ]


def find_stale_ports(folder: Path = SHARED_MEMORY) -> list[int]:
    """Return the numbers of the ports without a reader.

    Other processes may still write to them. A killed reader may still be registered, and its unread
    messages fill the port. If the lock file is missing, Fast DDS considers such a port healthy.
    """
    left = [resource for resource in _resources(folder) if resource.path in resource.files]
    names = [resource.path.name.removeprefix('fastrtps_port') for resource in _unlocked(left)]
    return [int(name) for name in names if name.isdecimal()]


def clear_shared_memory(folder: Path = SHARED_MEMORY) -> list[Leftover]:
    """Sweep until no port is broken; wait for a young one, which may be under construction.

    Returns
    -------
    list of Leftover
        The removed files.

    Raises
    ------
    BallbotError
        If a broken port can't be removed.
    """
    removed = sweep(folder)
    # A port that broke a moment ago is old enough to be removed after half of this time.
    deadline = time.monotonic() + 2.0 * SETTLED_S
    while broken := find_broken_ports(folder):
        if time.monotonic() > deadline:
            raise BallbotError(
                f'{broken[0]}, left by a killed process, would block every node and cannot be '
                f'removed: run `rm {broken[0]}` as its owner or as root'
            )
        time.sleep(POLL_S)
        removed += sweep(folder)
    return removed


@dataclass(frozen=True, eq=False)
class _Resource:
    """A port or segment and the files that belong to it."""

    path: Path
    files: dict[Path, os.stat_result]

    @property
    def age_s(self) -> float:
        """Age of the youngest file."""
        return min(map(_age_s, self.files.values()))

    @property
    def identities(self) -> Iterator[tuple[bytes, ...]]:
        """Device and inode of each file, in the format of ``/proc``."""
        for status in self.files.values():
            device = f'{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}'
            yield device.encode(), str(status.st_ino).encode()

    @property
    def is_own(self) -> bool:
        return all(status.st_uid == os.geteuid() for status in self.files.values())

    @property
    def is_broken(self) -> bool:
        """Whether it is a port that blocks or crashes a process that opens it."""
        status = self.files.get(self.path)
        if status is None or not self.path.name.startswith('fastrtps_port'):
            return False
        if status.st_size < MIN_PORT_BYTES:
            return True
        try:
            with self.path.open('rb') as file:
                return file.read(len(INITIALISED)) != INITIALISED
        except OSError:  # gone, or another user's
            return False

    @property
    def blocks(self) -> bool:
        """Whether the port has been broken for `SETTLED_S`, regardless of who holds its locks."""
        return self.is_broken and _age_s(self.files[self.path]) >= SETTLED_S

    @property
    def mutex(self) -> Path:
        return self.path.with_name(f'sem.{self.path.name}_mutex')

    @property
    def port_only(self) -> _Resource:
        """The port without lock files, which a reader of its predecessor may still hold."""
        kept = (self.path, self.mutex)
        return _Resource(self.path, {path: self.files[path] for path in kept if path in self.files})

    @property
    def leftovers(self) -> list[Leftover]:
        return [Leftover(path, status.st_size) for path, status in self.files.items()]

    def claim(self, claims: ExitStack, *, with_semaphore: bool = False) -> bool:
        """Take the locks if no process holds any, and return whether they are taken.

        They keep other processes from opening the port. If the semaphore is not free, a process may
        be opening the port, or may have died doing so: the claim then fails if `with_semaphore` is
        set, or if a living process has one of the files mapped.
        """
        with ExitStack() as locks:
            try:
                if not self._take_semaphore(locks) and (with_semaphore or self._is_being_opened):
                    return False
                for path in self.files:
                    if path.name.endswith(('_el', '_sl')):
                        lock = locks.enter_context(path.open('rb'))
                        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if any(path.lstat().st_ino != old.st_ino for path, old in self.files.items()):
                    return False  # created again in the meantime
            except OSError:  # locked, or already removed
                return False
            claims.enter_context(locks.pop_all())
            return True

    @property
    def _is_being_opened(self) -> bool:
        """Whether a living process may hold the semaphore; it would fail on a locked lock file."""
        return self.mutex in self.files and not _unmapped([self])

    def _take_semaphore(self, locks: ExitStack) -> bool:
        if self.mutex not in self.files:
            return False
        mutex = locks.enter_context(self.mutex.open('r+b', buffering=0))
        if not _semaphore('sem_trywait', mutex):
            return False  # held by a process that has it mapped, or that died
        locks.callback(_release, mutex)
        return True

    def remove(self) -> list[Leftover]:
        """Remove the files; return those removed by this process."""
        removed = []
        for leftover in self.leftovers:
            with suppress(OSError):
                leftover.path.unlink()
                removed.append(leftover)
        return removed

    def give_up(self) -> list[Leftover]:
        """Remove a broken port, and wake the processes that wait for it."""
        try:
            port = self.path.open('r+b', buffering=0)
        except OSError:  # removed, or another user's
            return self.port_only.remove()
        with port:
            removed = self.port_only.remove()
            with suppress(OSError):  # shared memory may be full
                port.write(CORRUPTED)
        return removed


def _resources(folder: Path) -> list[_Resource]:
    """Return the resources in `folder`, lock files after the files that they lock."""
    found: dict[str, dict[Path, os.stat_result]] = {}
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if match := _FILE.fullmatch(path.name):
            with suppress(FileNotFoundError):
                status = path.lstat()
                if stat.S_ISREG(status.st_mode):
                    found.setdefault(match[1], {})[path] = status
    return [_Resource(folder / name, files) for name, files in found.items()]


@contextmanager
def _dead_resources(folder: Path, older_than_s: float) -> Iterator[list[_Resource]]:
    """Yield the resources that no living process holds, locked so that none can be opened."""
    old = [r for r in _resources(folder) if r.is_own and r.age_s >= older_than_s]
    # Look first, without locks: resources of a live graph must stay open to others.
    candidates = _unmapped(_unlocked(old))
    with ExitStack() as claims:
        if candidates and not claims.enter_context(_only_sweep(folder)):
            candidates = []  # another sweep is removing them
        yield _unmapped([resource for resource in candidates if resource.claim(claims)])


@contextmanager
def _only_sweep(folder: Path) -> Iterator[bool]:
    """Yield whether this is the only sweep; two could mistake each other's locks for leftovers."""
    directory = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(directory, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        is_only = False
    else:
        is_only = True
    try:
        yield is_only
    finally:
        os.close(directory)


def _age_s(status: os.stat_result) -> float:
    return time.time() - status.st_mtime


def _unlocked(resources: Iterable[_Resource]) -> list[_Resource]:
    """Return the resources without a locked file, as far as this user can see."""
    locked = set(_LOCKED_FILE.findall(Path('/proc/locks').read_bytes()))
    return [r for r in resources if locked.isdisjoint(r.identities)]


def _unmapped(resources: Iterable[_Resource]) -> list[_Resource]:
    """Return the resources without a mapped file, as far as this user can see."""
    unmapped = list(resources)
    for maps in Path('/proc').glob('[0-9]*/maps'):
        if not unmapped:
            break
        with suppress(OSError):  # the process has ended, or belongs to another user
            mapped = _mapped_files(maps.read_bytes())
            unmapped = [r for r in unmapped if mapped.isdisjoint(r.identities)]
    return unmapped


def _mapped_files(maps: bytes) -> set[tuple[bytes, ...]]:
    """Return device and inode of Fast DDS's files in the maps of a process."""
    return {
        tuple(line.split(maxsplit=5)[3:5])
        for line in maps.splitlines()
        if b'/fastrtps_' in line or b'/sem.fastrtps_' in line
    }


def _semaphore(operation: str, file: BinaryIO) -> bool:
    """Apply an operation to the semaphore in `file`; return whether it succeeded."""
    try:
        with mmap.mmap(file.fileno(), 0) as memory:
            semaphore = ctypes.c_char.from_buffer(memory)
            failed: int = getattr(_LIBC, operation)(ctypes.byref(semaphore))
            del semaphore  # otherwise the mapping can't be closed
    except ValueError:  # an empty file
        return False
    return not failed


def _release(mutex: BinaryIO) -> None:
    # Keep a semaphore that has been removed locked. A process that waits for it creates a new one
    # after half a second; if it got this one instead, it could open the port at the same time as a
    # process that has the new one.
    if os.fstat(mutex.fileno()).st_nlink:
        _semaphore('sem_post', mutex)
