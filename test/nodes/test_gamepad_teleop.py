"""The gamepad node and its keyboard, without ROS: the answers to a tick, errors, the panel."""

import signal
import time
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import serialize_message
from stubs import bare

from ballbot_ros.lockstep.lockstep import GivenAnswers, RunIdentity
from ballbot_ros.nodes import plant_display
from ballbot_ros.nodes.base import BallbotNode
from ballbot_ros.nodes.gamepad_teleop import GamepadTeleop
from ballbot_ros.nodes.plant_display import PlantDisplay
from ballbot_ros.nodes.teleop import terminal
from ballbot_ros.nodes.teleop.gamepad import InputErrors
from ballbot_ros.nodes.teleop.sticks import KEYBOARD, Arbiter, Command
from ballbot_ros.nodes.teleop.terminal import KeyboardSticks, Terminal
from ballbot_ros.parameters import GamepadParameters
from ballbot_ros.parameters.timing import FIRST_TICK_NS, SLOW_PERIOD_NS
from ballbot_ros.recording.messages.conversions import encode_sticks, fill_time
from ballbot_ros.recording.messages.topics import PLANT_SLOW_ODOM, SCENARIO
from ballbot_ros.robot.brick.bluetooth import NEUTRAL

FORWARD = (-50, 0)


def test_a_repeated_request_gets_the_same_answer_within_a_run():
    """A restarted plant asks for the same ticks again, but in another run."""
    asked, sent, counted = [], [], []

    def sticks_at(elapsed_s):
        asked.append(elapsed_s)
        return len(asked), 0

    node = bare(
        GamepadTeleop,
        _answers=GivenAnswers(),
        _command=Command(SCENARIO, NEUTRAL),
        _log=None,
        _output=SimpleNamespace(publish=sent.append),
        _scenario=SimpleNamespace(sticks_at=sticks_at),
        _sources=Arbiter(),
        now_ns=0,
        count_sample=lambda now_ns: counted.append(now_ns) or vars(node).update(now_ns=now_ns),
        parameters=GamepadParameters(),
    )
    second_ns = FIRST_TICK_NS + SLOW_PERIOD_NS
    stamps = (FIRST_TICK_NS, second_ns, FIRST_TICK_NS)
    for name, expected in (('1 a', [1, 2, 1]), ('1 b', [3, 4, 3])):
        node._on_run(RunIdentity(name, FIRST_TICK_NS))
        for stamp_ns, value in zip(stamps, expected, strict=True):
            node._answer(stamp_ns)
            assert sent[-1] == encode_sticks(stamp_ns, (value, 0), SCENARIO), name
    assert asked == [0.0, 0.02] * 2
    assert counted[:3] == [FIRST_TICK_NS, second_ns, second_ns], 'it announces the newest'


def test_the_error_of_an_input_that_works_again_is_reported_once_more(monkeypatch):
    reported = []
    monkeypatch.setattr(BallbotNode, 'report', lambda node: reported.append(node._problem))
    errors = InputErrors()
    node = bare(
        GamepadTeleop, _input_errors=errors, _level=DiagnosticStatus.WARN, _problem='joy: no axis'
    )
    errors.add('joy', 'no axis')
    errors.clear('joy')
    for _ in range(2):
        node.report()
    assert reported == ['joy: no axis', '']


def test_the_error_of_another_input_stays_a_warning(monkeypatch):
    monkeypatch.setattr(BallbotNode, 'report', lambda node: None)
    warned, errors = [], InputErrors()
    node = bare(GamepadTeleop, _input_errors=errors, warn=warned.append)
    errors.add('joy', 'no axis')
    errors.add('cmd_vel', 'two types')
    errors.clear('joy')
    node.report()
    assert warned == [str(errors)]
    assert 'two types' in warned[0]


def test_only_the_slow_ticks_of_its_run_are_answered():
    answered, ignored = [], []
    node = bare(
        GamepadTeleop,
        _answer=answered.append,
        _participation=SimpleNamespace(includes=lambda now_ns: now_ns >= FIRST_TICK_NS),
        warn_malformed=lambda topic, error: ignored.append(topic),
    )
    truth = PLANT_SLOW_ODOM.message_class()
    for stamp_ns in (
        FIRST_TICK_NS - SLOW_PERIOD_NS, FIRST_TICK_NS, FIRST_TICK_NS + SLOW_PERIOD_NS // 2
    ):  # fmt: skip
        fill_time(truth.header.stamp, stamp_ns)
        node._on_truth(serialize_message(truth))
    node._on_truth(b'')
    assert answered == [FIRST_TICK_NS]
    assert ignored == [PLANT_SLOW_ODOM]


def test_a_new_source_of_the_sticks_is_logged():
    lines = []
    node = bare(
        GamepadTeleop,
        _command=Command(SCENARIO, NEUTRAL),
        _scenario=SimpleNamespace(sticks_at=lambda elapsed_s: NEUTRAL),
        _sources=Arbiter(),
        get_logger=lambda: SimpleNamespace(info=lines.append),
        parameters=GamepadParameters(scenario='square'),
    )
    node._select(0.0)
    node._sources.report(KEYBOARD, FORWARD, time.monotonic())
    for _ in range(2):
        node._select(0.0)
    assert lines == ['in command: keyboard (was scenario)']
    for gamepad, told in (('', 'none'), ('pad', 'pad')):
        node._inputs = SimpleNamespace(gamepad=gamepad)
        assert node.diagnose() == {'in command': 'keyboard', 'sticks': '-50 0', 'gamepad': told}


def test_terminal_and_gamepad_are_closed():
    closed = []

    def closing(name):
        return SimpleNamespace(close=lambda: closed.append(name))

    node = bare(
        GamepadTeleop, _inputs=closing('gamepad'), terminal=closing('terminal'),
        _display=closing('robot'), flush=lambda topic: closed.append(topic.name),
    )  # fmt: skip
    node.close()
    assert closed == ['terminal', 'robot', 'gamepad', 'gamepad']
    node.close()
    assert closed[4:] == ['gamepad', 'gamepad']


@pytest.fixture
def sources():
    return Arbiter()


@pytest.fixture
def calls():
    return []


@pytest.fixture
def display(monkeypatch, calls):
    """What is shown of the robot of a stub node."""
    client = SimpleNamespace(call_async=lambda request: calls.append('reset'))
    node = SimpleNamespace(
        create_client=lambda kind, name: client if name == 'plant_sim/reset' else None,
        destroy_client=lambda given: calls.append(given is client),
    )
    newest = SimpleNamespace(take=lambda: (None, set()), close=lambda: calls.append('robot closed'))
    monkeypatch.setattr(plant_display, 'LatestMessages', lambda node, topics: newest)
    monkeypatch.setattr(plant_display, 'drive_status', lambda snapshot, factor: {'state': 'remote'})
    return PlantDisplay(node)


@pytest.fixture
def keyboard(monkeypatch, sources, calls, display):
    """The keyboard on a terminal that is not read."""
    monkeypatch.setattr(terminal.signal, 'signal', lambda *given: calls.append(given))
    monkeypatch.setattr(terminal, 'keyboard_unavailable_reason', lambda: '')
    with monkeypatch.context() as patch:
        patch.setattr(Terminal, '_run', lambda self: None)
        return Terminal(
            KeyboardSticks(100), sources, lambda: (KEYBOARD, FORWARD), display.lines,
            on_quit=lambda: calls.append('finished'), on_reset=display.restart,
        )  # fmt: skip


def test_a_terminal_that_vanishes_releases_the_keyboard_at_once(monkeypatch, keyboard, sources):
    def vanish():
        raise OSError

    began = time.monotonic()
    sources.report(KEYBOARD, FORWARD, began)
    assert not keyboard.is_closed
    monkeypatch.setattr(terminal, '_Redirected', vanish)
    keyboard._run()
    assert sources.select(began, NEUTRAL).sticks == NEUTRAL
    assert keyboard.is_closed


def test_the_keys_reset_and_quit(keyboard, calls, display):
    """A node that loses its terminal must not end, so it ignores SIGHUP."""
    pytest.importorskip('prompt_toolkit')
    assert calls == [(signal.SIGHUP, signal.SIG_IGN)]
    keyboard.on_key = lambda: calls.append('key')
    keyboard._app = SimpleNamespace(is_running=False)
    bindings = keyboard._bindings()
    for key in 'r', 'q':
        bindings.get_bindings_for_keys((key,))[-1].handler(None)
    display.close()
    assert calls[1:] == ['key', 'reset', 'key', 'finished', 'robot closed', True]


def test_the_panel_shows_the_robot_the_source_and_the_sticks(keyboard):
    """Forward is positive, as everywhere except in the document's sticks."""
    assert keyboard._panel().splitlines()[:3] == [
        'state       remote', 'in command  keyboard', 'sticks      forward +50   rightward +0'
    ]  # fmt: skip
