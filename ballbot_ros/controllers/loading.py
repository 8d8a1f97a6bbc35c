"""Finding and loading the class of a controller."""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import sys
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any

from ballbot_ros.brick.schedule import TaskTiming
from ballbot_ros.controllers.controller import Controller, tasks_of
from ballbot_ros.controllers.errors import ControllerError
from ballbot_ros.controllers.source import Source
from ballbot_ros.errors import BallbotError, one_line
from ballbot_ros.parameters import DOCUMENTS_PROGRAM

GROUP = 'ballbot_ros.controllers'
"""Entry point group of installed controllers."""

OUR_PACKAGE = __name__.partition('.')[0]
_MAX_LENGTH = 300


@dataclass(frozen=True)
class LoadedController:
    """The class of a controller, and where it is from.

    Attributes
    ----------
    reference : str
        What it was loaded by; a file has an absolute path.
    path : Path
        The file of the class.
    folder : Path or None
        Folder of its package; None if it is a single file.
    tasks : sequence of TaskTiming
        Its tasks, the first the one of the highest priority.
    """

    cls: type[Controller[Any]]
    reference: str
    source: Source
    path: Path
    folder: Path | None
    tasks: Sequence[TaskTiming]

    @property
    def shown(self) -> str:
        """The file of the class, as shown to the user."""
        return shown_path(self.path)

    @property
    def is_ours(self) -> bool:
        """Whether it is part of this package."""
        return self.cls.__module__.partition('.')[0] == OUR_PACKAGE

    @property
    def is_portable(self) -> bool:
        """Whether its duties are the same on every machine."""
        return self.cls.portable

    def describe(self, error: BaseException) -> str:
        """Return an error with the line of the controller's code that caused it, on one line."""
        return describe(error, self.path, self.folder)

    def has(self, file: Path) -> bool:
        """Return whether a file belongs to the code of the controller."""
        return file == self.path or bool(self.folder and self.folder in file.parents)

    def line_of(self, method: Any) -> str:
        """Return file and line of a method's definition."""
        code = method.__func__.__code__
        return f'{shown_path(code.co_filename)}:{code.co_firstlineno}'


def load_controller(reference: str) -> LoadedController:
    """Load the class of a controller.

    Parameters
    ----------
    reference : str
        ``FILE.py:Class``, ``package.module:Class``, or the name of an installed one, which is an
        entry point of the group :data:`GROUP`.

    Raises
    ------
    ControllerError
        If there is no such class, its code fails, or it is not a valid controller.
    """
    place, colon, name = reference.rpartition(':')
    if not colon:
        return _load_installed(reference)
    if not name.isidentifier():
        raise ControllerError(f'{reference}: {name!r} is not the name of a class')
    if is_file_reference(reference):
        return _load_file(reference, Path(place), name)
    return _load_module(reference, place, name)


def is_file_reference(reference: str) -> bool:
    """Return whether a reference names a file."""
    place, colon, _ = reference.rpartition(':')
    return bool(colon) and (place.endswith('.py') or '/' in place)


def resolve_reference(reference: str, folder: Path) -> str:
    """Make the path in a reference absolute, from `folder`; return any other unchanged."""
    if not is_file_reference(reference):
        return reference
    place, _, name = reference.rpartition(':')
    return f'{(folder / Path(place).expanduser()).absolute()}:{name}'


def public_reference(reference: str) -> str:
    """Return a reference without the folder of its file, which is private to this machine."""
    return reference.rpartition('/')[2] if is_file_reference(reference) else reference


def installed_controllers() -> dict[str, list[importlib.metadata.EntryPoint]]:
    """Return the installed controllers by name, several if packages claim the same name."""
    found: dict[str, list[importlib.metadata.EntryPoint]] = {}
    for point in importlib.metadata.entry_points(group=GROUP):
        claims = found.setdefault(point.name, [])
        if point.value not in {each.value for each in claims}:
            claims.append(point)
    return dict(sorted(found.items()))


def _load_installed(name: str) -> LoadedController:
    installed = installed_controllers()
    claims = installed.get(name, [])
    if len(claims) > 1:
        owners = ', '.join(f'{_owner(each)} ({each.value})' for each in claims)
        raise ControllerError(f'controller {name!r}: several packages have this name: {owners}')
    if not claims:
        known = ', '.join([*DOCUMENTS_PROGRAM, *installed])
        raise ControllerError(
            f'no controller {name!r}: give one of {known}, or package.module:Class, or '
            'FILE.py:Class'
        )
    module, _, class_name = claims[0].value.partition(':')
    return _load_module(name, module.strip(), class_name.strip())


def _owner(point: importlib.metadata.EntryPoint) -> str:
    return point.dist.name if point.dist else 'an unknown package'


def _load_module(reference: str, module_name: str, class_name: str) -> LoadedController:
    top = module_name.partition('.')[0]
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError):
        spec = None
    if spec is None:
        raise ControllerError(f'{reference}: no package or module {top!r} is installed')
    folder = Path(spec.origin or '').parent if spec.submodule_search_locations else None
    try:
        module = importlib.import_module(module_name)
    except (Exception, SystemExit) as error:
        where = Path(spec.origin or '')
        raise ControllerError(f'{reference}: {describe(error, where, folder)}') from None
    path = Path(module.__file__ or '')
    if top == OUR_PACKAGE:
        folder = None  # the version of this package tells the rest
    try:
        source = Source.of_package(folder) if folder else Source.of_file(path)
    except OSError as error:
        raise ControllerError(f'{reference}: {error.filename}: {error.strerror}') from None
    return _checked(module, class_name, reference, source, path, folder)


def _load_file(reference: str, path: Path, class_name: str) -> LoadedController:
    path = path.absolute()
    try:
        source = Source.of_file(path)
    except OSError as error:
        raise ControllerError(f'{shown_path(path)}: {error.strerror}') from None
    return _checked(_execute(path, source), class_name, reference, source, path, None)


@lru_cache(maxsize=8)
def _execute(path: Path, source: Source) -> ModuleType:
    """Return the module of a file, for the content that was read and is attached."""
    name = f'ballbot_controller_{source.sha256[:16]}'
    module = ModuleType(name)
    module.__file__ = str(path)
    sys.modules[name] = module  # where dataclasses and pickle look for it
    try:
        exec(compile(source.data, str(path), 'exec', dont_inherit=True), vars(module))
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise ControllerError(describe(error, path, None)) from None
    return module


def _checked(
    module: ModuleType,
    class_name: str,
    reference: str,
    source: Source,
    path: Path,
    folder: Path | None,
) -> LoadedController:
    shown = shown_path(path)
    found = vars(module).get(class_name)
    if found is None:
        own = [
            name
            for name, value in vars(module).items()
            if isinstance(value, type)
            and issubclass(value, Controller)
            and value.__module__ == module.__name__
        ]
        hint = f'it has {", ".join(own)}' if own else 'it has no controller'
        raise ControllerError(f'{shown} has no class {class_name!r}; {hint}')
    if not isinstance(found, type) or not issubclass(found, Controller):
        kind = 'a class' if isinstance(found, type) else f'of type {type(found).__name__}'
        raise ControllerError(
            f'{shown}: {class_name} is {kind}, but not derived from '
            f'{Controller.__module__.rpartition(".")[0]}.{Controller.__name__}'
        )
    try:
        tasks = tasks_of(found)
    except ControllerError as error:
        raise ControllerError(f'{shown}: {error}') from None
    return LoadedController(found, reference, source, path, folder, tasks)


def describe(error: BaseException, path: Path, folder: Path | None) -> str:
    """Return an error on one line, with the innermost line in a file or folder that caused it."""
    text = one_line(error)[:_MAX_LENGTH]
    name = '' if isinstance(error, BallbotError) else type(error).__name__
    what = ': '.join(filter(None, (name, text)))
    if isinstance(error, SyntaxError) and error.filename:
        return f'{shown_path(error.filename)}:{error.lineno}: {name}: {error.msg}'
    line = _line(error.__traceback__, path, folder)
    return f'{line}: {what}' if line else f'{shown_path(path)}: {what}'


def _line(trace: TracebackType | None, path: Path, folder: Path | None) -> str:
    """Return the innermost line of a traceback in a file or folder; '' if there is none."""
    for frame in reversed(traceback.extract_tb(trace)):
        file = Path(frame.filename)
        if file == path or (folder and folder in file.parents):
            return f'{shown_path(file)}:{frame.lineno}'
    return ''


def shown_path(path: str | Path) -> str:
    """Return a path as shown to the user: relative to the current folder if it is below it."""
    path = Path(path)
    try:
        return str(path.relative_to(Path.cwd()))
    except (ValueError, OSError):
        return str(path)
