"""A package with a controller to start from."""

from __future__ import annotations

import builtins
import keyword
import os
import re
import shutil
import sys
from importlib.util import find_spec
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from ballbot_ros.controllers.loading import GROUP, installed_controllers
from ballbot_ros.errors import ControllerError
from ballbot_ros.files import program
from ballbot_ros.parameters import DOCUMENTS_PROGRAM

MAX_NAME = 30
"""Longest name, so that the generated lines keep to 100 columns."""

SCENARIO = 'scenarios/{name}.yaml'
"""The scenario, in the folder of a package."""

TEMPLATES = {
    'README.md': 'README.md.jinja',
    'package.xml': 'package.xml.jinja',
    'setup.py': 'setup.py.jinja',
    'pyproject.toml': 'pyproject.toml.jinja',
    'resource/{name}': '',
    '{name}/__init__.py': '__init__.py.jinja',
    '{name}/controller.py': 'controller.py.jinja',
    SCENARIO: 'scenario.yaml.jinja',
    'test/test_controller.py': 'test_controller.py.jinja',
}
"""Template of each file; '' for the marker of the ament index, which is empty."""

_NAME = re.compile(r'[a-z][a-z0-9]*(_[a-z0-9]+)*')
_FOLDERS = ('build', 'dist', 'install', 'log', 'resource', 'scenarios', 'setup', 'test')
"""Names of files and folders next to the folder of the modules."""

_NAMES_IN_TEMPLATES = {
    'Constants', 'Controller', 'ControllerParameters', 'Duty', 'Estimates', 'Gains',
    'LawController', 'NamedTuple', 'OperatingState', 'Path', 'PhysicalParameters', 'Plane',
    'Readings', 'State', 'TICK_S', 'TakesEffect',
}  # fmt: skip


def class_name(name: str) -> str:
    """Return the name of the controller's class: ``MyPid`` for the package ``my_pid``."""
    camel_case = ''.join(map(str.capitalize, name.split('_')))
    is_taken = camel_case in _NAMES_IN_TEMPLATES or hasattr(builtins, camel_case)
    return f'My{camel_case}' if is_taken else camel_case


def package_files(name: str, folder: Path | None = None) -> dict[str, str]:
    """Return the text of every file of a package, by its path in the package's folder."""
    environment = Environment(
        loader=PackageLoader('ballbot_ros.controllers'),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )
    programs = {'ballbot': program(folder=folder), 'python': program('python', folder)}
    values = {'name': name, 'class_name': class_name(name), 'group': GROUP, **programs}
    return {
        path.format(name=name): environment.get_template(template).render(values)
        if template
        else ''
        for path, template in TEMPLATES.items()
    }


def write_package(output: Path, name: str) -> list[Path]:
    """Write a package into the new folder `output`/`name`; return its files.

    It raises ControllerError if the name is not valid or already taken, or the folder exists or
    can't be written.
    """
    _check_spelling(name)
    folder = output / name
    # First: an installed package of this name is usually the one in this folder.
    if os.path.lexists(folder):
        raise ControllerError(f'{folder}: already exists; choose another name or --output')
    _check_free(name)
    files = {folder / path: text for path, text in package_files(name, folder).items()}
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise ControllerError(f'{error.filename or folder}: {error.strerror}') from None
    try:
        for path, text in files.items():
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding='utf-8')
    except OSError as error:
        shutil.rmtree(folder, ignore_errors=True)
        raise ControllerError(f'{error.filename or folder}: {error.strerror}') from None
    return list(files)


def _check_spelling(name: str) -> None:
    if not _NAME.fullmatch(name):
        raise ControllerError(
            f'{name!r} is not the name of a package: use lower case letters, digits and single '
            'underscores, and begin with a letter, such as my_pid'
        )
    if len(name) > MAX_NAME:
        raise ControllerError(f'{name!r} has more than {MAX_NAME} characters')
    if keyword.iskeyword(name):
        raise ControllerError(f'{name!r} is a keyword of Python; choose another name')
    if name in _FOLDERS:
        raise ControllerError(
            f'{name!r} is the name of another file or folder of the package; choose another name'
        )


def _check_free(name: str) -> None:
    if name in DOCUMENTS_PROGRAM or name in installed_controllers():
        raise ControllerError(f'there is already a controller {name!r}; choose another name')
    spec = find_spec(name)
    # A folder in the current one also has a specification, but no origin.
    if name in sys.stdlib_module_names or (spec and spec.origin):
        raise ControllerError(f'there is already a Python module {name!r}; choose another name')
    if len(name) == 1:
        raise ControllerError(f'{name!r}: the name of a ROS package has at least two characters')
