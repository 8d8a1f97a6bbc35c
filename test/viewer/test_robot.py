"""The positions of the robot's parts, and the views of the cameras."""

import math

import numpy as np
import pytest
from parts import DIMENSIONS

from ballbot_ros.recording.messages.conversions import pitch_angles
from ballbot_ros.viewer.markers import Area
from ballbot_ros.viewer.robot import BALL, LINKS, parts, wxyz
from ballbot_ros.viewer.snapshot import Snapshot
from ballbot_ros.viewer.views import (
    CHASER_1,
    CHASER_2,
    ROBOT,
    TOP,
    TRACKING,
    VIEWS,
    RollingOrientation,
    body_rotation,
    camera,
)


def snapshot(position=(0.0, 0.0), psi=(0.0, 0.0), time=1.0):
    return Snapshot(time, position, psi)


def test_the_orientation_is_that_of_the_imu_message():
    assert pitch_angles(*wxyz(body_rotation((0.2, -0.1)))) == pytest.approx((0.2, -0.1))


def test_a_forward_lean_moves_the_head_forward_and_a_rightward_lean_right():
    head = (0.0, 0.0, 1.0)
    assert body_rotation((0.3, 0.0)).apply(head)[0] > 0.0
    assert body_rotation((0.0, 0.3)).apply(head)[1] < 0.0


def test_a_ball_that_has_rolled_its_circumference_looks_as_before():
    orientation = RollingOrientation(DIMENSIONS)
    for distance in np.linspace(0.0, 2.0 * math.pi * DIMENSIONS.ball_radius, 50):
        rotation = orientation.ball((distance, 0.0))
    assert rotation.magnitude() == pytest.approx(0.0, abs=1e-9)


def test_the_top_of_a_rolling_ball_moves_where_it_rolls():
    for step, axis, sign in (((1e-3, 0.0), 0, 1.0), ((0.0, 1e-3), 1, -1.0)):
        orientation = RollingOrientation(DIMENSIONS)
        orientation.ball((0.0, 0.0))
        assert sign * orientation.ball(step).apply((0.0, 0.0, 1.0))[axis] > 0.0


def test_a_position_without_a_value_does_not_turn_the_ball():
    orientation = RollingOrientation(DIMENSIONS)
    for x in (0.0, math.nan, 0.0, math.inf, 0.0):
        rotation = orientation.ball((x, 0.0))
    assert rotation.magnitude() == 0.0


def test_wheels_turn_without_slip():
    """Where they touch, at the ball's equator, wheel and ball have the same velocity."""
    angle = 1e-4
    orientation = RollingOrientation(DIMENSIONS)
    place = angle * DIMENSIONS.ball_radius
    wheel, _ = orientation.wheels((place, 0.0), (0.0, 0.0))
    orientation.ball((0.0, 0.0))
    ball = orientation.ball((place, 0.0)).apply((-DIMENSIONS.ball_radius, 0.0, 0.0))
    tyre = wheel.apply((DIMENSIONS.wheel_radius, 0.0, 0.0))
    assert ball[2] == pytest.approx(tyre[2], rel=1e-3)
    assert ball[2] > 0.0


def test_a_body_that_leans_with_the_ball_does_not_turn_the_wheels():
    position = 0.1 * DIMENSIONS.ball_radius, 0.0
    for wheel in RollingOrientation(DIMENSIONS).wheels(position, (0.1, 0.0)):
        assert wheel.magnitude() == pytest.approx(0.0)


def test_the_parts_stand_on_the_floor():
    assert {part.link for part in parts(DIMENSIONS)} == set(LINKS)
    for part in parts(DIMENSIONS):
        if part.link != BALL:
            assert part.position[2] > -DIMENSIONS.ball_radius


def test_only_tracking_views_follow_the_robot():
    area = Area.of(None)
    for view in VIEWS:
        here, there = (
            np.array(camera(view, snapshot(position), DIMENSIONS, area, 1.5).position)
            for position in ((0.0, 0.0), (0.5, 0.25))
        )
        moved = (0.5, -0.25, 0.0) if view in TRACKING else (0.0, 0.0, 0.0)
        assert there - here == pytest.approx(moved)


def test_each_camera_is_where_the_document_says():
    area = Area.of(None)
    seen = {view: camera(view, snapshot(), DIMENSIONS, area, 1.5) for view in VIEWS}
    assert seen[TOP].position[2] > 2.0
    assert seen[CHASER_1].position[1] > 0.5  # on the left
    assert seen[CHASER_2].position[0] > 0.5  # in front
    assert seen[ROBOT].position[0] == pytest.approx(DIMENSIONS.body_depth / 2, abs=0.02)
    assert seen[ROBOT].look_at[0] > seen[ROBOT].position[0]
