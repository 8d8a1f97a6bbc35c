"""A wheel in an environment of its own has everything: commands, library, data files."""

import json
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest
from graph import LAST_RESORT_S, environment

from ballbot_ros.engine.golden import load_golden

pytest.importorskip('rclpy')
pytestmark = [pytest.mark.slow, pytest.mark.graph]

ROOT = Path(__file__).resolve().parents[2]
SOURCES = (
    'ballbot_ros', 'config', 'launch', 'resource', 'setup.py', 'setup.cfg', 'pyproject.toml',
    'package.xml', 'README.md', 'LICENSE',
)  # fmt: skip


def call(*command, domain=0, **options):
    # Python must not find our source tree.
    variables = {name: each for name, each in environment(domain).items() if name != 'PYTHONPATH'}
    done = subprocess.run(
        [*map(str, command)],
        env=variables,
        check=False,
        capture_output=True,
        text=True,
        timeout=LAST_RESORT_S,
        **options,
    )
    assert done.returncode == 0, done.stderr or done.stdout
    return done.stdout


@pytest.fixture(scope='module')
def wheel(tmp_path_factory):
    """Build the wheel from a copy, since that leaves files; skip without the network."""
    folder = tmp_path_factory.mktemp('wheel')
    for name in SOURCES:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, folder / name)
    command = [sys.executable, '-m', 'build', '--outdir', 'dist', '.']
    done = subprocess.run(command, cwd=folder, check=False, capture_output=True, text=True)
    if 'No matching distribution found for setuptools' in done.stdout + done.stderr:
        pytest.skip('pip does not reach its index')
    assert done.returncode == 0, done.stdout
    return next((folder / 'dist').glob('*.whl'))


@pytest.fixture(scope='module')
def programs(wheel, tmp_path_factory):
    """Install the wheel in an empty environment that borrows the packages it depends on."""
    venv = tmp_path_factory.mktemp('installed') / 'venv'
    call(sys.executable, '-m', 'venv', '--without-pip', venv)
    call(sys.executable, '-m', 'pip', '--python', venv, 'install', '--no-deps', '--no-index', wheel)
    (packages,) = venv.glob('lib/python*/site-packages')
    # A path in such a file is searched, but its own files of this kind, with our source tree, are
    # not read.
    (packages / 'borrowed.pth').write_text(sysconfig.get_path('purelib'))
    return venv / 'bin'


def test_the_command_runs_the_node_graph(programs, tmp_path, domain):
    said = call(
        programs / 'ballbot', 'run', 'stationary', '--json', '--output', 'run',
        cwd=tmp_path, domain=domain,
    )  # fmt: skip
    assert json.loads(said)['duty_sha256'] == load_golden().scenarios['stationary']


def test_the_command_runs_a_study_and_the_library_a_run(programs, tmp_path, domain):
    words = 'study', 'basin', '--runs', '100', '--json'
    said = call(programs / 'ballbot', *words, cwd=tmp_path, domain=domain)
    assert json.loads(said)['runs'] == 100
    code = (
        'import ballbot_ros as bb; run = bb.simulate("push"); print(bb.__file__, run.duty_sha256)'
    )
    place, sha256 = call(programs / 'python', '-c', code, cwd=tmp_path, domain=domain).split()
    assert Path(place).is_relative_to(programs.parent)
    assert sha256 == load_golden().scenarios['push']
