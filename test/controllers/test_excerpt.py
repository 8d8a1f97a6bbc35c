"""A class of a notebook or main program as a file that stands alone."""

import math
import subprocess
import sys
from types import ModuleType

import numpy as np
import pytest

from ballbot_ros.controllers.controller import Controller
from ballbot_ros.controllers.errors import ControllerError
from ballbot_ros.controllers.excerpt import EXCERPT_SUFFIX, MAX_ELEMENTS, excerpt_of, reference_to
from ballbot_ros.controllers.loading import load_controller
from ballbot_ros.controllers.lqg import LQG

IMPORTS = 'from ballbot_ros.controllers import Controller'
CLASS = 'class Mine(Controller):\n    def tick(self, readings):\n        return {duty}, 0\n'


@pytest.fixture
def notebook(monkeypatch):
    """Return a function that executes cells as a notebook does, and returns its names."""

    def run(*cells):
        main = ModuleType('__main__')
        monkeypatch.setitem(sys.modules, '__main__', main)
        main.In = ['', *cells]
        for cell in cells:
            if not cell.startswith('%'):
                exec(compile(cell, '<cell>', 'exec', dont_inherit=True), vars(main))
        return main

    return run


def first_duty(cls):
    return load_controller(reference_to(cls)).cls().tick(None)[0]


def test_a_class_takes_along_everything_that_it_uses(notebook):
    main = notebook(
        f'import math, os\nimport numpy as np\n{IMPORTS}\nfrom dataclasses import dataclass',
        '%matplotlib inline',
        "GAIN = 2.0\nTABLE = {'a': [1, (2.5,)], 'b': None}\nBIG = np.full((2, 2), 3.0)",
        'def scaled(x):\n    unused = GAIN\n    return again(x) * unused\n'
        'def again(x):\n    return scaled(0) if x > 100 else x',
        'Pair = tuple[int, int]\ntwice = lambda x: 2 * x',
        '@dataclass(frozen=True)\nclass Point:\n    x: float = math.pi\n',
        CLASS.format(
            duty="round(scaled(len(TABLE)) + BIG.sum() + twice(Point().x) + TABLE['a'][1][0])"
        ),
    )
    text = excerpt_of(main.Mine)
    assert 'import math, os' in text
    assert 'Pair' not in text  # unused
    assert first_duty(main.Mine) == main.Mine().tick(None)[0] == round(4 + 12 + 2 * math.pi + 2.5)


@pytest.mark.parametrize(
    ('value', 'text'),
    [
        (math.inf, "float('inf')"),
        (-1.5, '-1.5'),
        (np.float64(2.5), '2.5'),
        (np.int8(3), '3'),
        (True, 'True'),
        (None, 'None'),
        ('a\n', r"'a\n'"),
        ((1,), '(1,)'),
        ([(), {1: [2.0]}], '[(), {1: [2.0]}]'),
        (np.array([1, 2], np.int16), "numpy.array([1, 2], 'int16')"),
        (np.array([[math.nan, 1.0]]), "numpy.array([[float('nan'), 1.0]], 'float64')"),
    ],
)
def test_a_value_is_written_as_it_is_now(notebook, value, text):
    main = notebook(IMPORTS, 'value = None', CLASS.format(duty='value'))
    main.value = value
    source = excerpt_of(main.Mine)
    assert f'\nvalue = {text}\n' in source
    names = {}
    exec(source, {'__name__': 'excerpt'}, names)
    np.testing.assert_equal(names['value'], value)


@pytest.mark.parametrize(
    ('value', 'told'),
    [
        (object, "Mine uses value, which is <class 'object'>"),
        ([1, {2}], 'Mine uses value, which is {2}'),
        (np.zeros(MAX_ELEMENTS + 1), f'which is an array of {MAX_ELEMENTS + 1} elements'),
        (np.array(['a']), "which is array(['a']"),
    ],
)
def test_a_value_that_cannot_be_written_is_refused(notebook, value, told):
    main = notebook(IMPORTS, 'value = None', CLASS.format(duty='value'))
    main.value = value
    with pytest.raises(ControllerError) as refusal:
        excerpt_of(main.Mine)
    assert told in str(refusal.value)
    assert '\n' not in str(refusal.value)


def test_the_newest_definition_counts(notebook):
    main = notebook(
        IMPORTS,
        'def gain():\n    return 1',
        CLASS.format(duty='gain()'),
        'def gain():\n    return 7',
    )
    main.In.append('this is no Python')
    assert first_duty(main.Mine) == 7
    former = main.Mine
    exec(CLASS.format(duty='2'), vars(main))
    with pytest.raises(ControllerError, match='Mine is defined again'):
        excerpt_of(former)


def test_a_class_in_a_condition_or_loop_counts(notebook):
    main = notebook(
        f'if True:\n    try:\n        {IMPORTS}\n    finally:\n        pass',
        'for gain in 1, 2:\n    ' + CLASS.format(duty='gain').replace('\n', '\n    '),
    )
    assert first_duty(main.Mine) == 2


def test_annotations_are_kept(notebook):
    main = notebook(
        f'from __future__ import annotations\nfrom typing import Literal\n{IMPORTS}\n'
        'from ballbot_ros.controllers import Readings, quantity, setting\n'
        'from dataclasses import dataclass',
        '@dataclass(frozen=True)\nclass Own:\n'
        "    kind: Literal['a', 'b'] = setting('a', 'kind')\n"
        "    gain: float = quantity(5, '1', (0, 9), 'gain')",
        'class Mine(Controller[Own]):\n'
        '    def tick(self, readings: Readings):\n        return int(self.parameters.gain), 0\n',
    )
    assert excerpt_of(main.Mine).splitlines()[2] == 'from __future__ import annotations'
    assert first_duty(main.Mine) == 5


def test_a_class_that_is_not_at_the_top_level_is_refused(notebook):
    main = notebook(IMPORTS, 'def make():\n    class Inner(Controller):\n        pass\n'
                    '    return Inner')  # fmt: skip
    with pytest.raises(ControllerError, match='Inner is not defined at the top level'):
        excerpt_of(main.make())

    class Local(Controller):
        pass

    with pytest.raises(ControllerError, match='Local is not defined at the top level of its file'):
        reference_to(Local)


def test_a_class_without_a_source_is_refused(notebook):
    main = notebook(IMPORTS, CLASS.format(duty='1'))
    main.In = []
    with pytest.raises(ControllerError, match='Mine: its source was not found'):
        excerpt_of(main.Mine)
    unknown = type('Unknown', (Controller,), {'__module__': 'nowhere'})
    with pytest.raises(ControllerError, match=r'nowhere\.Unknown: its source was not found'):
        reference_to(unknown)


def test_a_class_of_a_module_is_found_where_it_is(tmp_path, monkeypatch):
    assert reference_to(LQG) == 'ballbot_ros.controllers.lqg:LQG'
    path = tmp_path / 'mine.py'
    path.write_text(f'{IMPORTS}\n{CLASS.format(duty=4)}')
    loaded = load_controller(f'{path}:Mine').cls
    assert reference_to(loaded) == f'{path}:Mine'
    monkeypatch.syspath_prepend(tmp_path)
    from mine import Mine  # type: ignore[import-not-found]

    assert reference_to(Mine) == 'mine:Mine'


def test_a_main_program_is_not_executed_again(tmp_path):
    path = tmp_path / 'program.py'
    path.write_text(
        f'{IMPORTS}\nfrom ballbot_ros.controllers.excerpt import reference_to\n'
        'from ballbot_ros.controllers.loading import load_controller\n'
        f'{CLASS.format(duty="1 // (readings - 1)")}\n'
        'print("executed")\nreference = reference_to(Mine)\nprint(reference)\n'
        'loaded = load_controller(reference)\n'
        'try:\n    loaded.cls().tick(1)\nexcept ZeroDivisionError as error:\n'
        '    print(loaded.code.describe(error))\n'
    )
    done = subprocess.run([sys.executable, path], capture_output=True, text=True, check=True)
    executed, reference, described = done.stdout.splitlines()
    assert executed == 'executed'
    assert reference.endswith(f'/Mine{EXCERPT_SUFFIX}:Mine')
    # The user has not seen the file, so the message has the text of the line.
    assert described == (
        f'Mine{EXCERPT_SUFFIX}:9 (return 1 // (readings - 1), 0): '
        'ZeroDivisionError: integer division or modulo by zero'
    )
