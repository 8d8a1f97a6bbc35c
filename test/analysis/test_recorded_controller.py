"""Which code replays a run of a user's controller."""

import hashlib
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from graph import BALLBOT
from own_controllers import BALANCE
from recordings import copy_recording

from ballbot_ros.analysis.recorded_controller import (
    ControllerIdentity,
    decode_controller,
    find_recorded,
    identity_of,
)
from ballbot_ros.analysis.recording_replay import RecordingReplay
from ballbot_ros.errors import ControllerError, RecordingError
from ballbot_ros.lockstep.participants import SOURCE_HASH
from ballbot_ros.parameters import ParameterError
from ballbot_ros.recording.reader import AttachedFile, RecordingReader
from ballbot_ros.run.execution import execute
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.spec import RunOptions, RunSpec


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def record(controller, *assignments):
    options = RunOptions(
        processes=Processes.NONE,
        controller=controller,
        assignments=['plant_sim.duration=1.2', *assignments],
        output=Path('run'),
    )
    return execute(RunSpec.of_scenario('stationary', options)).recording


def replay(path, tmp_path, controller=None, **options):
    with RecordingReader(path) as reader:
        replay = RecordingReplay(reader, tmp_path / 'scratch', controller, **options)
        results = (replay.replay_controller(lambda _: None), replay.replay_robot(lambda _: None))
        assert [each.difference for each in results] == [None, None]
        return replay.controllers


def refusal(path, tmp_path, *arguments, **options):
    with pytest.raises(ControllerError) as raised:
        replay(path, tmp_path, *arguments, **options)
    words = str(raised.value)
    assert '\n' not in words
    assert str(path) in words
    return words


def test_the_users_own_file_replays_a_run(folder):
    Path('mine.py').write_text(BALANCE)
    path = record('mine.py:Balance', 'controller.user.rate=2.0')
    (one,) = replay(path, folder, 'mine.py:Balance')
    assert (one.recorded, one.replayed, one.is_portable) == (*['mine.py:Balance'] * 2, True)
    with RecordingReader(path) as reader:
        files = reader.attachments()
    assert files['controller.py'].data.decode() == BALANCE
    assert str(folder) not in files['parameters.yaml'].data.decode()
    assert str(folder) not in files['controller.yaml'].data.decode()

    Path('mine.py').rename('renamed.py')
    words = refusal(path, folder, 'mine.py:Balance')
    assert 'mine.py: No such file or directory' in words
    assert '--trust-attached-code' in words
    replay(path, folder, 'renamed.py:Balance')


def test_other_code_does_not_replay_it(folder):
    Path('mine.py').write_text(BALANCE)
    path = record('mine.py:Balance')
    Path('mine.py').write_text(BALANCE + "\nopen('executed', 'w')\n")
    words = refusal(path, folder, 'mine.py:Balance')
    assert re.search(r'but mine.py has changed \(sha256 \w{12}\); give your copy', words)
    assert '--code of branch and view, FILE.py:Class or package.module:Class, or' in words
    refusal(path, folder, 'none.py:Balance')
    for name in ('python', 'c'):
        assert 'can be replayed only by mine.py:Balance (sha256' in refusal(path, folder, name)
    assert not Path('executed').exists()  # other code is not even executed


EXECUTES = "\nopen('executed', 'w')\n"


@pytest.mark.parametrize('reference', ['mine.py:Mine', './mine.py:Mine', 'mine:Mine', 'mine'])
def test_a_recording_selects_neither_a_file_nor_a_module(folder, monkeypatch, reference):
    monkeypatch.syspath_prepend(str(folder))
    Path('mine.py').write_text(EXECUTES)
    sha256 = hashlib.sha256(EXECUTES.encode()).hexdigest()
    identity = ControllerIdentity(reference, 'mine:Mine', sha256)
    with pytest.raises(ControllerError, match='but that is not installed as a controller') as error:
        find_recorded(identity, Path('run.mcap'), None)
    assert '--trust-attached-code' in str(error.value)
    assert not Path('executed').exists()


def test_a_replay_executes_nothing_that_only_the_recording_names(command, folder):
    Path('mine.py').write_text(BALANCE)
    path = record('mine.py:Balance')
    Path('mine.py').write_text(EXECUTES)
    other = hashlib.sha256(EXECUTES.encode()).hexdigest().encode()
    own = hashlib.sha256(BALANCE.encode()).hexdigest().encode()
    changed = copy_recording(
        folder / 'changed.mcap',
        path,
        wanted=lambda topic: not topic.endswith('participants'),
        attach=lambda data: data.replace(own, other),
    )
    status, output, errors = command('replay', changed)
    assert (status, output) == (2, '')
    assert errors.count('\n') == 1
    assert 'its controller is mine.py:Balance' in errors
    assert not Path('executed').exists()


def test_attached_code_runs_only_by_request(folder):
    text = BALANCE + "\nopen('executed', 'w')\n"
    Path('mine.py').write_text(text)
    path = record('mine.py:Balance')
    Path('executed').unlink()
    Path('mine.py').unlink()
    refusal(path, folder)
    assert not Path('executed').exists()
    replay(path, folder, trust_attached_code=True)
    assert Path('executed').exists()


def test_attached_code_of_another_run_is_refused(folder):
    Path('mine.py').write_text(BALANCE)
    path = record('mine.py:Balance')
    changed = copy_recording(
        folder / 'changed.mcap',
        path,
        attach=lambda data: data + b'#' if data == BALANCE.encode() else data,
    )
    words = refusal(changed, folder, trust_attached_code=True)
    assert re.search(r'the code of mine.py:Balance \(sha256 \w{12}\) is not attached', words)


def test_a_controller_of_a_package(folder, monkeypatch):
    package = folder / 'site' / 'acme_bots'
    package.mkdir(parents=True)
    (package / '__init__.py').write_text('')
    (package / 'mine.py').write_text(
        BALANCE.replace('(Controller[Gains]):\n', '(Controller[Gains]):\n    portable = False\n')
    )
    monkeypatch.syspath_prepend(str(package.parent))
    path = record('acme_bots.mine:Balance')
    (one,) = replay(path, folder, 'acme_bots.mine:Balance')
    assert not one.is_portable
    words = [*BALLBOT, 'replay', str(path)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert 'but that is not installed as a controller' in done.stderr
    words.append('--trust-attached-code')
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert 'as recorded, not portable: its duties may differ on another machine' in done.stdout
    with RecordingReader(path) as reader:
        content = Path('attached.zip')
        content.write_bytes(reader.attachments()['controller.zip'].data)
    assert zipfile.ZipFile(content).namelist() == ['acme_bots/__init__.py', 'acme_bots/mine.py']

    (package / 'more.py').write_text('')
    assert 'has changed' in refusal(path, folder, 'acme_bots.mine:Balance')
    # In this process the package is imported, and hides the attached one.
    assert 'hides the attached code' in refusal(path, folder, trust_attached_code=True)
    for name in [name for name in sys.modules if name.partition('.')[0] == 'acme_bots']:
        del sys.modules[name]


def test_a_run_of_the_documents_program_is_replayed_by_nothing_else(folder):
    Path('mine.py').write_text(BALANCE)
    path = record('python')
    assert 'can be replayed only by python, c, arm' in refusal(path, folder, 'mine.py:Balance')


def test_another_class_of_the_file_does_not_replay_it(folder):
    Path('mine.py').write_text(BALANCE + '\n\nclass Other(Balance):\n    pass\n')
    path = record('mine.py:Balance')
    assert 'Other is another class of mine.py' in refusal(path, folder, 'mine.py:Other')


def test_a_recording_without_the_identity_of_its_controller_is_refused(folder):
    Path('mine.py').write_text(BALANCE)
    path = record('mine.py:Balance')
    with RecordingReader(path) as reader:
        identity = reader.attachments()['controller.yaml'].data
    changed = copy_recording(
        folder / 'changed.mcap', path, attach=lambda data: None if data == identity else data
    )
    with pytest.raises(RecordingError, match=r'controller\.yaml is missing or cannot be read'):
        replay(changed, folder)


def test_a_replay_can_not_set_another_controller(folder):
    Path('mine.py').write_text(BALANCE)
    for controller, other in (('mine.py:Balance', 'python'), ('python', 'lqg')):
        path = record(controller)
        with RecordingReader(path) as reader:
            own = controller if ':' in controller else None
            made = RecordingReplay(reader, folder / 'scratch', own)
            with pytest.raises(ParameterError, match='can replay this run'):
                made.replay_with([f'controller.implementation={other}'], lambda _: None)
            with pytest.raises(ParameterError, match='has no parameter'):
                made.replay_with(['controller.user.none=1'], lambda _: None)
        path.unlink()


def test_a_recording_can_name_the_class_of_an_installed_controller(folder):
    replay(record('ballbot_ros.controllers.pid:PID'), folder)


@pytest.mark.parametrize('name', ['pid', 'lqg', 'drift_filter', 'mpc'])
def test_the_included_controllers_replay_identically(folder, name):
    if name == 'mpc':
        pytest.importorskip('osqp')
    (one,) = replay(record(name, 'plant_sim.duration=2'), folder)
    assert (one.replayed, one.is_portable) == (name, name != 'mpc')


IDENTITY = ControllerIdentity('mine.py:Mine', '', 'a' * 64, 'acme 1.0', False)


def test_the_identity_of_a_run_is_the_announced_one():
    other = 'b' * 64
    assert identity_of('mine.py:Mine', {}, IDENTITY) == IDENTITY
    assert identity_of('mine.py:Mine', {SOURCE_HASH: other}, IDENTITY).sha256 == other
    assert identity_of('mine.py:Mine', {SOURCE_HASH: other}, None).sha256 == other
    assert identity_of('folder/mine.py:Mine', {}, IDENTITY) == IDENTITY
    assert identity_of('other.py:Mine', {SOURCE_HASH: other}, IDENTITY).package == ''
    assert identity_of('other.py:Mine', {}, IDENTITY) is None
    assert identity_of('rust', {}, None) is None
    assert IDENTITY.description == (
        'mine.py:Mine of acme 1.0 (sha256 aaaaaaaaaaaa), not portable: its duties may differ on '
        'another machine'
    )


@pytest.mark.parametrize(
    'data',
    [
        b'',
        b'3',
        b'{',
        b'reference: 3',
        b'sha256: "a\\n"',
        b'\xff',
        b'reference: a\nsha256: b\nportable: 1',
        b'[' * 1000,
    ],
)
def test_an_identity_that_can_not_be_read_is_none(data):
    files = {'controller.yaml': AttachedFile('application/yaml', data)}
    assert decode_controller(files) is None
    assert decode_controller({}) is None
