"""A real colcon build of this tree, and the installed files."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from ballbot_ros.parameters import EXECUTABLES

ROOT = Path(__file__).resolve().parents[2]
LOAD_ENTRY_POINTS = """
from importlib.metadata import distribution
import ballbot_ros
print(ballbot_ros.__file__)
for entry_point in distribution('ballbot_ros').entry_points:
    assert callable(entry_point.load()), entry_point
"""


def copy_tree(target):
    listing = subprocess.run(
        ['git', 'ls-files', '-coz', '--exclude-standard'],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    )
    for name in filter(None, listing.stdout.split('\0')):
        if (ROOT / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, target / name)


def build(workspace, *options):
    copy_tree(workspace / 'src/ballbot_ros')
    tools = os.pathsep.join([str(Path(sys.executable).parent), os.environ['PATH']])
    result = subprocess.run(
        [shutil.which('colcon', path=tools), 'build', *options],
        cwd=workspace,
        check=False,
        capture_output=True,
        text=True,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return workspace / 'install/ballbot_ros'


@pytest.fixture(scope='module')
def prefix(tmp_path_factory):
    workspace = tmp_path_factory.mktemp('workspace')
    prefix = build(workspace)
    # Remove the sources, on which the installation must not depend.
    shutil.rmtree(workspace / 'src')
    return prefix


def run_sourced(prefix, *command):
    """Run a command as after `source install/local_setup.bash`."""
    return subprocess.run(
        ['bash', '-c', 'source ../local_setup.bash && exec "$@"', 'bash', *command],
        cwd=prefix,
        check=False,
        capture_output=True,
        text=True,
    )


def test_executables_are_where_ros2_run_looks(prefix):
    folder = prefix / 'lib/ballbot_ros'
    assert {file.name for file in folder.iterdir() if os.access(file, os.X_OK)} == {
        'ballbot',
        *EXECUTABLES,
    }


def test_package_is_in_the_ament_index(prefix):
    assert (prefix / 'share/ament_index/resource_index/packages/ballbot_ros').is_file()
    assert (prefix / 'share/ballbot_ros/package.xml').is_file()


@pytest.mark.parametrize(('folder', 'pattern'), [('config', '*'), ('launch', '*.launch.py')])
def test_share_has_every_file(prefix, folder, pattern):
    def files(base):
        return {
            file.relative_to(base): file.read_bytes()
            for file in (base / folder).rglob(pattern)
            if file.is_file()
        }

    installed = files(prefix / 'share/ballbot_ros')
    assert installed
    assert installed == files(ROOT)


def test_installed_entry_points_are_importable(prefix):
    result = run_sourced(prefix, sys.executable, '-c', LOAD_ENTRY_POINTS)
    assert result.returncode == 0, result.stderr
    assert Path(result.stdout.strip()).is_relative_to(prefix)


def test_installed_command_finds_its_scenarios(prefix):
    result = run_sourced(prefix, 'lib/ballbot_ros/ballbot', 'scenarios')
    assert result.returncode == 0, result.stderr
    assert 'stationary' in result.stdout


def test_symlinked_installation_runs(tmp_path):
    prefix = build(tmp_path, '--symlink-install')
    result = run_sourced(prefix, 'lib/ballbot_ros/ballbot', 'scenarios')
    assert result.returncode == 0, result.stderr
    assert 'stationary' in result.stdout
