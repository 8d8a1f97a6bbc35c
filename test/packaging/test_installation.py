"""What a command needs beyond a first run: found, offered, installed, and the command restarted."""

import importlib.metadata
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from graph import call
from packaging.requirements import Requirement

from ballbot_ros.cli import install as command
from ballbot_ros.cli import installation
from ballbot_ros.cli.command import load_command
from ballbot_ros.cli.installation import CORE_MB, EXTRAS, Downloads, InstallationError, install
from ballbot_ros.errors import BallbotError

PIP = """\
Looking in indexes: https://index.example/simple
Collecting scipy>=1.11 (from ballbot_ros==0.1.0)
  Downloading scipy-1.17.1-cp311-cp311-manylinux_2_27_x86_64.whl.metadata (62 kB)
     ━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━━ 62.1/62.1 kB 123.5 MB/s eta 0:00:00
Downloading scipy-1.17.1-cp311-cp311-manylinux_2_27_x86_64.whl (35.1 MB)
Using cached rosbags-0.11.9-py3-none-any.whl (151 kB)
  Preparing metadata (pyproject.toml): started
Installing collected packages: rosbags, numpy, scipy
"""
PIP_SHOWS = [
    'scipy-1.17.1, 35 of about 124 MB',
    'rosbags-0.11.9, 35 of about 124 MB',
    'installing 3 packages',
]
UV = """\
Resolved 110 packages in 2.39s
   Building ballbot-ros @ file:///project
Downloading scipy (33.7MiB)
Downloading pillow (900.0KiB)
 Downloaded scipy
Installed 110 packages in 200ms
"""
UV_SHOWS = ['scipy, 35 of about 124 MB', 'pillow, 36 of about 124 MB']


def closure(requirements, known=frozenset()):
    """Return the distributions that requirements bring, by name."""
    found, waiting = {}, [Requirement(each) for each in requirements]
    seen = set()
    while waiting:
        wanted = waiting.pop()
        for extra in wanted.extras or {''}:
            name = re.sub('[-_.]+', '-', wanted.name.lower())
            if (name, extra) in seen or name in known:
                continue
            seen.add((name, extra))
            try:
                found[name] = importlib.metadata.distribution(wanted.name)
            except importlib.metadata.PackageNotFoundError:
                pytest.skip(f'{wanted.name} is not installed')
            for text in found[name].requires or []:
                each = Requirement(text)
                if not each.marker or each.marker.evaluate({'extra': extra}):
                    waiting.append(each)
    return found


def size_mb(distributions):
    files = {Path(each.locate()) for one in distributions.values() for each in one.files or []}
    # Without byte code, which some installers write and others do not.
    sizes = (each.stat().st_size for each in files if each.suffix != '.pyc' and each.exists())
    return sum(sizes) / 1e6


@pytest.mark.parametrize('extra', EXTRAS)
def test_the_sizes_are_about_those_on_the_disk(extra):
    core = closure(['ballbot_ros[ros]'])
    assert size_mb(core) == pytest.approx(CORE_MB, rel=0.25)
    more = closure([f'ballbot_ros[{extra}]'], core.keys() - {'ballbot-ros'})
    more.pop('ballbot-ros')
    assert size_mb(more) == pytest.approx(EXTRAS[extra].size_mb, rel=0.25, abs=2.0)


@pytest.mark.parametrize(('output', 'shown'), [(PIP, PIP_SHOWS), (UV, UV_SHOWS)])
def test_what_an_installer_does_is_understood(output, shown):
    downloads = Downloads(400.0)
    texts = [downloads.take(line) for line in output.splitlines()]
    assert [text for text in texts if text] == shown


def test_the_requirements_of_an_extra_are_those_of_the_metadata(monkeypatch):
    declared = ['numpy>=1', 'numba>=0.5; extra == "study"', "no-such[x]>=2 ; extra == 'study'"]
    monkeypatch.setattr(importlib.metadata, 'requires', lambda name: declared)
    assert installation.requirements('study') == ['numba>=0.5', 'no-such[x]>=2']
    assert 'no-such[x]>=2' in installation.missing('study')
    assert installation.missing('mpc') == []


@pytest.fixture
def installers(tmp_path, monkeypatch):
    """Return a function that puts an installer, a shell script, in place of uv or pip."""
    monkeypatch.setenv('PATH', f'{tmp_path}:{os.environ["PATH"]}')
    monkeypatch.setattr(sys, 'executable', str(tmp_path / 'python'))

    def put(name, script):
        (tmp_path / name).write_text(f'#!/bin/sh\necho {name} "$@" >>{tmp_path}/calls\n{script}\n')
        (tmp_path / name).chmod(0o755)
        return tmp_path / 'calls'

    return put


def test_uv_is_used_where_it_is_and_pip_where_uv_fails(installers, tmp_path):
    calls = installers('uv', 'exit 1')
    installers('python', 'echo Downloading x-1-py3-none-any.whl \\(3 MB\\)')
    install(['x>=1'], 10.0, tmp_path / 'log')
    uv, pip = calls.read_text().splitlines()
    assert uv == f'uv pip install --python {tmp_path}/python x>=1'
    assert pip == 'python -m pip install --no-input --no-compile x>=1'
    assert 'Downloading x-1' in (tmp_path / 'log').read_text()


def test_the_reason_of_a_failure_is_on_one_line(installers, tmp_path):
    installers('uv', 'exit 1')
    installers('python', 'echo noise; echo ERROR: no x >&2; echo more; exit 1')
    with pytest.raises(InstallationError) as told:
        install(['x'], 1.0, tmp_path / 'log')
    assert str(told.value) == (
        f'cannot install the packages (no network?): ERROR: no x (details in {tmp_path}/log)'
    )


class RestartedError(Exception):
    pass


@pytest.fixture
def lacking(monkeypatch):
    """Let plotly be missing, and record what is installed."""
    installed = []
    monkeypatch.delenv('CI', raising=False)
    monkeypatch.setattr(command, 'missing', lambda name: ['plotly>=5'] * (name == 'report'))
    monkeypatch.setattr(command, 'install', lambda *words: installed.append(words))

    def restart(program, words):
        raise RestartedError(program, words)

    monkeypatch.setattr(os, 'execv', restart)
    return installed


def test_with_the_users_word_a_command_installs_and_starts_again(lacking, monkeypatch):
    monkeypatch.setattr(sys, 'orig_argv', ['python', 'bin/ballbot', 'report', 'x.mcap', '--yes'])
    for words in (['--yes', 'report', __file__], ['report', __file__, '--yes']):
        with pytest.raises(RestartedError) as told:
            call(*words)
        assert told.value.args == (
            sys.executable,
            [sys.executable, 'bin/ballbot', 'report', 'x.mcap', '--yes'],
        )
    assert [packages for packages, *_ in lacking] == [['plotly>=5']] * 2
    monkeypatch.setenv('CI', 'true')
    with pytest.raises(RestartedError):
        call('report', __file__)


def test_without_a_terminal_nothing_is_installed_unasked(lacking):
    done = call('report', __file__)
    assert done.returncode == 2
    assert 'plotly' not in done.stderr
    assert lacking == []


def test_a_command_can_be_called_without_its_group(lacking):
    with pytest.raises(BallbotError, match=r'not a recording|MCAP'):
        load_command('report').main([__file__], standalone_mode=False)
    assert lacking == []


def test_a_command_names_the_package_that_it_lacks(lacking, monkeypatch):
    monkeypatch.setitem(sys.modules, 'viser', None)
    done = call('view', __file__)
    assert done.returncode == 2
    assert done.stderr.startswith('error: package not found (')
    assert done.stderr.endswith(
        'install it with `pip install "ballbot_ros[viewer]"`; --yes does so\n'
    )


def test_all_is_every_extra_for_users():
    needed = {name for name in EXTRAS if name not in ('all', 'cluster')}
    everything = set(installation.requirements('all'))
    assert everything == {each for name in needed for each in installation.requirements(name)}


def test_the_command_lists_and_installs_extras(monkeypatch):
    installed = []
    monkeypatch.setattr(command, 'missing', lambda name: ['x>=1'] if name == 'film' else [])
    monkeypatch.setattr(command, 'install', lambda *words: installed.append(words))
    listing = call('install').stdout
    assert re.search(r'^film +345 MB  ', listing, re.MULTILINE)
    assert re.search(r'^report +installed  ', listing, re.MULTILINE)
    assert call('install', 'film', 'report').stdout == 'installed  film, report\n'
    assert [packages for packages, *_ in installed] == [['x>=1']]
    assert call('install', 'nonsense').returncode == 2


def test_the_installer_needs_only_the_standard_library():
    code = 'import sys; sys.path.insert(0, sys.argv[1]); import ballbot_ros.cli.installation'
    root = Path(installation.__file__).parents[2]
    subprocess.run([sys.executable, '-S', '-I', '-c', code, root], check=True)
