"""References to the classes of controllers that a program has already."""

from __future__ import annotations

import linecache
import pickle
import sys
from inspect import unwrap
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from ballbot_ros.controllers.controller import Controller
from ballbot_ros.controllers.loading import (
    MAIN,
    ControllerCode,
    LoadedController,
    Source,
    controller_of,
)
from ballbot_ros.errors import ControllerError, one_line
from ballbot_ros.parameters import ControllerParameters

_COMPARED = (bool, int, float, complex, str, bytes, list, tuple, dict, np.ndarray, np.number)


def reference_to(cls: type[Controller[Any]]) -> str | LoadedController:
    """Return a reference to a class, as in :func:`~ballbot_ros.controllers.loading.find_code`.

    A class of a notebook or the main program has none: executing its text once more would also run
    the rest of it, and would not have the present values. It is returned as it is.

    It raises ControllerError if its source is not found, or its tasks are not valid.
    """
    if cls.__module__ == MAIN:
        path, text = _definition(cls)
        source, name = Source('.py', text.encode()), cls.__name__
        return controller_of(cls, ControllerCode(f'{MAIN}:{name}', MAIN, name, source, path))
    if '.' in cls.__qualname__:
        raise ControllerError(f'{cls.__qualname__} is not defined at the top level of its file')
    file = getattr(sys.modules.get(cls.__module__), '__file__', None)
    if not file:
        raise ControllerError(f'{cls.__module__}.{cls.__name__}: its source was not found')
    place = cls.__module__ if _is_importable(cls.__module__, Path(file)) else file
    return f'{place}:{cls.__name__}'


def _definition(cls: type) -> tuple[Path, str]:
    """Return the file or cell that defines a class of the main program, and its text to be read."""
    main = sys.modules[MAIN]
    for each in vars(cls).values():
        function = unwrap(each) if callable(each) else None
        if isinstance(function, FunctionType) and function.__module__ == MAIN:
            path = function.__code__.co_filename
            if lines := linecache.getlines(path):
                return Path(path), ''.join(lines)
    path = getattr(main, '__file__', None) or MAIN
    # A class without functions does not know its cell.
    cells = reversed([str(each) for each in getattr(main, 'In', ())])
    text = next((cell for cell in cells if f'class {cls.__name__}' in cell), '')
    text = text or ''.join(linecache.getlines(path))
    return Path(path), text or f'# the text of {cls.__qualname__} was not found\n'


def require_unchanged(controller: Controller[Any]) -> None:
    """Raise ControllerError if an instance differs from a new one with its parameters.

    A run makes its own instance, which would not have the changes. Attributes are compared if they
    are numbers, texts, arrays, or lists and dictionaries.
    """
    cls = type(controller)
    if not hasattr(controller, 'settings'):
        raise ControllerError(f'{cls.__name__}.__init__ does not call super().__init__')
    if controller.settings != ControllerParameters():
        raise ControllerError(
            f'the settings of {cls.__name__} are those of the scenario; set them by '
            "parameters={'controller.…': …}"
        )
    try:
        fresh = cls(controller.parameters, controller.model)
    except Exception as error:
        raise ControllerError(
            f'{cls.__name__}(parameters, model), as a run makes its instance: {one_line(error)}'
        ) from None
    for name in sorted(vars(controller).keys() | vars(fresh).keys()):
        if _content(controller, name) != _content(fresh, name):
            raise ControllerError(
                f'{cls.__name__}.{name} differs from that of a new instance, which a run makes: '
                'give a new one, and what you want to change as parameters'
            )


def _content(instance: object, name: str) -> object:
    """Return something that is equal for equal values of an attribute, even for NaN."""
    if name not in vars(instance):
        return None
    value = vars(instance)[name]
    try:
        return name, pickle.dumps(value) if isinstance(value, _COMPARED) else b''
    except Exception:  # such as of an object in a list
        return name, b''


def _is_importable(module: str, path: Path) -> bool:
    """Return whether an import in another process finds a module at this path."""
    top, *rest = module.split('.')
    # Unlike importlib.util.find_spec, the finders do not return what is imported already.
    found = (finder.find_spec(top, None) for finder in sys.meta_path)
    spec = next(filter(None, found), None)
    if spec is None or not spec.submodule_search_locations:
        return bool(spec and not rest and spec.origin == str(path))
    base = Path(spec.submodule_search_locations[0]).joinpath(*rest)
    return path in (base.with_suffix('.py'), base / '__init__.py')
