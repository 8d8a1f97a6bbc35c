"""Requests of the live page to the robot."""

import pytest
from browsing import StubRobot, receive
from graph import wait_for
from parts import DIMENSIONS

from ballbot_ros.robot.brick.faults import parse_faults
from ballbot_ros.viewer.live_controls import FaultChooser, add_push_buttons
from ballbot_ros.viewer.page import Page


@pytest.fixture
def page():
    served = Page(DIMENSIONS, 'test', '127.0.0.1', 0)
    yield served
    served.stop()


def test_clicks_reach_the_robot_in_their_order(page):
    robot = StubRobot()
    add_push_buttons(page.server.gui, robot.push)
    inputs = {each.label: each for each in page.server.gui._gui_input_handle_from_uuid.values()}
    clicks = [(inputs['Direction'], name) for name in ('forward', 'left', 'left', 'back')] * 50
    receive(page.server, *clicks)
    forces = [(1.0, 0.0), (0.0, -1.0), (0.0, -1.0), (-1.0, 0.0)]
    assert robot.asked == [('push', force) for force in forces] * 50


def test_a_fault_is_chosen_with_what_its_type_needs(page):
    texts = []
    FaultChooser(page.server.gui, texts.append)

    def inputs():
        known = page.server.gui._gui_input_handle_from_uuid.values()
        return {each.label: each for each in known}

    receive(page.server, (inputs()['Begin'], True))
    receive(page.server, (inputs()['Type'], 'wrong'))
    wait_for(lambda: inputs()['Amount'].visible, what='the amount')
    receive(page.server, (inputs()['Amount'], 2.5), (inputs()['Duration [s]'], 0.0))
    receive(page.server, (inputs()['Begin'], True))
    receive(page.server, (inputs()['Component'], 'brick'))
    wait_for(lambda: inputs()['Type'].value == 'restart', what='the only type of a brick')
    receive(page.server, (inputs()['Begin'], True))
    assert texts == ['gyro_x off duration=1.0', 'gyro_x wrong amount=2.5', 'brick restart']
    assert all(parse_faults(text) for text in texts)
