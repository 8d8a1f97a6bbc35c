"""Markers and transforms for other tools: the parts are where the viewer's scene has them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from parts import DIMENSIONS
from trimesh import transformations

from ballbot_ros.recording.messages.conversions import body_orientation
from ballbot_ros.recording.messages.raw import decoder
from ballbot_ros.recording.messages.tool_messages import (
    ADD,
    DELETE,
    DELETE_ALL,
    SHAPES,
    FramePose,
    TransformsLayout,
)
from ballbot_ros.recording.schemas import encoder, new_message
from ballbot_ros.robot.world.floor_map import FLOOR, WALL, FloorMap
from ballbot_ros.viewer import robot as colours
from ballbot_ros.viewer.markers import TRAIL_POINTS, RobotMarkers, walls
from ballbot_ros.viewer.robot import (
    BALL,
    BODY,
    LINKS,
    MAP,
    MOVING,
    PARENTS,
    SONAR,
    WHEEL_X,
    WHEEL_Y,
    Frames,
    parts,
    poses_in_map,
    sonar_position,
    wheel_centres,
    wxyz,
)
from ballbot_ros.viewer.snapshot import Snapshot
from ballbot_ros.viewer.views import RollingOrientation

FRAMES = Frames(DIMENSIONS)
ARRAY, TRANSFORMS = 'visualization_msgs/msg/MarkerArray', 'tf2_msgs/msg/TFMessage'

positions = st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
pitches = st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))


LAYOUT = TransformsLayout(PARENTS)


def new_marker():
    return new_message('visualization_msgs/msg/Marker')


def markers_at(markers, snapshot, *, whole=False):
    """Return the markers as received, by namespace and number."""
    markers.follow(snapshot)
    poses = poses_in_map(FRAMES.at(snapshot.position, snapshot.psi))
    message = new_message(ARRAY)
    message.markers = markers.at(snapshot, poses, whole=whole)
    sent = decoder(ARRAY)(encoder(ARRAY)(message)).markers
    found = {(marker.ns, marker.id): marker for marker in sent}
    assert len(found) == len(sent)
    return found


def matrix_of(point, quaternion):
    matrix = transformations.quaternion_matrix(
        (quaternion.w, quaternion.x, quaternion.y, quaternion.z)
    )
    matrix[:3, 3] = point.x, point.y, point.z
    return matrix


def placed(position, rotation=(1.0, 0.0, 0.0, 0.0)):
    matrix = transformations.quaternion_matrix(rotation)
    matrix[:3, 3] = position
    return matrix


def scene(position, psi):
    """Return the pose of each link in ``map``; the scene has the body's frames below the body."""
    centre = (position[0], -position[1], DIMENSIONS.ball_radius)
    body = placed(centre, body_orientation(psi))
    turned = map(wxyz, RollingOrientation(DIMENSIONS).wheels(position, psi))
    wheel_x, wheel_y = map(placed, wheel_centres(DIMENSIONS), turned)
    return {
        BALL: placed(centre),
        BODY: body,
        WHEEL_X: body @ wheel_x,
        WHEEL_Y: body @ wheel_y,
        SONAR: body @ placed(sonar_position(DIMENSIONS)),
    }


MARKERS = RobotMarkers(DIMENSIONS, new_marker)


@given(positions, pitches)
def test_parts_are_at_the_same_places_as_in_the_scene(position, psi):
    links = scene(position, psi)
    snapshot = Snapshot(1.0, position, psi)
    sent = MARKERS.at(snapshot, poses_in_map(FRAMES.at(position, psi)), whole=False)
    found = {(marker.ns, marker.id): marker for marker in sent}
    for link in LINKS:
        for number, part in enumerate(p for p in parts(DIMENSIONS) if p.link == link):
            marker = found[link, number]
            expected = transformations.euler_matrix(*part.rpy)
            expected[:3, 3] = part.position
            assert matrix_of(marker.pose.position, marker.pose.orientation) == pytest.approx(
                links[link] @ expected, abs=1e-9
            )
            assert marker.header.frame_id == 'map'


@given(positions, pitches, positions)
def test_transforms_chain_to_the_same_places(position, psi, odometry):
    links = scene(position, psi)
    frames = FRAMES.moving(position, psi, odometry) | FRAMES.fixed
    assert set(frames) == set(PARENTS) == {*MOVING, SONAR}
    assert set(FRAMES.at(position, psi)) == set(frames)
    poses = [frames[frame] for frame in PARENTS]
    (message,) = LAYOUT.encode(np.array([1_500_000_000]), poses)
    sent = decoder(TRANSFORMS)(message.tobytes()).transforms
    tree = {MAP: np.eye(4)}
    for each in sent:  # a parent comes before its children
        transform = each.transform
        step = matrix_of(transform.translation, transform.rotation)
        tree[each.child_frame_id] = tree[each.header.frame_id] @ step
        assert (each.header.stamp.sec, each.header.stamp.nanosec) == (1, 500_000_000)
    for link, expected in links.items():
        assert tree[link] == pytest.approx(expected, abs=1e-9)


@given(st.integers(0, 2**31 * 10**9 - 1), st.lists(st.floats(-9.0, 9.0), min_size=7, max_size=7))
def test_transforms_have_the_bytes_of_the_general_encoder(stamp_ns, numbers):
    x, y, z, *rotation = numbers
    poses = [FramePose((x, y, z), rotation), FramePose((z, x, y), rotation[::-1])]
    parents = {'base_link': 'map', 'sonar': 'base_link'}
    message = new_message(TRANSFORMS)
    for (child, parent), pose in zip(parents.items(), poses, strict=True):
        each = new_message('geometry_msgs/msg/TransformStamped')
        each.header.stamp.sec, each.header.stamp.nanosec = divmod(stamp_ns, 10**9)
        each.header.frame_id, each.child_frame_id = parent, child
        point, quaternion = each.transform.translation, each.transform.rotation
        point.x, point.y, point.z = pose.position
        quaternion.w, quaternion.x, quaternion.y, quaternion.z = pose.rotation
        message.transforms.append(each)
    (encoded,) = TransformsLayout(parents).encode(np.array([stamp_ns]), poses)
    assert encoded.tobytes() == encoder(TRANSFORMS)(message)


def test_a_wheel_without_width_has_no_markers():
    markers = RobotMarkers(replace(DIMENSIONS, wheel_width=0.0), new_marker)
    links = {namespace for namespace, _ in markers_at(markers, still(1.0))} & set(LINKS)
    assert links == {BALL, BODY}


def test_parts_have_their_shapes_and_colours():
    found = markers_at(MARKERS, Snapshot(1.0, (0.0, 0.0), (0.0, 0.0)))
    for link in LINKS:
        for number, part in enumerate(p for p in parts(DIMENSIONS) if p.link == link):
            marker = found[link, number]
            scale = marker.scale.x, marker.scale.y, marker.scale.z
            expected = {
                'box': part.size,
                'cylinder': (2 * part.size[0], 2 * part.size[0], part.size[-1]),
                'sphere': (2 * part.size[0],) * 3,
            }[part.shape]
            assert marker.type == SHAPES[part.shape]
            assert marker.action == ADD
            assert scale == pytest.approx(expected)
            rgb = marker.color.r, marker.color.g, marker.color.b
            assert rgb == pytest.approx([channel / 255 for channel in part.colour])
            assert marker.color.a == 1.0


def still(time, **values):
    return Snapshot(time, (0.0, 0.0), (0.0, 0.0), **values)


def test_a_new_run_deletes_everything_first():
    markers = RobotMarkers(DIMENSIONS, new_marker)
    first = markers_at(markers, still(1.0))
    assert next(iter(first.values())).action == DELETE_ALL
    second = markers_at(markers, still(1.1))
    assert second.keys() < first.keys()
    assert DELETE_ALL not in {marker.action for marker in second.values()}
    markers.begin(None)
    again = markers_at(markers, still(1.0))
    assert next(iter(again.values())).action == DELETE_ALL
    assert again.keys() == first.keys()


def test_the_beam_is_as_long_as_the_measured_distance():
    markers = RobotMarkers(DIMENSIONS, new_marker)
    beam = markers_at(markers, still(1.0, sonar=0.75))[SONAR, 0]
    assert beam.action == ADD
    assert len(beam.points) % 3 == 0
    assert max(point.x for point in beam.points) == pytest.approx(0.75)
    assert min(point.x for point in beam.points) == 0.0
    assert beam.pose.position.x == pytest.approx(DIMENSIONS.body_depth / 2)
    for silent in (math.inf, math.nan, 0.0):
        assert markers_at(markers, still(1.0, sonar=silent))[SONAR, 0].action == DELETE


@pytest.mark.parametrize(
    ('cone_angle', 'drawn'),
    [
        (0.52, 0.52),
        (0.0, math.radians(1.0)),
        (0.01, math.radians(1.0)),
        (-1.0, math.radians(1.0)),
        (math.nan, math.radians(1.0)),
        (math.pi, 3.0),
        (math.inf, 3.0),
    ],
)
def test_the_cone_has_its_opening_and_a_single_ray_is_still_visible(cone_angle, drawn):
    markers = RobotMarkers(DIMENSIONS, new_marker)
    beam = markers_at(markers, still(1.0, sonar=2.0, cone_angle=cone_angle))[SONAR, 0]
    assert max(point.y for point in beam.points) == pytest.approx(2.0 * math.tan(drawn / 2))


def test_the_text_shows_state_and_display():
    markers = RobotMarkers(DIMENSIONS, new_marker)
    text = markers_at(markers, still(1.0, state='balance', lcd='NXT BALLBOT     \n\nTIME: 1'))
    assert text['text', 0].text == 'balance\nNXT BALLBOT\nTIME: 1'
    assert text['text', 0].pose.position.z > 2 * DIMENSIONS.body_height
    assert markers_at(markers, still(1.0))['text', 0].action == DELETE


def test_the_trail_follows_the_ball_and_is_bounded():
    markers = RobotMarkers(DIMENSIONS, new_marker)
    assert markers_at(markers, still(1.0))['trail', 0].action == DELETE  # a point is no line
    positions = [(0.02 * step, 0.01 * step) for step in range(TRAIL_POINTS + 50)]
    for position in positions:
        markers.follow(Snapshot(1.0, position, (0.0, 0.0)))
    end = Snapshot(1.0, positions[-1], (0.0, 0.0))
    trail = markers_at(markers, end)['trail', 0]
    assert trail.action == ADD
    assert len(trail.points) == TRAIL_POINTS
    assert (trail.points[-1].x, trail.points[-1].y) == (positions[-1][0], -positions[-1][1])
    # The trail is published again only when it has grown, or together with everything.
    assert ('trail', 0) not in markers_at(markers, end)
    assert ('trail', 0) in markers_at(markers, end, whole=True)
    markers.begin(None)
    assert markers_at(markers, end)['trail', 0].action == DELETE


def test_walls_stand_on_the_floor_and_are_published_periodically():
    cells = np.full((20, 30), FLOOR, np.uint8)
    cells[0], cells[5:9, 4:6] = WALL, WALL
    floor_map = FloorMap(cells)
    markers = RobotMarkers(DIMENSIONS, new_marker)
    markers.begin(floor_map)

    def shown(*, whole):
        found = markers_at(markers, still(1.0), whole=whole)
        return [marker for (name, _), marker in found.items() if name == 'walls']

    blocks = shown(whole=False)
    assert shown(whole=False) == []
    assert len(shown(whole=True)) == len(blocks) == len(walls(floor_map)) == 2
    covered = [
        (
            block.pose.position.x - block.scale.x / 2,
            block.pose.position.y - block.scale.y / 2,
            block.pose.position.x + block.scale.x / 2,
            block.pose.position.y + block.scale.y / 2,
        )
        for block in blocks
    ]
    assert np.array(covered) == pytest.approx(np.array(walls(floor_map)))
    for block in blocks:
        assert block.pose.position.z == pytest.approx(block.scale.z / 2)
        assert block.scale.z == pytest.approx(0.2)
        assert block.color.r == pytest.approx(colours.WALL[0] / 255)
