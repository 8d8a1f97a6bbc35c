"""References to the classes of controllers that a program has already."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from ballbot_ros.controllers.controller import Controller
from ballbot_ros.controllers.definitions import first_difference, state_difference
from ballbot_ros.controllers.errors import ControllerError
from ballbot_ros.controllers.excerpt import MAIN, excerpt_of, is_of_main
from ballbot_ros.controllers.loading import EXCERPT_SUFFIX, load_controller
from ballbot_ros.errors import one_line
from ballbot_ros.files import write_temporary
from ballbot_ros.parameters import ControllerParameters


def reference_to(cls: type[Controller[Any]], folder: Path) -> str:
    """Return a reference to a class, as in :func:`~ballbot_ros.controllers.loading.find_code`.

    A class of a notebook or the main program is written to a file in `folder`, as an excerpt.

    Raises
    ------
    ControllerError
        If its source is not found, can't stand alone, or is not that of the class.
    """
    if cls.__module__ == MAIN:
        path = folder / f'{cls.__name__}{EXCERPT_SUFFIX}'
        write_temporary(path, excerpt_of(cls).encode())
        reference = f'{path}:{cls.__name__}'
        _require_same(cls, load_controller(reference).cls)
        return reference
    if '.' in cls.__qualname__:
        raise ControllerError(f'{cls.__qualname__} is not defined at the top level of its file')
    file = getattr(sys.modules.get(cls.__module__), '__file__', None)
    if not file:
        raise ControllerError(f'{cls.__module__}.{cls.__name__}: its source was not found')
    place = cls.__module__ if _is_importable(cls.__module__, Path(file)) else file
    return f'{place}:{cls.__name__}'


def require_unchanged(controller: Controller[Any]) -> None:
    """Raise ControllerError if an instance differs from a new one with its parameters.

    A run makes its own instance, which would not have the changes.
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
    if where := state_difference(controller, fresh, cls.__name__):
        raise ControllerError(
            f'{where} differs from that of a new instance, which a run makes: give a new one, and '
            'what you want to change as parameters'
        )


def _require_same(cls: type[Controller[Any]], defined: type[Controller[Any]]) -> None:
    """Raise ControllerError unless the excerpt gives the class, and all that it uses."""
    names = vars(sys.modules[defined.__module__])
    for name, present in vars(sys.modules[MAIN]).items():
        if name not in names or not is_of_main(present):
            continue
        if where := first_difference(present, names[name], name):
            raise ControllerError(
                f'{cls.__name__}: {where} is not as its definition says, because it has been '
                'changed, or uses a value that has: define it again'
            )


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
