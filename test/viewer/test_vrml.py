"""The file with map, robot and viewpoints, read by a small strict grammar of VRML 2.0."""

import math
import re
from itertools import takewhile

import numpy as np
import pytest
from parts import DIMENSIONS
from scipy.spatial.transform import Rotation

from ballbot_ros.robot.world.floor_map import load_map, map_names, write_files
from ballbot_ros.viewer.markers import Area
from ballbot_ros.viewer.robot import PARENTS, parts
from ballbot_ros.viewer.snapshot import Snapshot
from ballbot_ros.viewer.views import CHASER_1, CHASER_2, ROBOT, TOP, VISTA, camera
from ballbot_ros.viewer.vrml import robot_nodes

NODE, NODES, TEXT, FLAG = 'a node', 'nodes', 'a text', 'TRUE or FALSE'
NODE_FIELDS = {
    'Appearance': {'material': NODE},
    'Background': {'skyColor': 3},
    'Box': {'size': 3},
    'Color': {'color': math.inf},
    'Cylinder': {'radius': 1, 'height': 1},
    'DirectionalLight': {'direction': 3, 'intensity': 1},
    'ElevationGrid': {
        'xDimension': 1, 'zDimension': 1, 'xSpacing': 1, 'zSpacing': 1, 'solid': FLAG,
        'height': math.inf, 'colorPerVertex': FLAG, 'color': NODE,
    },
    'Material': {'diffuseColor': 3},
    'NavigationInfo': {'headlight': FLAG},
    'Shape': {'geometry': NODE, 'appearance': NODE},
    'Sphere': {'radius': 1},
    'Transform': {'translation': 3, 'rotation': 4, 'children': NODES},
    'Viewpoint': {'description': TEXT, 'position': 3, 'orientation': 4, 'fieldOfView': 1},
}  # fmt: skip
"""The fields of each node that the file has, with how many numbers."""

NUMBER = re.compile(r'[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?')
# Map positions and directions in VRML: x forward, y up, z rightward.
TO_VRML = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
VIEWS = {
    'Top View': TOP,
    'Vista View': VISTA,
    'Chaser View 1': CHASER_1,
    'Chaser View 2': CHASER_2,
    'Robot View': ROBOT,
}


class Reader:
    """Reads nodes as (type, name, fields); a node or field that VRML does not have is an error."""

    def __init__(self, text):
        header, _, rest = text.partition('\n')
        assert header == '#VRML V2.0 utf8'
        words = re.findall(r'"[^"]*"|[^\s,{}\[\]"]+|[{}\[\]]', re.sub('#[^\n]*', '', rest))
        self.words = words[::-1]
        self.nodes = []
        while self.words:
            self.nodes.append(self.node())

    def node(self):
        name = ''
        if self.words[-1] == 'DEF':
            self.words.pop()
            name = self.words.pop()
        kind = self.words.pop()
        allowed, fields = NODE_FIELDS[kind], {}
        self.expect('{')
        while self.words[-1] != '}':
            field = self.words.pop()
            assert field not in fields
            fields[field] = self.value(allowed[field])
        self.expect('}')
        return kind, name, fields

    def value(self, kind):
        if kind == NODE:
            return self.node()
        if kind == NODES:
            return self.list() if self.words[-1] == '[' else [self.node()]
        if kind == TEXT:
            text = self.words.pop()
            assert text[0] == text[-1] == '"'
            return text[1:-1]
        if kind == FLAG:
            return {'TRUE': True, 'FALSE': False}[self.words.pop()]
        if kind == math.inf:
            self.expect('[')
            numbers = list(takewhile(lambda word: word != ']', iter(self.words.pop, None)))
        else:
            numbers = [self.words.pop() for _ in range(kind)]
        assert all(map(NUMBER.fullmatch, numbers))
        return np.array(numbers, float)

    def list(self):
        self.expect('[')
        nodes = []
        while self.words[-1] != ']':
            nodes.append(self.node())
        self.expect(']')
        return nodes

    def expect(self, word):
        assert self.words.pop() == word


ORIGIN, UPRIGHT = np.zeros(3), Rotation.identity()


def placed(node, parent='', origin=ORIGIN, rotation=UPRIGHT):
    """Yield each node in Transforms, with the nearest named one, and its pose in the file."""
    kind, name, fields = node
    if kind != 'Transform':
        yield kind, fields, parent, origin, rotation
        return
    turn = fields.get('rotation', np.array([0.0, 0.0, 1.0, 0.0]))
    assert np.linalg.norm(turn[:3]) == pytest.approx(1.0, abs=1e-5)
    at = origin + rotation.apply(fields['translation'])
    turned = rotation * Rotation.from_rotvec(turn[:3] * turn[3])
    for child in fields['children']:
        yield from placed(child, name or parent, at, turned)


def written(floor_map, folder, dimensions=DIMENSIONS):
    path = folder / 'vr_nxt_ballbot.wrl'
    write_files(floor_map, wrl=path, nav2=None, nodes=robot_nodes(floor_map, dimensions))
    return path.read_text(encoding='utf-8')


@pytest.fixture(params=map_names())
def scene(request, tmp_path):
    """Return a shipped map, the nodes of its file, and those in Transforms with their poses."""
    floor_map = load_map(request.param)
    nodes = Reader(written(floor_map, tmp_path)).nodes
    return floor_map, nodes, [each for node in nodes for each in placed(node)]


def in_file(floor_map, position):
    """Return a position in ``map`` [m] in the file's axes; a vertex is the middle of its cell."""
    return TO_VRML @ position * 100.0 + (floor_map.columns / 2 - 0.5, 0, floor_map.rows / 2 - 0.5)


def test_the_five_viewpoints_are_the_cameras_at_the_start(scene):
    floor_map, _, nodes = scene
    start = Snapshot(0.0, (0.0, 0.0), (0.0, 0.0))
    seen = {}
    for kind, fields, parent, origin, rotation in nodes:
        if kind == 'Viewpoint':
            expected = camera(
                VIEWS[fields['description']], start, DIMENSIONS, Area.of(floor_map), 1.0
            )
            at = origin + rotation.apply(fields['position'])
            np.testing.assert_allclose(at, in_file(floor_map, expected.position), atol=1e-4)
            turn = fields['orientation']
            looks = rotation * Rotation.from_rotvec(turn[:3] * turn[3])
            ahead = np.subtract(expected.look_at, expected.position)
            ahead = TO_VRML @ ahead / np.linalg.norm(ahead)
            np.testing.assert_allclose(looks.apply((0, 0, -1)), ahead, atol=1e-5)
            # The horizon is level: the camera's right is horizontal.
            assert looks.apply((1, 0, 0))[1] == pytest.approx(0.0, abs=1e-5)
            assert looks.apply((0, 1, 0))[1] > 0.0
            assert fields['fieldOfView'] == pytest.approx(expected.fov, abs=1e-5)
            seen[fields['description']] = parent
    assert seen == {
        'Top View': 'map',
        'Vista View': 'map',
        'Chaser View 1': 'base_footprint',
        'Chaser View 2': 'base_footprint',
        'Robot View': 'sonar',
    }


def test_the_robot_has_the_parts_of_the_viewer_and_stands_on_the_floor(scene):
    floor_map, _, found = scene
    shapes = [each for each in found if each[0] == 'Shape'][1:]  # the first is the floor
    expected = [part for link in ('base_link', 'ball', 'wheel_x', 'wheel_y')
                for part in parts(DIMENSIONS) if part.link == link]  # fmt: skip
    reach = DIMENSIONS.ball_radius + DIMENSIONS.wheel_radius
    centre = {'wheel_x': (-reach, 0.0, 0.0), 'wheel_y': (0.0, -reach, 0.0)}
    for (_, fields, parent, origin, rotation), part in zip(shapes, expected, strict=True):
        assert parent == part.link
        link = np.add(centre.get(part.link, (0.0, 0.0, 0.0)), (0.0, 0.0, DIMENSIONS.ball_radius))
        np.testing.assert_allclose(
            origin, in_file(floor_map, np.add(part.position, link)), atol=1e-4
        )
        kind, _, geometry = fields['geometry']
        assert kind.lower() == part.shape
        # The axes of a box, and the axis of a cylinder, point the same way or the opposite one.
        turned = Rotation.from_euler('xyz', part.rpy).as_matrix()
        if kind == 'Box':
            sides = np.abs(rotation.as_matrix() * geometry['size'])
            np.testing.assert_allclose(
                sides.sum(axis=1), np.abs(TO_VRML @ turned * part.size).sum(axis=1) * 100, atol=1e-4
            )
        elif kind == 'Cylinder':
            axis = rotation.apply((0, 1, 0))
            assert abs(axis @ TO_VRML @ turned[:, 2]) == pytest.approx(1.0, abs=1e-5)
            size = [*geometry['radius'], *geometry['height']]
            np.testing.assert_allclose(size, np.multiply(part.size, 100.0), atol=1e-5)
        colour = fields['appearance'][2]['material'][2]['diffuseColor']
        np.testing.assert_allclose(colour * 255.0, part.colour, atol=1e-3)
    ball = next(each for each in shapes if each[1]['geometry'][0] == 'Sphere')
    assert ball[3][1] == ball[1]['geometry'][2]['radius']


def test_frames_are_named_and_nested_as_the_robots(scene):
    def named(node, parent):
        kind, name, fields = node
        if kind == 'Transform':
            if name:
                yield name, parent
            for child in fields['children']:
                yield from named(child, name or parent)

    _, nodes, _ = scene
    assert dict(each for node in nodes for each in named(node, '')) == {'map': '', **PARENTS}


def test_views_and_robot_move_with_the_robot(scene):
    """The sonar and its camera tilt with the body, the chasers do not."""
    _, nodes, before = scene
    move, tilt = np.array([30.0, 0.0, 40.0]), np.array([0.0, 0.0, -1.0, 0.1])

    def moved(node):
        kind, name, fields = node
        if kind == 'Transform':
            change = {'base_footprint': {'translation': move}, 'base_link': {'rotation': tilt}}
            children = [moved(child) for child in fields['children']]
            return kind, name, {**fields, **change.get(name, {}), 'children': children}
        return node

    after = [each for node in nodes for each in placed(moved(node))]
    for old, new in zip(before, after, strict=True):
        if old[0] == 'Viewpoint':
            at = [origin + turn.apply(old[1]['position']) for _, _, _, origin, turn in (old, new)]
            name = old[1]['description']
            if name == 'Robot View':
                assert (new[4].inv() * old[4]).magnitude() == pytest.approx(0.1)
            elif name.startswith('Chaser'):
                np.testing.assert_allclose(at[1] - at[0], move)
            else:
                np.testing.assert_array_equal(*at)


def test_the_floor_is_that_of_the_maps_own_file(scene, tmp_path):
    floor_map, _, _ = scene
    alone = tmp_path / 'track.wrl'
    write_files(floor_map, wrl=alone, nav2=None)
    text = alone.read_text(encoding='utf-8')
    assert (tmp_path / 'vr_nxt_ballbot.wrl').read_text(encoding='utf-8').startswith(text)
    assert [kind for kind, _, _ in Reader(text).nodes] == ['Shape']
