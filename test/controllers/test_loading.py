"""Finding the code of a controller, and loading its class."""

import io
import sys
import zipfile
from importlib.metadata import EntryPoint

import pytest
from own_controllers import BALANCE

from ballbot_ros.controllers import loading
from ballbot_ros.controllers.loading import (
    Source,
    find_code,
    load_controller,
    public_reference,
    resolve_reference,
)
from ballbot_ros.errors import ControllerError


def refusal(reference):
    with pytest.raises(ControllerError) as raised:
        load_controller(reference)
    assert '\n' not in str(raised.value)
    return str(raised.value)


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Write a file into the current folder, which is empty; return its path."""
    monkeypatch.chdir(tmp_path)

    def write(text, name='mine.py'):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path

    return write


def test_a_class_in_a_file(write):
    path = write(BALANCE)
    loaded = load_controller('mine.py:Balance')
    assert (loaded.cls.__name__, loaded.code.path, loaded.code.shown) == (
        'Balance', path, 'mine.py',
    )  # fmt: skip
    assert loaded.code.source == Source('.py', BALANCE.encode())
    assert [(task.name, task.period_ms) for task in loaded.tasks] == [('tick', 4)]
    assert load_controller(f'{path}:Balance').cls is loaded.cls


def test_a_changed_file_is_loaded_again(write):
    write(BALANCE)
    before = load_controller('mine.py:Balance')
    write(BALANCE.replace('0.35', '0.36'))
    after = load_controller('mine.py:Balance')
    assert before.code.source.sha256 != after.code.source.sha256
    assert (before.cls.parameters_class().speed, after.cls.parameters_class().speed) == (0.35, 0.36)


@pytest.mark.parametrize(
    ('text', 'told'),
    [
        ('x = 1\ndef f(:\n', 'mine.py:2: SyntaxError: invalid syntax'),
        ('import no_such\n', "mine.py:1: ModuleNotFoundError: No module named 'no_such'"),
        ('\n\n1 / 0\n', 'mine.py:3: ZeroDivisionError: division by zero'),
        ('import sys\nsys.exit("no")\n', 'mine.py:2: SystemExit: no'),
        ('import json\njson.loads("{")\n', 'mine.py:2: JSONDecodeError: Expecting property name'),
        ('x = 1\n', "mine.py has no class 'Mine'; it has no controller"),
        ('Mine = 3\n', 'mine.py: Mine is of type int, but not derived from ballbot_ros.'),
        ('def Mine(): pass\n', 'mine.py: Mine is of type function, but not derived'),
        ('class Mine: pass\n', 'mine.py: Mine is a class, but not derived from'),
        ('\0', 'mine.py'),
    ],
)  # fmt: skip
def test_code_that_is_no_controller_is_refused(write, text, told):
    write(text)
    assert refusal('mine.py:Mine').startswith(told)


CLASS = 'from ballbot_ros.controllers import Controller, task\nclass Mine(Controller):\n'


@pytest.mark.parametrize(
    ('body', 'told'),
    [
        ('pass', 'has neither a method tick nor one marked by @task'),
        ('@task(4, 1)\n def a(self, r): pass\n def tick(self, r): pass', 'has both tick and tasks'),
        ('@task(6, 1)\n def a(self, r): pass', 'Mine.a: the period 6 ms is not a multiple of 4 ms'),
        ('@task(0, 1)\n def a(self, r): pass', 'the period 0 ms is not a multiple of 4 ms'),
        ('@task(4.0, 1)\n def a(self, r): pass', 'the period 4.0 ms is not a multiple of 4 ms'),
        ('@task(4, "x")\n def a(self, r): pass', "the priority 'x' is not a whole number"),
        (
            '@task(4, 1)\n def a(self, r): pass\n @task(8, 1)\n def b(self, r): pass',
            'two tasks have the same priority',
        ),
        ('@task(8, 1)\n def idle(self, r): pass', "a task must have another name than 'idle'"),
        (
            '\n'.join(f' @task(4, {n})\n def t{n}(self, r): pass' for n in range(9)).strip(),
            'has 9 tasks; the brick has 8',
        ),
    ],
)
def test_tasks_that_the_brick_can_not_run_are_refused(write, body, told):
    write(f'{CLASS} {body}\n')
    words = refusal('mine.py:Mine')
    assert words.startswith('mine.py: Mine')
    assert told in words


def test_tasks_are_sorted_and_something_makes_the_ticks(write):
    body = '@task(20, 1)\n def slow(self, r): pass\n @task(100, 7)\n def rare(self, r): pass'
    write(f'{CLASS} {body}\n')
    names = [(task.name, task.period_ms) for task in load_controller('mine.py:Mine').tasks]
    assert names == [('rare', 100), ('slow', 20), ('idle', 4)]


@pytest.mark.parametrize(
    ('reference', 'told'),
    [
        ('none.py:Mine', 'none.py: No such file or directory'),
        ('mine.py', "no controller 'mine.py': give one of python, c, arm"),
        ('mine.py:', "mine.py:: '' is not the name of a class"),
        ('mine.py:a b', "mine.py:a b: 'a b' is not the name of a class"),
        ('./:Mine', '.: Is a directory'),
        ('', "no controller '': give one of python, c, arm"),
        ('no_such_package.module:Mine', "no package or module 'no_such_package' is installed"),
        (':Mine', "no package or module '' is installed"),
        ('json.no_such:Mine', "json.no_such:Mine: no module 'json.no_such' in "),
        ('sys:Mine', "sys:Mine: no package or module 'sys' is installed"),
    ],
)
def test_a_reference_to_nothing_is_refused(write, reference, told):
    assert told in refusal(reference)


def test_other_controllers_of_the_file_are_named(write):
    write(BALANCE)
    assert refusal('mine.py:Balanced') == "mine.py has no class 'Balanced'; it has Balance"


@pytest.fixture
def package(write, monkeypatch):
    """Make a package with two modules that can be imported."""
    folder = write(BALANCE, 'site/acme_bots/control/balance.py').parents[2]
    write('', 'site/acme_bots/__init__.py')
    write('', 'site/acme_bots/control/__init__.py')
    monkeypatch.syspath_prepend(str(folder))
    yield 'acme_bots.control.balance:Balance'
    for name in [name for name in sys.modules if name.partition('.')[0] == 'acme_bots']:
        del sys.modules[name]


def test_a_class_in_a_package_and_the_archive_of_its_code(package):
    code = find_code(package)
    assert 'acme_bots.control' not in sys.modules  # nothing has been executed
    with zipfile.ZipFile(io.BytesIO(code.source.data)) as archive:
        assert archive.namelist() == [
            'acme_bots/__init__.py',
            'acme_bots/control/__init__.py',
            'acme_bots/control/balance.py',
        ]
        assert archive.read('acme_bots/control/balance.py').decode() == BALANCE
    assert find_code(package).source == code.source
    assert load_controller(package).cls.__module__ == 'acme_bots.control.balance'
    assert refusal('acme_bots.control.balance:Other').endswith('it has Balance')


def test_the_archive_depends_only_on_the_content(package):
    before = find_code(package).source
    folder = find_code(package).folder
    (folder / '__init__.py').touch()
    (folder / 'data.txt').write_text('not code')
    assert find_code(package).source.sha256 == before.sha256
    (folder / 'more.py').write_text('')
    assert find_code(package).source.sha256 != before.sha256


def claims(monkeypatch, *points):
    monkeypatch.setattr(
        loading,
        'entry_points',
        lambda group: [EntryPoint(name, value, group) for name, value in points],
    )


def test_an_installed_controller_by_its_name(package, monkeypatch):
    claims(monkeypatch, ('acme', package), ('acme', package))
    assert load_controller('acme').cls.__name__ == 'Balance'
    assert 'give one of python, c, arm, acme, or' in refusal('amce')


def test_a_name_that_two_packages_claim_is_refused(monkeypatch):
    claims(monkeypatch, ('lqg', 'a.b:LQG'), ('lqg', 'c:Other'))
    words = refusal('lqg')
    assert 'several packages have this name' in words
    assert 'a.b:LQG' in words
    assert 'c:Other' in words


def test_only_what_is_below_the_current_folder_is_public(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert public_reference(f'{tmp_path}/a/mine.py:Mine') == 'a/mine.py:Mine'
    assert public_reference('/home/me/secret/mine.py:Mine') == 'mine.py:Mine'
    assert public_reference('a.b:Mine') == 'a.b:Mine'
    assert resolve_reference('mine.py:Mine', tmp_path) == f'{tmp_path}/mine.py:Mine'
    assert resolve_reference('/a/mine.py:Mine', tmp_path) == '/a/mine.py:Mine'
    for other in ('python', 'a.b:Mine'):
        assert resolve_reference(other, tmp_path) == other
