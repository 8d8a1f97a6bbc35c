"""The project's functions, compiled by numba as they are, and kept for the next time."""

from __future__ import annotations

import dis
import fcntl
import hashlib
import os
import platform
import re
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from types import CodeType, FunctionType, MappingProxyType
from typing import IO, Any, cast

import numpy as np

import ballbot_ros
from ballbot_ros.errors import BallbotError, one_line
from ballbot_ros.files import make_folder, shown_path
from ballbot_ros.robot.compiler_hints import ALTERNATIVES, INLINED, with_globals

_PACKAGE = ballbot_ros.__name__
_ROOT = Path(ballbot_ros.__file__).parent
_KEPT_FOLDERS = 4
_MAX_WAIT_S, _POLL_S = 120.0, 0.05

NO_COMPILER = 'numba is not installed'
REMEDY = "pip install 'ballbot_ros[study]'"
"""How to install what studies need."""

Function = Callable[..., Any]


class CompilationError(BallbotError):
    """Functions can't be compiled here."""


NO_BACKGROUND = 'BALLBOT_NO_BACKGROUND'
"""Environment variable: if it is set, nothing is compiled in the background."""

_functions: dict[Function, Any] = {}
_kept_functions: dict[tuple[Function, str], Function] = {}
_in_background: set[str] = set()


def compiled(function: Function) -> Function:
    """Return a function compiled, together with those of its own and of this package it calls.

    The results are those of the function itself, bit for bit: without `fastmath`, numba keeps the
    operations of IEEE arithmetic and their order. A division by zero gives what numpy's numbers
    give. The functions need no decorator, so nothing else needs numba. Without that, it raises
    CompilationError.
    """
    known = _functions.get(function)
    if known is None:
        fresh = _with_compiled_globals(ALTERNATIVES.get(function, function), {})
        # Python's own numbers refuse a division by zero.
        model = 'numpy' if _package_of(function) == _PACKAGE else 'python'
        is_inlined = function in INLINED
        known = _numba().njit(fresh, error_model=model, forceinline=is_inlined, _nrt=not is_inlined)
        _functions[function] = known
    return cast(Function, known)


_NONE: Mapping[str, Function] = MappingProxyType({})


def compiled_and_kept(
    function: Function, name: str = '', others: Mapping[str, Function] = _NONE
) -> Function:
    """Return a function as :func:`compiled` does; the machine code is kept on disk.

    Kept code is used only by the same code of this package, with the same releases of Python, numpy
    and numba, on the same kind of processor. Of several processes that need it at once, one
    compiles it while the others wait. Without a folder for it, nothing is kept.

    The `others` take the place of functions with these names in the module; `name` distinguishes
    the same function with different ones.
    """
    numba = _numba()
    known = _kept_functions.get((function, name))
    if known is None:
        fresh = _with_compiled_globals(function, others)
        fresh.__qualname__ += f'_{name}' if name else ''
        folder = _folder()
        with _cache_folder(numba, folder):
            known = numba.njit(fresh, error_model='numpy', nogil=True, cache=folder is not None)
        lock = folder / f'{fresh.__qualname__}.lock' if folder else None
        known = _compiling_alone(known, numba.typeof, lock)
        _kept_functions[function, name] = known
    return known


def _compiling_alone(
    function: Any, type_of: Callable[[object], object], lock: Path | None
) -> Function:
    """Return a function that is compiled, or read from the disk, by one process at a time.

    Each of the project's functions has arguments of only one type. It raises CompilationError if it
    can't be compiled for them.
    """

    def call(*arguments: object) -> object:
        if not function.overloads:
            with lock.open('w') if lock else nullcontext() as file:
                if file:
                    _wait_for_lock(file)
                if problem := _problem(function, tuple(map(type_of, arguments))):
                    raise CompilationError(problem)
        return function(*arguments)

    return call


def _wait_for_lock(file: IO[str]) -> None:
    """Take the lock of a file; go on without it if another process keeps it for too long."""
    deadline = time.monotonic() + _MAX_WAIT_S
    while time.monotonic() < deadline:
        with suppress(BlockingIOError):
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        time.sleep(_POLL_S)


def is_loaded(function: Function) -> bool:
    """Return whether the machine code of a function is in this process."""
    return (function, '') in _kept_functions


def is_kept(function: Function) -> bool:
    """Return whether the machine code of a function is on disk, so that it need not be compiled."""
    return has_kept_code(function.__qualname__)


def has_kept_code(name: str = '*') -> bool:
    """Return whether machine code of a function, or of any, is on disk."""
    folder = _folder()
    return folder is not None and any(folder.rglob(f'*.{name}-*.nbi'))


def compile_in_background(kept: str, compiles: Callable[..., None], *arguments: str) -> None:
    """Let a process of the lowest priority compile code for the next time, unless it is kept.

    It goes on when this one has ended. Each process starts at most one for the same code, whose
    name is as for :func:`has_kept_code`. A function at the top of a module `compiles` it with the
    arguments.
    """
    if not can_compile() or NO_BACKGROUND in os.environ or _folder() is None or has_kept_code(kept):
        return
    if kept in _in_background:
        return
    _in_background.add(kept)
    module, name = compiles.__module__, compiles.__name__
    idle = 'import os; os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))'
    nothing = [(os.POSIX_SPAWN_OPEN, number, os.devnull, os.O_RDWR, 0) for number in range(3)]
    words = [sys.executable, '-c', f'{idle}; import {module}; {module}.{name}(*{arguments!r})']
    with suppress(OSError):  # nothing depends on it: the system may have no room for a process
        os.posix_spawn(sys.executable, words, os.environ, file_actions=nothing, setsid=True)


def functions_sha256(function: Function) -> str:
    """Return a hash of a function and of what it reads of its own package, as hexadecimal text.

    The name of its module counts, by which kept code refers to the classes of a law.
    """
    digest = hashlib.sha256(f'{function.__module__}\0'.encode())
    found = [function]
    for each in found:
        assert isinstance(each, FunctionType)
        digest.update(repr((_text_of(each.__code__), each.__defaults__)).encode())
        for name in sorted(_global_names(each.__code__)):
            value = each.__globals__.get(name)
            if isinstance(value, FunctionType):
                if value not in found and _package_of(value) == _package_of(function):
                    found.append(value)
            elif isinstance(value, int | float | tuple | str | np.generic):
                digest.update(f'{name} = {value!r}\n'.encode())
    return digest.hexdigest()


def _text_of(code: CodeType) -> tuple[object, ...]:
    constants: list[object] = []
    for each in code.co_consts:
        if isinstance(each, CodeType):
            constants.append(_text_of(each))
        else:  # the order of a set differs from process to process
            constants.append(sorted(map(repr, each)) if isinstance(each, frozenset) else each)
    return code.co_code, code.co_names, code.co_varnames, constants


def _package_of(function: Function) -> str:
    return function.__module__.partition('.')[0]


@cache
def code_sha256() -> str:
    """Return a hash of the text of all modules of this package, as hexadecimal text."""
    digest = hashlib.sha256()
    for path in sorted(_ROOT.rglob('*.py')):
        digest.update(f'{path.relative_to(_ROOT)}\0'.encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _with_compiled_globals(function: Function, others: Mapping[str, Function]) -> FunctionType:
    """Return a copy of a function that calls the compiled functions of this project."""
    assert isinstance(function, FunctionType)
    given = {**function.__globals__, **others}
    called = {
        name: compiled(value)
        for name in _global_names(function.__code__)
        if isinstance(value := given.get(name), FunctionType)
        and (name in others or _package_of(value) in (_PACKAGE, _package_of(function)))
    }
    return with_globals(function, {**others, **called})


def _global_names(code: CodeType) -> set[str]:
    """Return the names of the module that code uses, not those of attributes."""
    names = {each.argval for each in dis.get_instructions(code) if each.opname == 'LOAD_GLOBAL'}
    inner = (_global_names(each) for each in code.co_consts if isinstance(each, CodeType))
    return names.union(*inner)


def compilation_problem(function: Function, *arguments: object) -> str:
    """Return why a function can't be compiled for arguments, on one line; '' if it can."""
    return _problem(compiled(function), tuple(map(_numba().typeof, arguments)))


def _problem(function: Any, types: tuple[object, ...]) -> str:
    """Compile a function for types; return why this is not possible, on one line."""
    try:
        function.compile(types)
    except Exception as error:  # the compiler has several families of them
        text = str(error)
        found = re.findall(r'(?:File "|Raised from )(.+?)"?,? (?:line |\()(\d+)', text)
        # The user's code rather than ours, which calls it.
        places = sorted(found, key=lambda each: not Path(each[0]).resolve().is_relative_to(_ROOT))
        where = f'{shown_path(Path(places[-1][0]))}:{places[-1][1]}: ' if places else ''
        lines = [each.strip() for each in text.splitlines() if each.strip()]
        told = [each for each in lines if not each.startswith(('Failed in', 'During:', 'File'))]
        return f'{where}{one_line((told or lines or [type(error).__name__])[0])}'
    return ''


def can_compile() -> bool:
    """Return whether numba is installed."""
    return find_spec('numba') is not None


def _numba() -> Any:
    try:
        import numba
    except ImportError:
        raise CompilationError(f'compiled runs need numba: {REMEDY}') from None
    return numba


@cache
def _folder() -> Path | None:
    """Return the folder of the machine code of exactly this code; None if it can't be written."""
    releases = platform.python_version(), np.__version__, version('numba')
    identity = hashlib.sha256(repr((code_sha256(), releases)).encode()).hexdigest()[:32]
    base = os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache'
    folder = Path(base) / _PACKAGE / 'compiled' / identity
    try:
        make_folder(folder)
    except (OSError, RuntimeError):
        return None
    folder.touch()
    _remove_old(folder.parent)
    return folder


def _remove_old(parent: Path) -> None:
    """Remove all folders but those that were used last: each release of this package has one."""
    with suppress(OSError):
        ages = sorted(parent.iterdir(), key=lambda each: -each.stat().st_mtime)
        for each in ages[_KEPT_FOLDERS:]:
            shutil.rmtree(each, ignore_errors=True)


@contextmanager
def _cache_folder(numba: Any, folder: Path | None) -> Iterator[None]:
    """Let numba keep the machine code in a folder."""
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(folder or '')
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before
