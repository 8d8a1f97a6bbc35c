"""The source of a class that is defined in a notebook or in the main program.

A run executes, attaches and replays files. A notebook is not a Python file, and executing the main
program again would start its runs again. Both give an excerpt: the class and everything that it
uses, as a file that stands alone.
"""

from __future__ import annotations

import ast
import linecache
import math
import symtable
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from inspect import unwrap
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, get_origin

import numpy as np

from ballbot_ros.controllers.definitions import functions_of
from ballbot_ros.controllers.errors import ControllerError
from ballbot_ros.errors import short_repr

MAIN = '__main__'

MAX_ELEMENTS = 10_000
"""Largest array that an excerpt contains."""

_Definition = ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
_Import = ast.Import | ast.ImportFrom
_AT_ONCE = ('genexpr', 'listcomp', 'setcomp', 'dictcomp')
"""Scopes that are evaluated where they stand."""


@dataclass(frozen=True)
class _Statement:
    """A statement outside functions and classes, and its lines, including decorators."""

    node: ast.stmt
    lines: tuple[str, ...]

    @property
    def text(self) -> str:
        """Its text alone; an indented one is not dedented, which would change its strings."""
        condition = ['if True:'] if self.node.col_offset else []
        return '\n'.join([*condition, *self.lines])

    def defines(self, name: str) -> bool:
        """Return whether it is the definition of a class or function of this name."""
        return isinstance(self.node, _Definition) and self.node.name == name

    def assigns(self, name: str) -> bool:
        """Return whether it assigns to this name alone."""
        target = None
        if isinstance(self.node, ast.Assign) and len(self.node.targets) == 1:
            target = self.node.targets[0]
        elif isinstance(self.node, ast.AnnAssign) and self.node.value:
            target = self.node.target
        return isinstance(target, ast.Name) and target.id == name


def excerpt_of(cls: type) -> str:
    """Return the source of a class of the main program or notebook, and of all that it uses.

    Imports, functions and classes are copied. Other values are written as they are now: numbers,
    texts, their lists, tuples and dictionaries, and arrays of numbers.

    Raises
    ------
    ControllerError
        If the class can't stand alone; the message says why.
    """
    main = sys.modules[MAIN]
    if vars(main).get(cls.__name__) is not cls:
        problem = (
            'is defined again, and this is its former definition: make a new instance'
            if isinstance(vars(main).get(cls.__name__), type)
            else 'is not defined at the top level of the program or notebook'
        )
        raise ControllerError(f'{cls.__name__} {problem}')
    return _Excerpt(cls.__name__, main).text()


class _Excerpt:
    """Collects what a class uses, each thing after those that its definition needs."""

    def __init__(self, class_name: str, main: ModuleType) -> None:
        self._class = class_name
        self._values = vars(main)
        self._statements = [each for text in _texts(main) for each in _statements_in(text)]
        self._imports: dict[str, None] = {}
        self._constants: list[str] = []
        self._definitions: list[str] = []
        self._done: set[str] = set()

    def text(self) -> str:
        self._add(self._class)
        future = {
            ast.unparse(each.node): None
            for each in self._statements
            if isinstance(each.node, ast.ImportFrom) and each.node.module == '__future__'
        }
        head = [f'"""Excerpt: {self._class} and what it uses."""', '', *future, *self._imports, '']
        return '\n'.join([*head, *self._constants, *self._definitions, ''])

    def _add(self, name: str) -> None:
        if name in self._done or name not in self._values:
            return  # what is not defined is a builtin, or a mistake that its use will show
        self._done.add(name)
        value = self._values[name]
        if imports := list(self._imports_of(name, value)):
            self._imports |= dict.fromkeys(imports)
        elif get_origin(value) is not None:  # such as tuple[int, int]
            self._add_statement(name, self._statements[::-1])
        elif is_of_main(value):
            self._add_definition(name, value)
        else:
            self._add_constant(name, value)

    def _imports_of(self, name: str, value: Any) -> Iterator[str]:
        """Yield the imports that give a value this name."""
        found = False
        for each in self._statements:
            for text in _imports_in(each.node, name, value):
                found = True
                yield text
        if found:
            return
        if isinstance(value, ModuleType):
            yield f'import {value.__name__} as {name}'
        elif isinstance(value, FunctionType | type) and not is_of_main(value):
            module, own_name = value.__module__, value.__name__
            if _member(sys.modules.get(module), own_name) is value:
                yield f'from {module} import {own_name} as {name}'

    def _add_definition(self, name: str, value: Any) -> None:
        original = unwrap(value)
        own_name = original.__name__
        if own_name not in (name, '<lambda>') and self._values.get(own_name) is value:
            self._add(own_name)
            self._definitions.append(f'\n\n{name} = {own_name}')
            return
        functions = functions_of(original)
        # A class without functions, such as a dataclass, does not know where it was defined.
        found = [each for function in functions for each in _statements_at(function)]
        self._add_statement(name, found if functions else self._statements[::-1])

    def _add_statement(self, name: str, candidates: list[_Statement]) -> None:
        """Add the first of these statements that gives the name its value, and what it uses."""
        fits = (each for each in candidates if each.defines(name) or each.assigns(name))
        statement = next(fits, None)
        if statement is None:
            raise ControllerError(
                f'{self._class}: the definition of {name} was not found outside functions and '
                'classes of the program or notebook; write it to a file'
            )
        now, later = _names_in(statement)
        for each in now:
            self._add(each)
        self._definitions.append(f'\n\n{statement.text}')
        for each in later:
            self._add(each)

    def _add_constant(self, name: str, value: Any) -> None:
        try:
            text = _literal(value)
        except (TypeError, RecursionError) as error:
            what = error if isinstance(error, TypeError) else short_repr(value)
            raise ControllerError(
                f'{self._class} uses {name}, which is {what}: only imports, functions, classes, '
                'numbers, texts, lists, dictionaries and arrays can be included. Make it in the '
                'class, or write the class to a file'
            ) from None
        if 'numpy.' in text:
            self._imports['import numpy'] = None
        self._constants.append(f'{name} = {text}')


def is_of_main(value: Any) -> bool:
    """Return whether a value is a class or function of the main program or notebook."""
    original = unwrap(value) if callable(value) else value
    return isinstance(original, FunctionType | type) and original.__module__ == MAIN


def _literal(value: Any) -> str:
    """Return an expression for a value; TypeError, whose text is what it is, if there is none."""
    kind = type(value)
    if kind is np.ndarray and value.dtype.kind in 'biuf' and value.dtype.itemsize <= 8:
        if value.size > MAX_ELEMENTS:
            raise TypeError(f'an array of {value.size} elements')
        numbers = _literal(value.ravel().tolist())
        return f'numpy.array({numbers}, {value.dtype.name!r}).reshape({value.shape})'
    if isinstance(value, np.bool_ | np.number) and value.dtype.kind in 'biuf':
        return f'numpy.dtype({value.dtype.name!r}).type({_literal(value.item())})'
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


def _statements_at(function: FunctionType) -> Iterator[_Statement]:
    """Yield the statements that contain a function's definition, the innermost last."""
    code = function.__code__
    for each in _statements_in(''.join(linecache.getlines(code.co_filename))):
        if _first_line(each.node) <= code.co_firstlineno <= (each.node.end_lineno or 0):
            yield each


def _statements_in(text: str) -> Iterator[_Statement]:
    """Yield the statements outside functions and classes, also those in conditions and loops."""
    with suppress(SyntaxError):
        lines = text.splitlines()
        for node in _outer_statements(ast.parse(text)):
            yield _Statement(node, tuple(lines[_first_line(node) - 1 : node.end_lineno]))


def _outer_statements(parent: ast.AST) -> Iterator[ast.stmt]:
    for node in ast.iter_child_nodes(parent):
        if isinstance(node, ast.stmt):
            yield node
        if not isinstance(node, _Definition | ast.expr):
            yield from _outer_statements(node)


def _first_line(node: ast.stmt) -> int:
    decorators: list[ast.expr] = getattr(node, 'decorator_list', [])
    return min([node.lineno, *(each.lineno for each in decorators)])


def _imports_in(node: ast.stmt, name: str, value: Any) -> Iterator[str]:
    """Yield what an import statement does to give a value this name."""
    if isinstance(node, ast.Import):
        for alias in node.names:
            top = alias.name.partition('.')[0]
            if (alias.asname or top) == name:
                module = sys.modules.get(alias.name if alias.asname else top)
                if module is value:
                    yield ast.unparse(ast.Import([alias]))
    elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
        module = sys.modules.get(node.module)
        for alias in node.names:
            found = name if alias.name == '*' else alias.name
            own_name = name if alias.name == '*' else alias.asname or alias.name
            if own_name == name and _member(module, found) is value:
                short = ast.alias(found, None if found == name else name)
                yield ast.unparse(ast.ImportFrom(node.module, [short], 0))


def _member(module: ModuleType | None, name: str) -> Any:
    """Return what an import of a name from a module gives; None if there is none."""
    submodule = sys.modules.get(f'{module.__name__}.{name}') if module else None
    return getattr(module, name, submodule)


def _names_in(statement: _Statement) -> tuple[list[str], list[str]]:
    """Return the global names that a definition uses: at once, and when it is called."""
    now: set[str] = set()
    later: set[str] = set()
    tables = [(symtable.symtable(statement.text, MAIN, 'exec'), now)]
    while tables:
        table, names = tables.pop()
        names |= {
            each.get_name()
            for each in table.get_symbols()
            if each.is_referenced() and each.is_global()
        }
        for child in table.get_children():
            is_called = child.get_type() == 'function' and child.get_name() not in _AT_ONCE
            tables.append((child, later if is_called else names))
    # Annotations may not be evaluated, but dataclasses need them.
    for node in ast.walk(statement.node):
        for part in (getattr(node, 'annotation', None), getattr(node, 'returns', None)):
            if isinstance(part, ast.AST):
                now |= {each.id for each in ast.walk(part) if isinstance(each, ast.Name)}
    return sorted(now), sorted(later)
