"""Finding the code of a controller, and loading its class."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import io
import linecache
import os
import sys
import traceback
import zipfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from importlib.metadata import EntryPoint, entry_points
from inspect import unwrap
from linecache import getline
from pathlib import Path
from threading import RLock
from types import CodeType, FrameType, FunctionType, ModuleType, TracebackType
from typing import Any

from ballbot_ros.controllers.controller import Controller, tasks_of
from ballbot_ros.errors import (
    BallbotError,
    ControllerError,
    TickTimeoutError,
    did_you_mean,
    one_line,
    os_errors,
    short_repr,
)
from ballbot_ros.files import OUR_PACKAGE, read_bytes, shown_path
from ballbot_ros.parameters import DOCUMENTS_PROGRAM
from ballbot_ros.robot.brick.schedule import TaskTiming

_EPOCH = (1980, 1, 1, 0, 0, 0)
"""The time of every file in an archive, so that the same files always give the same bytes."""


@dataclass(frozen=True)
class Source:
    """The source of a controller: a file (``.py``), or the archive of a package (``.zip``)."""

    suffix: str
    data: bytes

    @cached_property
    def sha256(self) -> str:
        """The hash that identifies it."""
        return hashlib.sha256(self.data).hexdigest()

    @classmethod
    def of_file(cls, path: Path) -> Source:
        """Read a file; OSError if it can't be read."""
        return cls('.py', read_bytes(path))

    @classmethod
    def of_package(cls, folder: Path) -> Source:
        """Read the Python files of a package; OSError if one can't be read.

        The archive is not compressed, so it does not depend on the version of a compressor.
        """
        archive = io.BytesIO()
        with zipfile.ZipFile(archive, 'w', zipfile.ZIP_STORED) as content:
            for path in sorted(folder.rglob('*.py')):
                name = path.relative_to(folder.parent).as_posix()
                content.writestr(zipfile.ZipInfo(name, _EPOCH), read_bytes(path))
        return cls('.zip', archive.getvalue())


GROUP = 'ballbot_ros.controllers'
"""Entry point group of installed controllers."""

MAIN = '__main__'
"""Module of a class that is defined in a notebook or in the main program."""

_MAX_LENGTH = 300


@dataclass(frozen=True)
class ControllerCode:
    """The code of a controller, found but not yet executed.

    Attributes
    ----------
    reference : str
        What it was found by; a file has an absolute path.
    module : str
        Name of its module; '' for a file. A class of :data:`MAIN` was not loaded, but given; its
        source is only to be read.
    path : Path
        The file of the class.
    folder : Path or None
        Folder of its package; None if it is a single file.
    owner : str
        Name and version of the installed package that it is from; '' if unknown.
    """

    reference: str
    module: str
    class_name: str
    source: Source
    path: Path
    folder: Path | None = None
    owner: str = ''

    @property
    def shown(self) -> str:
        """The file of the class, as shown to the user."""
        return shown_path(self.path)

    @property
    def public(self) -> str:
        """The file of the class, as shown and recorded."""
        return _place(self.path) or _public_path(self.path)

    @property
    def is_ours(self) -> bool:
        """Whether it is part of this package."""
        return self.module.partition('.')[0] == OUR_PACKAGE

    def has(self, frame: FrameType) -> bool:
        """Return whether the code that is executed in a frame belongs to it."""
        if self.module == MAIN:
            return frame.f_globals.get('__name__') == MAIN
        file = Path(frame.f_code.co_filename)
        return file == self.path or bool(self.folder and self.folder in file.parents)

    def describe(self, error: BaseException) -> str:
        """Return an error with the innermost line of this code that caused it, on one line."""
        text = one_line(error)[:_MAX_LENGTH]
        name = '' if isinstance(error, BallbotError | TickTimeoutError) else type(error).__name__
        if isinstance(error, SyntaxError) and error.filename:
            line = f':{error.lineno}' if error.lineno else ''
            return f'{_public_path(error.filename)}{line}: {name}: {error.msg}'
        what = ': '.join(filter(None, (name, text)))
        return f'{self._line(error.__traceback__) or self.public}: {what}'

    def _line(self, trace: TracebackType | None) -> str:
        """Return the innermost line of a traceback in this code; '' if there is none."""
        for frame, number in reversed(list(traceback.walk_tb(trace))):
            if self.has(frame):
                return shown_line(frame.f_code.co_filename, number)
        return ''


@dataclass(frozen=True)
class LoadedController:
    """The class of a controller, its code, and its tasks, the one of the highest priority first."""

    cls: type[Controller[Any]]
    code: ControllerCode
    tasks: Sequence[TaskTiming]


def load_controller(reference: str) -> LoadedController:
    """Load the class of a controller; for the argument and the errors see :func:`find_code`."""
    return load(find_code(reference))


def find_code(reference: str) -> ControllerCode:
    """Find the code of a controller, without executing it; ControllerError if there is none.

    Parameters
    ----------
    reference : str
        ``FILE.py:Class``, ``package.module:Class``, or the name of an installed one, which is an
        entry point of the group :data:`GROUP`.
    """
    place, colon, name = reference.rpartition(':')
    if not colon:
        return _find_installed(reference)
    if not name.isidentifier():
        raise ControllerError(f'{reference}: {name!r} is not the name of a class')
    if is_file_reference(reference):
        path = Path(place).absolute()
        with os_errors(ControllerError, shown_path(path)):
            return ControllerCode(reference, '', name, Source.of_file(path), path)
    return _find_module(reference, place, name)


def is_file_reference(reference: str) -> bool:
    """Return whether a reference names a file."""
    place, colon, _ = reference.rpartition(':')
    return bool(colon) and (place.endswith('.py') or '/' in place)


def resolve_reference(reference: str, folder: Path) -> str:
    """Make the path in a reference absolute, from `folder`; return any other unchanged."""
    if not is_file_reference(reference):
        return reference
    place, _, name = reference.rpartition(':')
    path = Path(place)
    with suppress(RuntimeError):  # ~somebody is nobody
        path = path.expanduser()
    return f'{os.path.normpath((folder / path).absolute())}:{name}'


def public_reference(reference: str) -> str:
    """Return a reference without folders that are private to this machine.

    A file below the current folder has its path from there; any other only its name.
    """
    if not is_file_reference(reference):
        return reference
    place, _, name = reference.rpartition(':')
    return f'{_public_path(place)}:{name}'


def installed_controllers() -> dict[str, list[EntryPoint]]:
    """Return the installed controllers by name, several if packages claim the same name."""
    found: dict[str, list[EntryPoint]] = {}
    for point in entry_points(group=GROUP):
        claims = found.setdefault(point.name, [])
        if point.value not in {each.value for each in claims}:
            claims.append(point)
    return dict(sorted(found.items()))


def is_installed(reference: str) -> bool:
    """Return whether a reference is the name or the class of an installed controller."""
    installed = installed_controllers()
    classes = (point.value for claims in installed.values() for point in claims)
    return reference in installed or reference in classes


def _find_installed(name: str) -> ControllerCode:
    installed = installed_controllers()
    claims = installed.get(name, [])
    if len(claims) > 1:
        owners = ' and '.join(f'{_owner(each)} ({each.value})' for each in claims)
        raise ControllerError(
            f'controller {name!r}: several packages have this name: {owners}; give package.module:'
            'Class'
        )
    if not claims:
        known = [*DOCUMENTS_PROGRAM, *installed]
        file = f', such as {name}:Class' if name.endswith('.py') else ''
        raise ControllerError(
            f'no controller {name!r}{did_you_mean(name, known)}: give one of {", ".join(known)}, '
            f'or package.module:Class, or FILE.py:Class{file}'
        )
    module, _, class_name = claims[0].value.partition(':')
    return replace(_find_module(name, module.strip(), class_name.strip()), owner=_owner(claims[0]))


def _owner(point: EntryPoint) -> str:
    return f'{point.dist.name} {point.dist.version}' if point.dist else ''


def _find_module(reference: str, module: str, class_name: str) -> ControllerCode:
    top = module.partition('.')[0]
    try:
        spec = importlib.util.find_spec(top) if top else None
    except (ImportError, ValueError):
        spec = None
    folders = list(spec.submodule_search_locations or ()) if spec else []
    if spec is None or not (folders or spec.has_location):
        raise ControllerError(f'{reference}: no package or module {top!r} is installed')
    path, folder = Path(spec.origin or ''), None
    if folders:
        folder = Path(folders[0])
        base = folder.joinpath(*module.split('.')[1:])
        path = base / '__init__.py' if base.is_dir() else base.with_suffix('.py')
        if not path.is_file():
            raise ControllerError(f'{reference}: no module {module!r} in {folder}')
    try:
        if folder is None or top == OUR_PACKAGE:  # the version of this package tells the rest
            return ControllerCode(reference, module, class_name, Source.of_file(path), path)
        source = Source.of_package(folder)
    except (OSError, UnicodeError) as error:
        raise ControllerError(f'{reference}: {one_line(error)}') from None
    return ControllerCode(reference, module, class_name, source, path, folder)


def load(code: ControllerCode) -> LoadedController:
    """Execute the code of a controller; ControllerError if it fails, or its class is not valid."""
    try:
        module = (
            importlib.import_module(code.module)
            if code.module
            else _execute(code.path, code.source)
        )
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise ControllerError(code.describe(error)) from None
    found = vars(module).get(code.class_name)
    if found is None:
        own = [
            name
            for name, value in vars(module).items()
            if isinstance(value, type)
            and issubclass(value, Controller)
            and value.__module__ == module.__name__
        ]
        hint = f'it has {", ".join(own)}' if own else 'it has no controller'
        raise ControllerError(f'{code.shown} has no class {code.class_name!r}; {hint}')
    if not isinstance(found, type) or not issubclass(found, Controller):
        kind = 'a class' if isinstance(found, type) else f'of type {type(found).__name__}'
        raise ControllerError(
            f'{code.shown}: {code.class_name} is {kind}, but not derived from '
            f'{Controller.__module__.rpartition(".")[0]}.{Controller.__name__}'
        )
    if code.module and not code.is_ours and not _is_defined_in(code.path, found):
        raise ControllerError(
            f'{code.shown} has changed since it was imported: import it again, or restart'
        )
    return controller_of(found, code)


def _is_defined_in(path: Path, cls: type) -> bool:
    """Return whether the functions of an imported class are still those of its file."""
    found: set[CodeType] = set()
    try:
        parts = [compile(read_bytes(path), str(path), 'exec', dont_inherit=True)]
    except (OSError, SyntaxError, ValueError):
        return False
    while parts:
        constants = [each for each in parts.pop().co_consts if isinstance(each, CodeType)]
        found.update(constants)
        parts += constants
    functions = (unwrap(each) for each in vars(cls).values() if callable(each))
    codes = (each.__code__ for each in functions if isinstance(each, FunctionType))
    return all(each in found for each in codes if each.co_filename == str(path))


def controller_of(cls: type[Controller[Any]], code: ControllerCode) -> LoadedController:
    """Return a class with its code and its tasks; ControllerError if they are not valid."""
    try:
        if not isinstance(cls.portable, bool):
            raise ControllerError(
                f'{code.class_name}.portable: {short_repr(cls.portable)} is not True or False'
            )
        return LoadedController(cls, code, tasks_of(cls))
    except Exception as error:
        raise ControllerError(code.describe(error)) from None


_execution = RLock()
_in_execution: set[str] = set()


def _execute(path: Path, source: Source) -> ModuleType:
    """Return the module of a file, from the content that was read and is attached."""
    with _execution:  # several threads may load the same file
        return _executed(path, source)


@lru_cache(maxsize=8)
def _executed(path: Path, source: Source) -> ModuleType:
    name = f'ballbot_controller_{source.sha256[:16]}'
    if name in _in_execution:
        raise ControllerError(
            "it runs itself while it is loaded: put that below `if __name__ == '__main__':`"
        )
    module = ModuleType(name)
    module.__file__ = str(path)
    sys.modules[name] = module  # where dataclasses and pickle look for it
    _in_execution.add(name)
    try:
        exec(compile(source.data, str(path), 'exec', dont_inherit=True), vars(module))
    except BaseException:
        del sys.modules[name]
        raise
    finally:
        _in_execution.discard(name)
    return module


def _public_path(path: str | Path) -> str:
    """Return a path without folders that are private: from the current folder, or only its name."""
    shown = Path(shown_path(path))
    return shown.name if shown.is_absolute() else str(shown)


def shown_line(path: str, number: int) -> str:
    """Return a line of code as shown; with its text if it is in a cell, which has no name."""
    if cell := _place(Path(path)):
        return f'{cell}:{number} ({getline(path, number).strip()})'
    return f'{_public_path(path)}:{number}'


def _place(path: Path) -> str:
    """Return what a cell of a notebook is called; '' for a file."""
    return 'cell' if linecache.getlines(str(path)) and not path.is_file() else ''
