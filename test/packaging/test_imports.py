"""Imports go one way, and only some packages import ROS."""

import ast
from pathlib import Path

import ballbot_ros

ROOT = Path(ballbot_ros.__file__).parent

FLOORS = (
    ('parameters', 'numerics'),
    ('brick',),
    ('plant',),
    ('world', 'controllers', 'recording'),
    ('design',),
    ('codegen', 'scenario', 'teleop'),
    ('engine',),
    ('simulation',),
    ('messages',),
    ('analysis', 'conformance'),
    ('identification',),
    ('viewer',),
    ('nodes', 'environments'),
    ('run',),
    ('studies',),
    ('cli',),
)
"""From the bottom up: a package imports only packages below it."""

FLOOR = {package: number for number, floor in enumerate(FLOORS) for package in floor}
WITH_ROS = {'nodes', 'run', 'cli'}
ROS = {'rclpy', 'rosgraph_msgs', 'std_srvs', 'rcl_interfaces', 'diagnostic_msgs', 'tf2_msgs'}
MODULES = sorted(path for path in ROOT.rglob('*.py') if path.parent != ROOT)


def imports(path):
    """Return the names of the modules that a file imports, anywhere in it."""
    names = []
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            names += [each.name for each in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{path}: a relative import'
            names.append(node.module)
    return names


def package_of(path):
    return path.relative_to(ROOT).parts[0]


def test_every_package_has_a_layer():
    assert {package_of(path) for path in MODULES} == FLOOR.keys()


def test_imports_go_down():
    upward = []
    for path in MODULES:
        package = package_of(path)
        for name in imports(path):
            top, _, rest = name.partition('.')
            other = rest.partition('.')[0] if top == 'ballbot_ros' else ''
            if other not in ('', package) and FLOOR.get(other, -1) >= FLOOR[package]:
                upward.append(f'{path.relative_to(ROOT)}: {name}')
    assert upward == []


def test_only_nodes_and_the_code_that_runs_them_import_ros():
    found = {
        path.relative_to(ROOT)
        for path in MODULES
        for name in imports(path)
        if name.partition('.')[0] in ROS and package_of(path) not in WITH_ROS
    }
    assert found == set()
