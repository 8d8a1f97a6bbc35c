"""Imports go one way, and only some packages import ROS."""

import ast
from pathlib import Path

import ballbot_ros

ROOT = Path(ballbot_ros.__file__).parent

ROOMS = {
    'parameters': (),
    'robot': ('', 'brick', 'plant', 'world'),
    'controllers': ('', 'design', 'codegen'),
    'engine': ('scenario', ''),
    'lockstep': (),
    'recording': ('', 'messages'),
    'analysis': ('', 'identification'),
    'viewer': (),
    'nodes': ('teleop', 'transports', '', 'conformance'),
    'run': (),
    'lab': ('environments', 'studies', 'search'),
    'cli': (),
}
"""From the bottom up: a room imports only rooms below it. Within a room, the same holds for its
packages, of which '' are the modules beside them."""

BESIDE = {'__init__', 'environments', 'errors', 'files', 'process'}
"""The modules beside the rooms, which serve all of them, or stand for one."""

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


def floor_of(module):
    """Return room and package of a module as numbers, from the bottom up; None if it has none."""
    room, *rest = module.split('.')[1:] or ['']
    if room not in ROOMS:
        return None
    packages = ROOMS[room]
    own = rest[0] if rest and rest[0] in packages else ''
    return [*ROOMS].index(room), packages.index(own) if own in packages else 0


def test_every_package_has_a_place():
    rooms = {path.name for path in ROOT.iterdir() if (path / '__init__.py').exists()}
    assert rooms == ROOMS.keys()
    assert {path.stem for path in ROOT.glob('*.py')} == BESIDE


def test_imports_go_down():
    upward = []
    for path in MODULES:
        floor = floor_of('.'.join(path.relative_to(ROOT.parent).with_suffix('').parts))
        for name in imports(path):
            other = floor_of(name) if name.partition('.')[0] == 'ballbot_ros' else None
            if other is not None and other > floor:
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
