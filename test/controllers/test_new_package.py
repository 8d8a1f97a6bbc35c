"""The package that `ballbot new controller` writes, as files."""

import ast
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from ballbot_ros.controllers import new_package
from ballbot_ros.controllers.new_package import (
    MAX_NAME,
    TEMPLATES,
    class_name,
    package_files,
    write_package,
)
from ballbot_ros.errors import ControllerError

PROJECT = Path(__file__).parents[2]
SHORT, LONG = 'pd', 'long_' + 'x' * (MAX_NAME - len('long_'))


def test_class_is_named_after_the_package():
    for name, expected in {
        'my_pid': 'MyPid',
        'pid2': 'Pid2',
        'two_2_one': 'Two2One',
        # These would hide a name that the module uses, or are no names in Python.
        'controller': 'MyController',
        'gains': 'MyGains',
        'exception': 'MyException',
        'none': 'MyNone',
    }.items():
        assert class_name(name) == expected


def test_no_class_hides_a_name_of_its_module():
    names = {
        node.name
        for path, text in package_files('my_pid').items()
        if path.endswith('.py')
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.ClassDef | ast.alias) and node.name[0].isupper()
    }
    assert names - {'MyPid'} == new_package._NAMES_IN_TEMPLATES


def test_every_template_is_used():
    folder = Path(new_package.__file__).parent / 'templates'
    assert {path.name for path in folder.iterdir()} == {*TEMPLATES.values()} - {''}


@pytest.mark.parametrize('name', [SHORT, LONG])
def test_files_are_clean_by_the_rules_of_this_project(tmp_path, name):
    write_package(tmp_path, name)
    # In a package of its own, ballbot_ros is a third party.
    options = ['--config', PROJECT / 'pyproject.toml']
    options += ['--config', f'lint.isort.known-first-party = ["{name}"]']
    options += ['--config', 'lint.per-file-ignores = {"test/**" = ["D"]}', '--no-cache']
    for action in (['check', *options], ['format', '--check', *options], ['check', '--no-cache']):
        done = subprocess.run(
            [sys.executable, '-m', 'ruff', *action, '.'],
            cwd=tmp_path / name, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr


def test_metadata_agree():
    files = package_files('my_pid')
    manifest = ElementTree.fromstring(files['package.xml'])
    assert manifest.get('format') == '3'
    assert manifest.findtext('name') == 'my_pid'
    assert manifest.findtext('export/build_type') == 'ament_python'
    for tag in ('version', 'description', 'license', 'maintainer'):
        assert repr(manifest.findtext(tag)) in files['setup.py']
    assert manifest.find('maintainer').get('email') in files['setup.py']
    assert [each.text for each in manifest.iter('exec_depend')] == ['ballbot_ros']
    assert files['resource/my_pid'] == ''
    scenario = yaml.safe_load(files['scenarios/my_pid.yaml'])
    assert scenario['parameters']['controller']['implementation'] == (
        '../my_pid/controller.py:MyPid'
    )


def test_nothing_remains_of_a_package_that_could_not_be_written(tmp_path, monkeypatch):
    def refuse(path, *arguments, **options):
        raise OSError(28, 'No space left on device', str(path))

    monkeypatch.setattr(Path, 'write_text', refuse)
    with pytest.raises(ControllerError, match=r'my_pid/README\.md: No space left on device'):
        write_package(tmp_path, 'my_pid')
    assert list(tmp_path.iterdir()) == []
