"""The live inputs of the gamepad node, without ROS: each one's sticks, errors and release."""

import time
from dataclasses import replace
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

pytest.importorskip('rclpy')

from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_check_compatible

from ballbot_ros.errors import TeleopError
from ballbot_ros.nodes import gamepad_teleop
from ballbot_ros.nodes.gamepad_teleop import TeleopInputs
from ballbot_ros.nodes.teleop.gamepad import ANY, GamepadState, InputErrors
from ballbot_ros.nodes.teleop.sticks import Arbiter
from ballbot_ros.parameters import GamepadParameters
from ballbot_ros.recording.messages.topics import CMD_VEL, CMD_VEL_STAMPED, JOY, VIEWER_JOY
from ballbot_ros.recording.schemas import encoder, new_message
from ballbot_ros.robot.brick.bluetooth import NEUTRAL

FORWARD = (-100, 0)


class StubNode:
    """Stores the subscriptions and the log of the inputs."""

    def __init__(self, **parameters):
        self.parameters = GamepadParameters(**{'device': '', **parameters})
        self.offers, self.received, self.kinds = [], {}, {}
        self.warned, self.informed = [], []

    def create_subscription(self, kind, name, take, *rest, **_):
        self.received[name], self.kinds[name] = take, kind
        return name

    def destroy_subscription(self, name):
        del self.received[name], self.kinds[name]

    def create_wall_timer(self, period_s, callback):
        self.look_for_cmd_vel = callback

    def get_publishers_info_by_topic(self, name):
        return [SimpleNamespace(topic_type=type_name) for type_name in self.offers]

    def get_logger(self):
        return SimpleNamespace(info=self.informed.append)

    def warn(self, problem):
        self.warned.append(problem)


class Inputs:
    """The inputs of a stub node, all at one instant: no input ever counts as silent."""

    def __init__(self, **parameters):
        self.node, self.sources, self.errors = StubNode(**parameters), Arbiter(), InputErrors()
        self._began = time.monotonic()
        self.inputs = TeleopInputs(self.node, self.sources, self.errors)

    def receive(self, topic, message):
        self.node.received[topic.name](encoder(topic.type_name)(message))

    def sticks(self):
        return self.sources.select(self._began, NEUTRAL).sticks

    def error(self):
        """The errors in the diagnostics once those of working inputs are dropped."""
        self.errors.remove_cleared()
        return str(self.errors)


def joy(*axes):
    message = new_message(JOY.type_name)
    message.axes = np.array(axes, np.float32)
    return message


def twist(topic):
    message = new_message(topic.type_name)
    velocity = message.twist if topic is CMD_VEL_STAMPED else message
    velocity.linear.x = 1.0
    return message


def test_an_unusable_input_is_released_at_once():
    """It is released at the same instant, long before the source counts as silent."""
    inputs = Inputs()
    for axes, sticks in (((0.0, 1.0, 0.0, 0.0), FORWARD), ((0.0,), NEUTRAL)):
        inputs.receive(JOY, joy(*axes))
        assert inputs.sticks() == sticks
    assert inputs.node.warned == ['joy: axis 1 not found: the input has only 1 axes']


def test_a_malformed_message_is_an_error_of_its_input():
    for topic in (JOY, VIEWER_JOY, CMD_VEL):
        inputs = Inputs()
        inputs.receive(topic, twist(topic) if topic is CMD_VEL else joy(0.0, 1.0, 0.0, 0.0))
        assert inputs.sticks() == FORWARD
        inputs.node.received[topic.name](b'')
        assert inputs.sticks() == NEUTRAL
        (warning,) = inputs.node.warned
        assert warning.startswith(f'{topic.name}: not a valid {topic.type_name}: ')


def test_the_sticks_of_the_page_reach_the_allowed_maximum():
    """The mapping of a gamepad's axes does not apply to them."""
    inputs = Inputs(gp_max=40, deadzone=0.5)
    inputs.receive(VIEWER_JOY, joy(0.0, 0.25, 0.0, 0.0))
    assert inputs.sticks() == (-10, 0)
    inputs.node.parameters = GamepadParameters(device='', gp_max=80)
    inputs.inputs.apply_parameters()
    inputs.receive(VIEWER_JOY, joy(0.0, 0.25, 0.0, 0.0))
    assert inputs.sticks() == (-20, 0)


def test_an_input_is_read_whatever_its_publisher_offers():
    for reliability in (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT):
        offered = QoSProfile(depth=1, reliability=reliability)
        _, reason = qos_check_compatible(offered, gamepad_teleop.NEWEST)
        assert 'reliab' not in reason.lower()


def test_a_velocity_follows_the_speed_of_a_full_stick_at_once():
    """The controller's gain and the meaning of ``cmd_vel`` change together, during a run."""
    inputs = Inputs()
    inputs.node.offers = [CMD_VEL.type_name]
    inputs.node.look_for_cmd_vel()
    found = []
    for gain in (4000.0, 8000.0):
        inputs.node.parameters = GamepadParameters(device='', k_thetadot=gain)
        inputs.receive(CMD_VEL, twist(CMD_VEL))
        found.append(inputs.sticks()[0])
    assert found == [-55, -28]


def test_cmd_vel_is_read_with_the_type_that_is_published():
    """Each row is a look at the publishers: the type read from then on, and the error shown."""
    inputs = Inputs()
    assert inputs.node.kinds[CMD_VEL.name] is CMD_VEL.message_class
    twist, stamped, other = CMD_VEL.type_name, CMD_VEL_STAMPED.type_name, 'x/msg/Y'
    for offers, read, error in (
        ([], CMD_VEL, ''),  # from the start, so that tools list the topic
        ([other], CMD_VEL, f'published as {other}; not supported: publish {twist} or {stamped}'),
        ([twist, twist], CMD_VEL, ''),
        ([twist, stamped], CMD_VEL, f'published as {twist}, {stamped}; only {twist} is read: '),
        ([], CMD_VEL, ''),
        ([other, twist], CMD_VEL, f'published as {twist}, {other}; only {twist} is read: '),
        ([other], CMD_VEL, f'published as {other}; not supported: '),
        ([twist], CMD_VEL, ''),
        ([stamped], None, ''),  # by the next look the middleware has released the old type
        ([stamped], CMD_VEL_STAMPED, ''),
        ([twist, stamped], CMD_VEL_STAMPED, f'published as {twist}, {stamped}; only {stamped} is '),
        ([], CMD_VEL_STAMPED, ''),
        ([twist], None, ''),
        ([], CMD_VEL, ''),
    ):
        inputs.node.offers = offers
        inputs.node.look_for_cmd_vel()
        expected = read and read.message_class
        assert inputs.node.kinds.get(CMD_VEL.name) is expected, (offers, read)
        found = inputs.error()
        assert found.startswith(f'cmd_vel type: {error}') if error else found == '', (offers, found)


def test_cmd_vel_of_another_type_ends_the_old_command_at_once():
    inputs = Inputs()
    for topic, sticks in ((CMD_VEL, FORWARD), (CMD_VEL_STAMPED, NEUTRAL)):
        inputs.node.offers = [topic.type_name]
        inputs.node.look_for_cmd_vel()
        if topic is CMD_VEL:
            inputs.receive(topic, twist(topic))
        assert inputs.sticks() == sticks
    inputs.node.look_for_cmd_vel()
    inputs.receive(CMD_VEL_STAMPED, twist(CMD_VEL_STAMPED))
    assert inputs.sticks() == FORWARD


class StubGamepad:
    """A gamepad that reports what the test tells it to."""

    opened: ClassVar = []

    def __init__(self, wanted, backend, *, on_state, on_disconnected, on_problem):
        self.name, self.is_closed = wanted, False
        self.report, self.disconnect, self.refuse = on_state, on_disconnected, on_problem
        self.opened.append(self)

    def close(self):
        self.is_closed = True


@pytest.fixture
def gamepads(monkeypatch):
    """The gamepads that have been opened."""
    opened = []
    monkeypatch.setattr(StubGamepad, 'opened', opened)
    monkeypatch.setattr(gamepad_teleop, 'Gamepad', StubGamepad)
    monkeypatch.setattr(gamepad_teleop, 'SdlBackend', lambda: None)
    return opened


def test_a_gamepad_drives_until_it_is_disconnected(gamepads):
    inputs = Inputs(device=ANY)
    (gamepad,) = gamepads
    gamepad.report(GamepadState([0.0, 1.0, 0.0, 0.0], []))
    assert inputs.sticks() == FORWARD
    gamepad.disconnect()
    assert inputs.sticks() == NEUTRAL


def test_another_device_replaces_the_gamepad(gamepads):
    inputs = Inputs(device='plain')
    for device, opened in (
        ('plain', [('plain', False)]),
        ('fancy', [('plain', True), ('fancy', False)]),
        ('', [('plain', True), ('fancy', True)]),
    ):
        inputs.node.parameters = replace(inputs.node.parameters, device=device)
        inputs.inputs.apply_parameters()
        assert inputs.inputs.gamepad == device
        assert [(gamepad.name, gamepad.is_closed) for gamepad in gamepads] == opened, device


def test_a_gamepad_that_can_not_be_used_is_shown_until_another_works(gamepads):
    inputs = Inputs(device=ANY)
    gamepads[0].refuse('Strange Thing: no mapping')
    assert inputs.error() == 'device: Strange Thing: no mapping'
    gamepads[0].report(GamepadState([0.0, 1.0, 0.0, 0.0], []))
    assert inputs.error() == ''


def test_a_problem_of_another_device_is_over(gamepads):
    inputs = Inputs(device='strange')
    gamepads[0].refuse('Strange Thing: no mapping')
    inputs.node.parameters = replace(inputs.node.parameters, device='plain')
    inputs.inputs.apply_parameters()
    assert inputs.error() == ''


def test_without_sdl_only_a_gamepad_that_was_asked_for_is_missed(monkeypatch):
    def fail():
        raise TeleopError('pygame not found')

    monkeypatch.setattr(gamepad_teleop, 'SdlBackend', fail)
    for device, informed in (('', []), (ANY, ['no gamepad: pygame not found'])):
        inputs = Inputs(device=device)
        assert inputs.inputs.gamepad == ''
        assert inputs.node.informed == informed
    with pytest.raises(TeleopError, match='pygame not found'):
        Inputs(device='plain')
