"""Classes of controllers that a program has already: of modules, notebooks and main programs."""

import subprocess
import sys

import numpy as np
import pytest
from notebook_cells import IMPORT, controller_class, notebook

import ballbot_ros as bb
from ballbot_ros.controllers import Controller
from ballbot_ros.controllers.class_reference import reference_to, require_unchanged
from ballbot_ros.controllers.loading import load_controller
from ballbot_ros.controllers.lqg import LQG
from ballbot_ros.errors import ControllerError
from ballbot_ros.recording.reader import RecordingReader

__all__ = ['notebook']

SHORT = {'plant_sim.duration': 0.6, 'plant_sim.timeout': 1.0}


def simulate(controller):
    return bb.simulate(controller=controller, parameters=SHORT)


def test_a_class_of_a_notebook_runs_as_it_is(notebook):
    notebook.run(
        f'{IMPORT}\nopened = open(__file__) if False else object()\ngain = 2',
        controller_class('gain + self.more + (opened is None)').replace(
            'def tick', 'more = 1\n    def tick'
        ),
        'gain = 3\nMine.more = 4',
    )
    former = notebook.Mine
    assert simulate(former).trajectory.duty[-1, 0] == 7
    notebook.run(controller_class('5'))
    assert simulate(notebook.Mine).trajectory.duty[-1, 0] == 5
    assert simulate(former()).trajectory.duty[-1, 0] == 7

    def make():
        class Inner(former):
            gain = 2

        return Inner

    inner = make()
    inner.__module__ = '__main__'
    assert simulate(inner).trajectory.duty[-1, 0] == 7


def test_the_text_of_its_cell_is_attached_for_reading(notebook, tmp_path, command):
    cell = f'gain = 3\n{controller_class("gain")}'
    notebook.run(IMPORT, cell, 'class Same(Mine):\n    pass\n', 'gain = 4')
    path = simulate(notebook.Mine).save(tmp_path / 'run.mcap')
    with RecordingReader(path) as reader:
        assert reader.attachments()['controller.py'].data.decode() == cell
    without_functions = reference_to(notebook.Same).code.source
    assert without_functions.data.decode() == 'class Same(Mine):\n    pass\n'

    for options in ((), ('--trust-attached-code',), ('--controller', 'none.py:Mine')):
        status, output, errors = command('replay', path, *options)
        assert (status, output, errors.count('\n')) == (2, '', 1)
        assert 'its controller is __main__:Mine (sha256 ' in errors
        assert 'to a file and give it as --controller of replay' in errors
        assert 'FILE.py:Mine' in errors
    for gain, expected in ((4, 0), (5, 1)):
        own = tmp_path / f'own{gain}.py'
        own.write_text(f'{IMPORT}\n{cell}\ngain = {gain}\n')
        status, output, _ = command('replay', path, '--controller', f'{own}:Mine')
        assert status == expected
        assert f'own{gain}.py:Mine, recorded __main__:Mine' in output


def test_a_fault_in_a_cell_shows_its_line(notebook):
    notebook.run(
        f'{IMPORT}\ndef wait():\n    while True: pass\n',
        controller_class('1 // (readings.elapsed_ms - 400)', 'Raises'),
        controller_class('wait() if readings.elapsed_ms == 400 else 0', 'Hangs'),
        controller_class('1.5', 'ReturnsFloats'),
    )
    assert simulate(notebook.Raises).reason.startswith(
        'controller: cell:3 (return 1 // (readings.elapsed_ms - 400), 0): ZeroDivisionError: '
        'integer division or modulo by zero (Raises.tick at 0.400 s; '
    )
    assert simulate(notebook.Hangs).reason.startswith(
        'controller: cell:3 (while True: pass): does not return within 1 s (Hangs.tick at 0.400 s; '
    )
    with pytest.raises(
        bb.BallbotError, match=r'^controller: cell:2 \(def tick.*\): returned \(1\.5'
    ):
        simulate(notebook.ReturnsFloats)
    notebook.run(controller_class('1', 'Odd') + '    portable = 1\n')
    with pytest.raises(ControllerError, match=r'^cell: Odd\.portable: 1 is not True or False'):
        reference_to(notebook.Odd)


def test_a_main_program_is_not_executed_again(tmp_path):
    path = tmp_path / 'program.py'
    path.write_text(
        f'{IMPORT}\nimport ballbot_ros as bb\nprint("executed")\n'
        f'{controller_class("1 // (readings.elapsed_ms - 400)")}'
        'print(bb.simulate(controller=Mine).reason)\n'
    )
    done = subprocess.run(
        [sys.executable, path], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    executed, reason = done.stdout.splitlines()
    assert executed == 'executed'
    assert reason.startswith('controller: program.py:6: ZeroDivisionError'), done.stderr


def test_a_class_whose_source_is_not_found_is_refused():
    class Local(Controller):
        pass

    with pytest.raises(ControllerError, match='Local is not defined at the top level of its file'):
        reference_to(Local)
    unknown = type('Unknown', (Controller,), {'__module__': 'nowhere'})
    with pytest.raises(ControllerError, match=r'nowhere\.Unknown: its source was not found'):
        reference_to(unknown)


def test_a_class_of_a_module_is_found_where_it_is(tmp_path, monkeypatch):
    assert reference_to(LQG) == 'ballbot_ros.controllers.lqg:LQG'
    path = tmp_path / 'mine.py'
    path.write_text(f'{IMPORT}\n{controller_class(4)}')
    assert reference_to(load_controller(f'{path}:Mine').cls) == f'{path}:Mine'
    monkeypatch.syspath_prepend(tmp_path)
    from mine import Mine  # type: ignore[import-not-found]

    assert reference_to(Mine) == 'mine:Mine'
    assert load_controller('mine:Mine').cls is Mine
    path.write_text(f'{IMPORT}\n{controller_class(5)}')
    with pytest.raises(ControllerError, match=r'mine\.py has changed since it was imported'):
        load_controller('mine:Mine')
    del sys.modules['mine']


def test_an_instance_that_was_changed_is_refused(notebook):
    notebook.run(
        f'{IMPORT}\nimport numpy as np',
        controller_class('1').replace(
            'def tick',
            'def start(self):\n        self.k, self.f, self.nan = 1, lambda: 0, float("nan")\n'
            '        self.a, self.random = np.zeros(3), np.random.default_rng()\n    def tick',
        ),
    )
    require_unchanged(notebook.Mine())
    for name, value in (('k', 2), ('k', 1.0), ('foo', 2), ('a', np.ones(3))):
        mine = notebook.Mine()
        setattr(mine, name, value)
        with pytest.raises(
            ControllerError, match=rf'^Mine\.{name} differs from that of a new instance'
        ):
            require_unchanged(mine)
    notebook.run('class Odd(Mine):\n    def __init__(self, k):\n        super().__init__()\n')
    with pytest.raises(ControllerError, match=r'Odd\(parameters, model\), as a run makes'):
        require_unchanged(notebook.Odd(1))
    notebook.run('class Empty(Mine):\n    def __init__(self):\n        pass\n')
    with pytest.raises(ControllerError, match=r'Empty\.__init__ does not call super'):
        require_unchanged(notebook.Empty())


def test_a_file_that_runs_itself_says_so(tmp_path):
    path = tmp_path / 'unguarded.py'
    path.write_text(
        f'{IMPORT}\nfrom ballbot_ros.controllers.loading import load_controller\n'
        f'{controller_class("1")}\nload_controller(__file__ + ":Mine")\n'
    )
    with pytest.raises(ControllerError, match="put that below `if __name__ == '__main__':`"):
        load_controller(f'{path}:Mine')
