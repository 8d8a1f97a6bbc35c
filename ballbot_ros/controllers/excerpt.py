"""The source of a controller's class that the program has already.

A run executes, attaches and replays files. A notebook is no file, and executing the main program
again would start its runs again. Both give an excerpt: the class and everything that it uses, as a
file that stands alone.
"""

from __future__ import annotations

import ast
import hashlib
import math
import symtable
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import dedent
from types import FunctionType, ModuleType
from typing import Any, get_origin

import numpy as np

from ballbot_ros.controllers.errors import ControllerError
from ballbot_ros.errors import short_repr
from ballbot_ros.files import temporary_folder, write_temporary

EXCERPT_SUFFIX = '.excerpt.py'
"""Ending of the name of an excerpt's file."""

MAIN = '__main__'

MAX_ELEMENTS = 10_000
"""Largest array that an excerpt contains."""

_Definition = ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
_Import = ast.Import | ast.ImportFrom


def reference_to(cls: type) -> str:
    """Return a reference to a class, as in :func:`~ballbot_ros.controllers.loading.find_code`.

    A class of a notebook or the main program is written to a temporary file, as an excerpt.

    Raises
    ------
    ControllerError
        If its source is not found, or can't stand alone.
    """
    if cls.__module__ == MAIN:
        return f'{_write_excerpt(cls.__name__, excerpt_of(cls))}:{cls.__name__}'
    if '.' in cls.__qualname__:
        raise ControllerError(f'{cls.__qualname__} is not defined at the top level of its file')
    path = getattr(sys.modules.get(cls.__module__), '__file__', None)
    if not path:
        raise ControllerError(f'{cls.__module__}.{cls.__name__}: its source was not found')
    place = cls.__module__ if _is_importable(cls.__module__, Path(path)) else path
    return f'{place}:{cls.__name__}'


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


def _write_excerpt(name: str, text: str) -> Path:
    data = text.encode()
    digest = hashlib.sha256(data).hexdigest()[:16]
    path = Path(_folder().name, digest, f'{name}{EXCERPT_SUFFIX}')
    write_temporary(path, data)
    return path


@lru_cache
def _folder() -> TemporaryDirectory[str]:
    """Return the folder of the excerpts, which is kept until the program ends."""
    return temporary_folder()


@dataclass(frozen=True)
class _Statement:
    """A statement of the notebook or program outside functions and classes."""

    node: ast.stmt
    text: str


def excerpt_of(cls: type) -> str:
    """Return the source of a class of the main program or notebook, and of all that it uses.

    Imports are copied, and so are functions and classes of the program. Other values are written as
    they are now: numbers, texts, their lists, tuples and dictionaries, and arrays of numbers.

    Raises
    ------
    ControllerError
        If the class can't stand alone; the message says why.
    """
    main = sys.modules[MAIN]
    if vars(main).get(cls.__name__) is not cls:
        problem = (
            'is defined again, and this is its former definition: make a new instance'
            if cls.__name__ in vars(main)
            else 'is not defined at the top level of the program or notebook'
        )
        raise ControllerError(f'{cls.__name__} {problem}')
    return _Excerpt(cls.__name__, main).text()


class _Excerpt:
    """Collects what a class uses, each thing after those that it uses itself."""

    def __init__(self, class_name: str, main: ModuleType) -> None:
        self._class = class_name
        self._values = vars(main)
        self._statements = _top_level(main)
        self._imports: dict[str, None] = {}
        self._constants: list[str] = []
        self._definitions: list[str] = []
        self._done: set[str] = set()

    def text(self) -> str:
        if self._class not in self._statements:
            raise ControllerError(f'{self._class}: its source was not found; write it to a file')
        self._add(self._class)
        annotations = self._statements.get('annotations')
        if annotations and isinstance(annotations.node, ast.ImportFrom):
            self._imports = {ast.unparse(annotations.node): None, **self._imports}
        head = [f'"""Excerpt: {self._class} and what it uses."""', '', *self._imports, '']
        return '\n'.join([*head, *self._constants, *self._definitions, ''])

    def _add(self, name: str) -> None:
        if name in self._done or name not in self._values:
            return  # what is not defined is a builtin, or a mistake that its use will show
        self._done.add(name)
        statement = self._statements.get(name)
        if statement and isinstance(statement.node, _Import):
            self._imports[ast.unparse(statement.node)] = None
        elif statement and _is_code(statement, self._values[name]):
            for used in _names_in(statement):
                self._add(used)
            self._definitions.append(f'\n\n{statement.text}')
        else:
            self._add_value(name)

    def _add_value(self, name: str) -> None:
        try:
            text = _literal(self._values[name])
        except TypeError as error:
            raise self._refusal(name, str(error)) from None
        if 'numpy.array(' in text:
            self._imports['import numpy'] = None
        self._constants.append(f'{name} = {text}')

    def _refusal(self, name: str, what: str) -> ControllerError:
        return ControllerError(
            f'{self._class} uses {name}, which is {what}: a run can take along only imports, '
            'functions, classes, numbers, texts and arrays. Make it in the class, or write the '
            'class to a file'
        )


def _is_code(statement: _Statement, value: Any) -> bool:
    """Return whether a statement defines a class or function, or the name of a type."""
    return (
        isinstance(statement.node, _Definition)
        or isinstance(value, FunctionType)
        or get_origin(value) is not None
    )


def _literal(value: Any) -> str:
    """Return an expression for a value; TypeError if there is none."""
    if isinstance(value, np.ndarray) and value.dtype.kind in 'biuf':
        if value.size > MAX_ELEMENTS:
            raise TypeError(f'an array of {value.size} elements')
        return f'numpy.array({_literal(value.tolist())}, {value.dtype.name!r})'
    if isinstance(value, np.generic):
        value = value.item()
    kind = type(value)
    if kind is float and not math.isfinite(value):
        return f"float('{value}')"
    if value is None or kind in (bool, int, float, str):
        return repr(value)
    if kind is dict:
        pairs = (f'{_literal(key)}: {_literal(each)}' for key, each in value.items())
        return f'{{{", ".join(pairs)}}}'
    if kind in (list, tuple):
        inner = ', '.join(map(_literal, value))
        return f'[{inner}]' if kind is list else f'({inner}{"," if len(value) == 1 else ""})'
    raise TypeError(short_repr(value))


def _top_level(main: ModuleType) -> dict[str, _Statement]:
    """Return the newest statement that binds each name."""
    found: dict[str, _Statement] = {}
    for text in _texts(main):
        with suppress(SyntaxError):
            lines = text.splitlines()
            for node in _statements(ast.parse(text)):
                first = min([node.lineno, *(d.lineno for d in getattr(node, 'decorator_list', ()))])
                own = dedent('\n'.join(lines[first - 1 : node.end_lineno]))
                found |= dict.fromkeys(_bound_by(node), _Statement(node, own))
    return found


def _statements(parent: ast.AST) -> Iterator[ast.stmt]:
    """Yield the statements outside functions and classes, also those in conditions and loops."""
    for node in ast.iter_child_nodes(parent):
        if isinstance(node, ast.stmt):
            yield node
        if not isinstance(node, _Definition | ast.expr):
            yield from _statements(node)


def _texts(main: ModuleType) -> list[str]:
    """Return the text of a program, or of the cells of a notebook that were executed."""
    cells = getattr(main, 'In', None)
    if isinstance(cells, list):
        return [str(each) for each in cells]
    path = getattr(main, '__file__', None)
    try:
        return [Path(path).read_text(encoding='utf-8')] if path else []
    except (OSError, UnicodeError):
        return []


def _bound_by(node: ast.stmt) -> Iterator[str]:
    if isinstance(node, _Definition):
        yield node.name
    elif isinstance(node, _Import):
        for alias in node.names:
            yield alias.asname or alias.name.partition('.')[0]
    else:
        for each in ast.walk(node):
            if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store):
                yield each.id


def _names_in(statement: _Statement) -> list[str]:
    """Return the global names that a class or function uses, in the order of their names."""
    names: set[str] = set()
    tables = [symtable.symtable(statement.text, MAIN, 'exec')]
    while tables:
        table = tables.pop()
        tables += table.get_children()
        names |= {
            each.get_name()
            for each in table.get_symbols()
            if each.is_referenced() and each.is_global()
        }
    # Annotations are evaluated late or never, but dataclasses need them.
    for node in ast.walk(statement.node):
        for part in (getattr(node, 'annotation', None), getattr(node, 'returns', None)):
            if isinstance(part, ast.AST):
                names |= {each.id for each in ast.walk(part) if isinstance(each, ast.Name)}
    return sorted(names)
