"""The gamepad node and its keyboard, without ROS: the answers to a tick, errors, the panel."""

import time
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from diagnostic_msgs.msg import DiagnosticStatus

from ballbot_ros.controller.interface import OperatingState
from ballbot_ros.messages.conversions import encode_sticks
from ballbot_ros.nodes import teleop_terminal
from ballbot_ros.nodes.base import BallbotNode
from ballbot_ros.nodes.gamepad_teleop import GamepadTeleop
from ballbot_ros.nodes.teleop_terminal import TeleopTerminal
from ballbot_ros.parameters import GamepadParameters
from ballbot_ros.simulation.lockstep import Run
from ballbot_ros.teleop.arbiter import KEYBOARD, SCENARIO, Arbiter, Command
from ballbot_ros.teleop.input_errors import InputErrors
from ballbot_ros.teleop.sticks import NEUTRAL
from ballbot_ros.timing import FIRST_TICK_NS, SLOW_PERIOD_NS

FORWARD = (-50, 0)


def stub_node(**attributes):
    """Return a gamepad node that has only these attributes."""
    node = GamepadTeleop.__new__(GamepadTeleop)
    vars(node).update(attributes)
    return node


def test_a_repeated_request_gets_the_same_answer_within_a_run():
    """A restarted plant asks for the same ticks again, but in another run."""
    asked, sent = [], []

    def sticks_at(elapsed_s):
        asked.append(elapsed_s)
        return len(asked), 0

    node = stub_node(
        _answers={},
        _command=Command(SCENARIO, NEUTRAL),
        _log=None,
        _output=SimpleNamespace(publish=sent.append),
        _scenario=SimpleNamespace(sticks_at=sticks_at),
        _sources=Arbiter(),
        count_sample=lambda now_ns: None,
        parameters=GamepadParameters(),
    )
    second_ns = FIRST_TICK_NS + SLOW_PERIOD_NS
    stamps = (FIRST_TICK_NS, second_ns, FIRST_TICK_NS)
    for name, expected in (('1 a', [1, 2, 1]), ('1 b', [3, 4, 3])):
        node._on_run(Run(name, FIRST_TICK_NS))
        for stamp_ns, value in zip(stamps, expected, strict=True):
            node._answer(stamp_ns)
            assert sent[-1] == encode_sticks(stamp_ns, (value, 0), SCENARIO), name
    assert asked == [0.0, 0.02] * 2


def test_the_error_of_an_input_that_works_again_is_reported_once_more(monkeypatch):
    reported = []
    monkeypatch.setattr(BallbotNode, 'report', lambda node: reported.append(node._problem))
    errors = InputErrors()
    node = stub_node(_input_errors=errors, _level=DiagnosticStatus.WARN, _problem='joy: no axis')
    errors.add('joy', 'no axis')
    errors.clear('joy')
    for _ in range(2):
        node.report()
    assert reported == ['joy: no axis', '']


@pytest.fixture
def sources():
    return Arbiter()


@pytest.fixture
def terminal(monkeypatch, sources):
    """The keyboard of a stub node, on a stub terminal."""
    monkeypatch.setattr(teleop_terminal.signal, 'signal', lambda *_: None)
    monkeypatch.setattr(
        teleop_terminal,
        'Terminal',
        lambda keys, status, **calls: SimpleNamespace(status=status, **calls),
    )
    node = SimpleNamespace(
        create_client=lambda kind, name: None,
        now_ns=FIRST_TICK_NS,
        parameters=GamepadParameters(),
        subscribe=lambda topic, take: None,
        finish=lambda: None,
    )
    return TeleopTerminal(node, sources, lambda: Command(KEYBOARD, FORWARD))


def test_a_terminal_that_vanishes_releases_the_keyboard_at_once(terminal, sources):
    began = time.monotonic()
    terminal._terminal.on_sticks(FORWARD)
    assert sources.select(began, NEUTRAL).sticks == FORWARD
    assert not terminal.is_closed
    terminal._terminal.on_closed()
    assert sources.select(began, NEUTRAL).sticks == NEUTRAL
    assert terminal.is_closed


def test_the_panel_advises_a_restart_only_after_a_fall(terminal):
    advised = []
    for state in OperatingState:
        terminal._on_state(SimpleNamespace(data=state))
        shown = terminal._terminal.status()['state']
        assert shown.startswith(state)
        if 'press r' in shown:
            advised.append(state)
    assert advised == [OperatingState.OUT_OF_CONTROL]
