"""The URDF document, as another reader understands it."""

import io
import math
from dataclasses import fields, replace
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from parts import DIMENSIONS

yourdfpy = pytest.importorskip('yourdfpy')

from trimesh import transformations  # noqa: E402

from ballbot_ros.files import share_directory  # noqa: E402
from ballbot_ros.parameters import VISUALIZER, Dimensions, VisualizerParameters, parameters_of  # noqa: E402
from ballbot_ros.recording.messages.conversions import MOTOR_NAMES  # noqa: E402
from ballbot_ros.recording.messages.tool_messages import FOOTPRINT  # noqa: E402
from ballbot_ros.robot.plant.model import Bodies  # noqa: E402
from ballbot_ros.viewer.derived_messages import robot_description  # noqa: E402
from ballbot_ros.viewer.robot import (  # noqa: E402
    BALL,
    BODY,
    LINKS,
    NAMES,
    WHEEL_X,
    WHEEL_Y,
    parts,
    sonar_position,
    wheel_centres,
)
from ballbot_ros.viewer.views import RollingOrientation  # noqa: E402

BODIES = Bodies.from_parameters(VisualizerParameters())
lengths = st.floats(1e-3, 1.0)


def load(dimensions=DIMENSIONS, bodies=BODIES):
    robot = yourdfpy.URDF.load(io.StringIO(robot_description(dimensions, bodies)))
    assert robot.validate(), robot.errors
    return robot


def shape_of(geometry):
    if geometry.box is not None:
        return 'box', tuple(geometry.box.size)
    if geometry.cylinder is not None:
        return 'cylinder', (geometry.cylinder.radius, geometry.cylinder.length)
    return 'sphere', (geometry.sphere.radius,)


def pose(part):
    matrix = transformations.euler_matrix(*part.rpy)
    matrix[:3, 3] = part.position
    return matrix


def test_every_part_is_where_the_table_has_it():
    robot = load()
    for link in LINKS:
        visuals = robot.link_map[link].visuals
        expected = [part for part in parts(DIMENSIONS) if part.link == link]
        assert len(visuals) == len(expected) > 0
        for visual, part in zip(visuals, expected, strict=True):
            shape, size = shape_of(visual.geometry)
            assert shape == part.shape
            assert size == pytest.approx(part.size)
            assert visual.origin == pytest.approx(pose(part), abs=1e-8)
            colour = robot._material_map[visual.material.name].color.rgba
            assert visual.material.name == NAMES[part.colour]
            assert colour == pytest.approx([*(each / 255 for each in part.colour), 1.0])


def test_joints_are_those_of_the_messages():
    robot = load()
    assert robot.base_link == FOOTPRINT
    assert {name: joint.type for name, joint in robot.joint_map.items()} == {
        'base_joint': 'floating',
        'ball_joint': 'floating',
        'sonar_joint': 'fixed',
        **dict.fromkeys(MOTOR_NAMES, 'continuous'),
    }
    origins = {joint.child: joint.origin[:3, 3] for joint in robot.joint_map.values()}
    assert origins[WHEEL_X] == pytest.approx(wheel_centres(DIMENSIONS)[0])
    assert origins[WHEEL_Y] == pytest.approx(wheel_centres(DIMENSIONS)[1])
    assert origins['sonar'] == pytest.approx(sonar_position(DIMENSIONS))
    assert origins[BODY] == pytest.approx((0.0, 0.0, DIMENSIONS.ball_radius))
    assert origins[BALL] == pytest.approx((0.0, 0.0, 0.0))


ROBOT = load()
pairs = st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))


@given(pairs, pairs)
def test_motor_angles_turn_the_wheels_as_the_motion_does(position, psi):
    """The motor angles are those of ``plant/joint_states``: θm = k (θ − ψ)."""
    ratio = DIMENSIONS.ball_radius / DIMENSIONS.wheel_radius
    angles = [
        ratio * (coordinate / DIMENSIONS.ball_radius - pitch)
        for coordinate, pitch in zip(position, psi, strict=True)
    ]
    ROBOT.update_cfg(dict(zip(MOTOR_NAMES, angles, strict=True)))
    rotations = RollingOrientation(DIMENSIONS).wheels(position, psi)
    for link, rotation in zip((WHEEL_X, WHEEL_Y), rotations, strict=True):
        found = ROBOT.get_transform(link, BODY)[:3, :3]
        assert found == pytest.approx(rotation.as_matrix(), abs=1e-6)


def test_masses_and_inertias_are_those_of_the_model():
    links = load().link_map
    assert [links[link].inertial.mass for link in LINKS] == pytest.approx(
        [BODIES.ball_mass, BODIES.body_mass, BODIES.wheel_mass, BODIES.wheel_mass]
    )
    body = links[BODY].inertial
    assert body.origin[:3, 3] == pytest.approx((0.0, 0.0, BODIES.body_height))
    assert np.diag(body.inertia)[:2] == pytest.approx(BODIES.body_inertia)
    assert np.diag(links[BALL].inertial.inertia) == pytest.approx(BODIES.ball_inertia)
    axles = links[WHEEL_X].inertial.inertia[1, 1], links[WHEEL_Y].inertial.inertia[0, 0]
    assert axles == pytest.approx((BODIES.wheel_inertia,) * 2)
    for link in LINKS:
        moments = np.diag(links[link].inertial.inertia)
        assert max(moments) < sum(moments) / 2 * (1 + 1e-9), 'no body has such moments'


def test_the_two_planes_are_alike():
    """Exchanging x and y exchanges the wheels, which also reverses the sense of rotation."""
    robot = load()
    swap = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    x, y = (robot.joint_map[name] for name in MOTOR_NAMES)
    assert swap @ x.origin[:3, 3] == pytest.approx(y.origin[:3, 3])
    assert swap @ x.axis == pytest.approx(y.axis)
    wheel_x, wheel_y = robot.link_map[WHEEL_X], robot.link_map[WHEEL_Y]
    assert swap @ wheel_x.inertial.inertia @ swap == pytest.approx(wheel_y.inertial.inertia)
    for a, b in zip(wheel_x.visuals, wheel_y.visuals, strict=True):
        assert swap @ a.origin[:3, 3] == pytest.approx(b.origin[:3, 3])
        assert abs(swap @ a.origin[:3, 2]) == pytest.approx(abs(b.origin[:3, 2]))


def test_collision_shapes_enclose_the_visible_ball_and_tires():
    links = load().link_map
    for link in (BALL, WHEEL_X, WHEEL_Y):
        (collision,), first = links[link].collisions, links[link].visuals[0]
        assert shape_of(collision.geometry) == shape_of(first.geometry)
        assert collision.origin == pytest.approx(first.origin)
    (body,) = links[BODY].collisions
    depth, width, height = shape_of(body.geometry)[1]
    assert (depth, width) == (DIMENSIONS.body_depth, DIMENSIONS.body_width)
    assert body.origin[2, 3] + height / 2 == pytest.approx(2 * DIMENSIONS.body_height)


def test_the_document_follows_from_the_parameters_alone():
    text = robot_description(DIMENSIONS, BODIES)
    assert text == robot_description(DIMENSIONS, BODIES)
    for field in fields(DIMENSIONS):
        longer = replace(DIMENSIONS, **{field.name: 1.1 * getattr(DIMENSIONS, field.name)})
        assert robot_description(longer, BODIES) != text, field.name
    for field in fields(BODIES):
        if field.name != 'wheel_radius' and field.name.endswith(('mass', 'radius')):
            more = replace(BODIES, **{field.name: 1.1 * getattr(BODIES, field.name)})
            assert robot_description(DIMENSIONS, more) != text, field.name


@given(st.tuples(*[lengths] * len(fields(Dimensions))), st.sampled_from([0.0, 1.0]))
def test_any_dimensions_give_shapes_with_an_extent(sizes, scale):
    names = [field.name for field in fields(Dimensions)]
    bounds = parameters_of(VISUALIZER)
    sizes = [
        max(size * (scale if bounds[name].bounds[0] == 0.0 else 1.0), bounds[name].bounds[0])
        for name, size in zip(names, sizes, strict=True)
    ]
    dimensions = Dimensions(**dict(zip(names, sizes, strict=True)))
    document = ElementTree.fromstring(robot_description(dimensions, BODIES))
    extents = [
        float(number)
        for kind in ('box', 'cylinder', 'sphere')
        for shape in document.iter(kind)
        for text in shape.attrib.values()
        for number in text.split()
    ]
    assert all(0.0 < extent < math.inf for extent in extents)
    assert len(extents) > 30


def test_the_shipped_file_is_that_of_the_default_parameters():
    """``scripts/generate`` writes it."""
    shipped = (share_directory() / 'config/urdf/ballbot.urdf').read_text(encoding='utf-8')
    assert shipped == robot_description(DIMENSIONS, BODIES)
