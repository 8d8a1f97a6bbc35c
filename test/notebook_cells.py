"""Cells that are executed as in a notebook."""

import linecache
import sys
from itertools import count
from types import ModuleType

import pytest

IMPORT = 'from ballbot_ros.controllers import Controller'
_numbers = count()


def controller_class(duty, name='Mine'):
    """Return the text of a controller whose duty is an expression."""
    return f'class {name}(Controller):\n    def tick(self, readings):\n        return {duty}, 0\n'


class Notebook(ModuleType):
    """The main module of a notebook, whose attributes are the names of its cells."""

    def __init__(self):
        super().__init__('__main__')
        self.In = ['']

    def run(self, *cells):
        for cell in cells:
            # As IPython does: the cell is kept even if it fails, and is a file of its own.
            self.In.append(cell)
            name = f'<cell {next(_numbers)}>'
            linecache.cache[name] = (len(cell), None, cell.splitlines(keepends=True), name)
            exec(compile(cell, name, 'exec', dont_inherit=True), vars(self))


@pytest.fixture
def notebook(monkeypatch):
    main = Notebook()
    monkeypatch.setitem(sys.modules, '__main__', main)
    return main
