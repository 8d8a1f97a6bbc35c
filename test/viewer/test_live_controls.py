"""Requests of the live page to the robot."""

import pytest
from browsing import StubRobot, receive
from parts import DIMENSIONS

from ballbot_ros.viewer.live_controls import LiveControls
from ballbot_ros.viewer.page import Page


@pytest.fixture
def page():
    served = Page(DIMENSIONS, 'test', '127.0.0.1', 0)
    yield served
    served.stop()


def test_clicks_reach_the_robot_in_their_order(page):
    robot = StubRobot()
    LiveControls(page.server.gui, robot.start, robot.push, ['push'])
    inputs = {each.label: each for each in page.server.gui._gui_input_handle_from_uuid.values()}
    clicks = [(inputs['Direction'], name) for name in ('forward', 'left', 'left', 'back')] * 50
    receive(page.server, *clicks)
    forces = [(1.0, 0.0), (0.0, -1.0), (0.0, -1.0), (-1.0, 0.0)]
    assert robot.asked == [('push', force) for force in forces] * 50
