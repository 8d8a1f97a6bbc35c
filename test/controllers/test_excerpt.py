"""A class of a notebook or main program as a file that stands alone."""

import math
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from notebook_cells import IMPORT, controller_class, notebook

from ballbot_ros.controllers import Controller
from ballbot_ros.controllers.class_reference import reference_to, require_unchanged
from ballbot_ros.controllers.errors import ControllerError
from ballbot_ros.controllers.excerpt import MAX_ELEMENTS, excerpt_of
from ballbot_ros.controllers.loading import EXCERPT_SUFFIX, load_controller
from ballbot_ros.controllers.lqg import LQG

__all__ = ['notebook']


@pytest.fixture
def first_duty(tmp_path):
    """Return a function that returns the duty of a class's excerpt."""
    return lambda cls: load_controller(reference_to(cls, tmp_path)).cls().tick(None)[0]


@pytest.fixture
def refused(tmp_path):
    """Return a function that returns why there is no excerpt of a class."""

    def refused(cls):
        with pytest.raises(ControllerError) as refusal:
            reference_to(cls, tmp_path)
        assert '\n' not in str(refusal.value)
        return str(refusal.value)

    return refused


def test_a_class_takes_along_everything_that_it_uses(notebook, first_duty):
    notebook.run(
        f'import math, os.path\nimport numpy as np\n{IMPORT}\nfrom dataclasses import dataclass',
        "GAIN = 2.0\nTABLE = {'a': [1, (2.5,)], 'b': None}\nBIG = np.full((2, 2), 3.0)",
        'def scaled(x):\n    unused = GAIN\n    return again(x) * unused\n'
        'def again(x):\n    return scaled(0) if x > 100 else x',
        'Unused = tuple[int, int]\nPair = tuple[int, int]\ntwice = lambda x: 2 * x\nsame = again',
        '@dataclass(frozen=True)\nclass Point:\n    x: float = math.pi\n',
        controller_class(
            "round(scaled(len(TABLE)) + BIG.sum() + twice(Point().x) + TABLE['a'][1][0] + same(1))"
        ).replace('(self, readings)', '(self, readings) -> Pair'),
    )
    text = excerpt_of(notebook.Mine)
    assert 'import math\n' in text
    assert 'Unused' not in text
    expected = round(4 + 12 + 2 * math.pi + 2.5 + 1)
    assert first_duty(notebook.Mine) == notebook.Mine().tick(None)[0] == expected


@pytest.mark.parametrize(
    ('value', 'text'),
    [
        (math.inf, "float('inf')"),
        (-1.5, '-1.5'),
        (np.float32(0.1), "numpy.dtype('float32').type(0.10000000149011612)"),
        (True, 'True'),
        (None, 'None'),
        ('a\n', r"'a\n'"),
        ((1,), '(1,)'),
        ([(), {1: [2.0]}], '[(), {1: [2.0]}]'),
        (np.array([1, 2], np.int16), "numpy.array([1, 2], 'int16').reshape((2,))"),
        (np.zeros((0, 3)), "numpy.array([], 'float64').reshape((0, 3))"),
        (np.array([[math.nan]]), "numpy.array([float('nan')], 'float64').reshape((1, 1))"),
    ],
)
def test_a_value_is_written_as_it_is_now(notebook, value, text):
    notebook.run(IMPORT, 'value = None', controller_class('value'))
    notebook.value = value
    source = excerpt_of(notebook.Mine)
    assert f'\nvalue = {text}\n' in source
    names = {}
    exec(source, {'__name__': 'excerpt'}, names)
    np.testing.assert_equal(names['value'], value)
    assert type(names['value']) is type(value)


ZERO_DIVISION = 'ZeroDivisionError: integer division or modulo by zero'
RECURSIVE = []
RECURSIVE.append(RECURSIVE)


@pytest.mark.parametrize(
    ('value', 'told'),
    [
        (object(), 'Mine uses value, which is <object object'),
        ([1, {2}], 'Mine uses value, which is {2}: only imports'),
        (np.zeros(MAX_ELEMENTS + 1), f'which is an array of {MAX_ELEMENTS + 1} elements'),
        (np.array(['a']), "which is array(['a']"),
        (np.ma.array([1.0]), 'which is masked_array('),
        (RECURSIVE, 'which is [[...]]'),
    ],
)
def test_a_value_that_cannot_be_written_is_refused(notebook, refused, value, told):
    notebook.run(IMPORT, 'value = None', controller_class('value'))
    notebook.value = value
    assert told in refused(notebook.Mine)


def test_the_definition_that_was_executed_counts(notebook, first_duty, refused):
    notebook.run(IMPORT, 'def gain():\n    return 1', controller_class('gain()'))
    former = notebook.Mine
    assert first_duty(former) == 1
    notebook.run('def gain():\n    return 7')
    assert first_duty(former) == 7
    with pytest.raises(ZeroDivisionError):
        notebook.run('1 / 0\ndef gain():\n    return 8')
    with pytest.raises(SyntaxError):
        notebook.run('this is no Python')
    assert first_duty(former) == 7
    notebook.run(controller_class('2'))
    assert 'Mine is defined again' in refused(former)
    notebook.run(
        'if True:\n    ' + controller_class('3').replace('\n', '\n    ') + '\n'
        'else:\n    ' + controller_class('4').replace('\n', '\n    ')
    )
    assert first_duty(notebook.Mine) == 3


@pytest.mark.parametrize(
    ('change', 'where'),
    [
        ('Mine.gain = 2', 'Mine.gain'),
        ('Mine.extra = 2', 'Mine.extra'),
        ('Mine.tick = lambda self, readings: (3, 0)', 'Mine.tick'),
        ('Base.table[0] = 2', 'Base.table'),
        ('helper.__defaults__ = (2,)', 'helper'),
        ('del Base.table', 'Base.table'),
    ],
)
def test_a_change_after_the_definition_is_not_dropped(notebook, first_duty, refused, change, where):
    notebook.run(
        IMPORT,
        'class Base(Controller):\n    table = [1]\ndef helper(x=1):\n    return x',
        'class Mine(Base):\n    gain = 1\n'
        '    def tick(self, readings):\n        return helper() * self.gain, 0\n',
    )
    assert first_duty(notebook.Mine) == 1
    notebook.run(change)
    assert f'Mine: {where} is not as its definition says' in refused(notebook.Mine)


def test_each_change_of_many_alike_is_found(notebook, first_duty, refused):
    methods = [f'    def m{each}(self, x=1):\n        return x\n' for each in range(30)]
    notebook.run(
        IMPORT,
        'class Base:\n' + ''.join(methods),
        controller_class('self.m3()').replace('(Controller)', '(Controller, Base)'),
    )
    assert first_duty(notebook.Mine) == 1
    for each in range(30):
        method = getattr(notebook.Base, f'm{each}')
        method.__defaults__ = (2,)
        assert f'Base.m{each} is not as its definition says' in refused(notebook.Mine)
        method.__defaults__ = (1,)


def test_threads_may_use_a_class_at_the_same_time(notebook, tmp_path):
    notebook.run(
        IMPORT,
        'import time\n'
        + controller_class('1').replace('def tick', 'pause = time.sleep(0.05)\n    def tick'),
    )
    folders = [tmp_path / str(each) for each in range(4)]
    for folder in folders:
        folder.mkdir()
    with ThreadPoolExecutor() as pool:
        references = list(pool.map(lambda folder: reference_to(notebook.Mine, folder), folders))
    assert [load_controller(each).cls().tick(None) for each in references] == [(1, 0)] * 4


@pytest.mark.parametrize(
    'definition',
    [
        controller_class('2').replace('def tick', 'gain = G\n    def tick'),
        'def helper(x=G):\n    return x\n' + controller_class('helper()'),
        'def make(g):\n    return lambda: g\nget = make(G)\n' + controller_class('get()'),
        'def double(f):\n    return lambda: 2 * f()\ndef get():\n    return 1\nget = double(get)\n'
        + controller_class('get()'),
    ],
)
def test_an_expression_that_would_give_another_value_now_is_refused(notebook, refused, definition):
    notebook.run(IMPORT, 'G = 1', definition, 'G = 2')
    told = refused(notebook.Mine)
    assert 'is not as its definition says' in told or 'definition of get was not found' in told


def test_names_are_imported_as_they_were(notebook, first_duty):
    notebook.run(
        f'{IMPORT}\nfrom math import *\nimport os.path, json as j\n'
        'try:\n    import numpy as maybe\nexcept ImportError:\n    maybe = None',
        'import numpy.linalg\nfrom collections import OrderedDict as Ordered\nvalue = Ordered',
        'helper = 3\nhelpers = [helper for helper in (1, 2)]',
        'if True:\n    def helper():\n        value = 1\n        return value',
        controller_class(
            'round(sin(0) + len(j.dumps(1)) + numpy.linalg.norm([3, 4]) + len(value()) + helper()'
            ' + len(os.path.sep) + maybe.ones(2).sum())'
        ),
    )
    assert first_duty(notebook.Mine) == notebook.Mine().tick(None)[0] == 10


def test_bases_come_before_classes_that_use_each_other(notebook, first_duty):
    notebook.run(
        IMPORT,
        'class First:\n    def other(self):\n        return Second.value\n',
        'class Second(First):\n    value = 5\n',
        controller_class('Second().other()'),
    )
    assert first_duty(notebook.Mine) == 5


def test_a_class_in_a_condition_or_loop_counts(notebook, first_duty):
    text = controller_class('len("""a\n  b""") + gain').replace('\n', '\n    ')
    notebook.run(
        f'if True:\n    try:\n        {IMPORT}\n    finally:\n        pass',
        f'for gain in 1, 2:\n    {text}',
    )
    assert first_duty(notebook.Mine) == notebook.Mine().tick(None)[0]


def test_annotations_are_kept(notebook, first_duty):
    notebook.run(
        f'from __future__ import annotations\nfrom typing import Literal\n{IMPORT}\n'
        'from ballbot_ros.controllers import Readings, quantity, setting\n'
        'from dataclasses import dataclass',
        '@dataclass(frozen=True)\nclass Own:\n'
        "    kind: Literal['a', 'b'] = setting('a', 'kind')\n"
        "    gain: float = quantity(5, '1', (0, 9), 'gain')",
        'class Mine(Controller[Own]):\n'
        '    def tick(self, readings: Readings):\n        return int(self.parameters.gain), 0\n',
    )
    assert excerpt_of(notebook.Mine).splitlines()[2] == 'from __future__ import annotations'
    assert first_duty(notebook.Mine) == 5
    notebook.run('Own.gain = 6')
    with pytest.raises(ControllerError, match=r'Own\.gain|parameters_class\.gain'):
        first_duty(notebook.Mine)


def test_a_class_whose_definition_is_hidden_is_refused(notebook, refused):
    inner = controller_class('1').replace('\n', '\n    ')
    notebook.run(IMPORT, f'def make():\n    {inner}\n    return Mine')
    assert 'Mine is not defined at the top level' in refused(notebook.make())
    notebook.Mine = notebook.make()
    assert 'the definition of Mine was not found' in refused(notebook.Mine)

    class Local(Controller):
        pass

    assert 'Local is not defined at the top level of its file' in refused(Local)
    unknown = type('Unknown', (Controller,), {'__module__': 'nowhere'})
    assert 'nowhere.Unknown: its source was not found' in refused(unknown)


def test_a_class_of_a_module_is_found_where_it_is(tmp_path, monkeypatch):
    assert reference_to(LQG, tmp_path) == 'ballbot_ros.controllers.lqg:LQG'
    path = tmp_path / 'mine.py'
    path.write_text(f'{IMPORT}\n{controller_class(4)}')
    assert reference_to(load_controller(f'{path}:Mine').cls, tmp_path) == f'{path}:Mine'
    monkeypatch.syspath_prepend(tmp_path)
    from mine import Mine  # type: ignore[import-not-found]

    assert reference_to(Mine, tmp_path) == 'mine:Mine'


def test_an_instance_that_was_changed_is_refused(notebook):
    notebook.run(
        IMPORT,
        'class State:\n    def __init__(self):\n        self.sum = 0.0\n',
        controller_class('1').replace(
            'def tick', 'def start(self):\n        self.state, self.k = State(), 1\n    def tick'
        ),
    )
    require_unchanged(notebook.Mine())
    for change, where in (
        (lambda mine: setattr(mine, 'k', 2), 'Mine.k'),
        (lambda mine: setattr(mine, 'foo', 2), 'Mine.foo'),
        (lambda mine: setattr(mine.state, 'sum', 2.0), 'Mine.state.sum'),
    ):
        mine = notebook.Mine()
        change(mine)
        with pytest.raises(ControllerError, match=f'^{where} differs from that of a new instance'):
            require_unchanged(mine)
    notebook.run('class Odd(Mine):\n    def __init__(self, k):\n        super().__init__()\n')
    with pytest.raises(ControllerError, match=r'Odd\(parameters, model\), as a run makes'):
        require_unchanged(notebook.Odd(1))
    notebook.run('class Empty(Mine):\n    def __init__(self):\n        pass\n')
    with pytest.raises(ControllerError, match=r'Empty\.__init__ does not call super'):
        require_unchanged(notebook.Empty())


def test_a_main_program_is_not_executed_again(tmp_path):
    path = tmp_path / 'program.py'
    path.write_text(
        f'{IMPORT}\nfrom pathlib import Path\n'
        'from ballbot_ros.controllers.class_reference import reference_to\n'
        'from ballbot_ros.controllers.loading import load_controller\n'
        'def run(cls):\n    reference = reference_to(cls, Path("."))\n'
        '    loaded = load_controller(reference)\n'
        '    try:\n        print(loaded.cls().tick(1))\n    except ZeroDivisionError as error:\n'
        '        print(loaded.code.describe(error))\n'
        f'{controller_class("readings")}\nprint("executed")\nrun(Mine)\n'
        f'{controller_class("1 // (readings - 1)")}\nrun(Mine)\n'
    )
    done = subprocess.run(
        [sys.executable, path], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    # The definition of the time counts. The user has not seen the file, so the message has the text
    # of the line.
    assert done.stdout.splitlines() == [
        'executed',
        '(1, 0)',
        f'Mine{EXCERPT_SUFFIX}:9 (return 1 // (readings - 1), 0): {ZERO_DIVISION}',
    ], done.stderr


def test_a_file_that_runs_itself_says_so(tmp_path):
    path = tmp_path / 'unguarded.py'
    path.write_text(
        f'{IMPORT}\nfrom ballbot_ros.controllers.loading import load_controller\n'
        f'{controller_class("1")}\nload_controller(__file__ + ":Mine")\n'
    )
    with pytest.raises(ControllerError, match="put that below `if __name__ == '__main__':`"):
        load_controller(f'{path}:Mine')
