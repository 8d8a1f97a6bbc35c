"""What every node has in common, without the graph: diagnostics, topics, start and end."""

import signal
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy import Future
from rclpy.qos import DurabilityPolicy
from rclpy.serialization import serialize_message
from stubs import bare

from ballbot_ros.errors import BallbotError
from ballbot_ros.nodes import base
from ballbot_ros.nodes.base import BallbotNode, run_node, spin
from ballbot_ros.recording.messages.conversions import time_ns
from ballbot_ros.recording.messages.topics import (
    CLOCK,
    GYRO_IMU,
    LCD,
    MAP,
    MOTOR_DUTY,
    RUN,
    WALL_HIT,
)


class Log:
    """Stores the lines of a log."""

    def __init__(self):
        self.lines = []

    def __getattr__(self, severity):
        return lambda text, **_: self.lines.append((severity, text))


def stub_node(**attributes):
    """Return a node with these attributes and those of its diagnostics, and its log."""
    log = Log()
    given = {
        '_level': DiagnosticStatus.OK, '_problem': '', 'exit_status': 0, 'failure': '',
        'logs_failure': True, 'get_logger': lambda: log,
    }  # fmt: skip
    return bare(BallbotNode, **given | attributes), log


def test_the_diagnostics_count_samples_since_the_last_report(monkeypatch):
    now_s, reports = [10.0], []
    monkeypatch.setattr(base, 'time', SimpleNamespace(monotonic=lambda: now_s[0]))
    node, _ = stub_node(
        role='gyro_driver', now_ns=0, _samples=5, _reported_samples=5,
        _last_sample_at=10.0, _reported_at=10.0,
        _diagnostics=SimpleNamespace(publish=reports.append),
        diagnose=lambda: {'device': 'gyro'},
        get_fully_qualified_name=lambda: '/robot/gyro',
    )  # fmt: skip
    for time_s, samples, rate, age in ((12.0, 3, '1.5', '2.000'), (12.0, 0, '0', '2.000'),
                                       (16.0, 0, '0.0', '6.000')):  # fmt: skip
        for number in range(samples):
            node.count_sample(4_000_000 * (number + 1))
        now_s[0] = time_s
        node.report()
        (status,) = reports[-1].status
        assert {each.key: each.value for each in status.values} == {
            'role': 'gyro_driver', 'rate [Hz]': rate, 'age [s]': age, 'samples': '8',
            'device': 'gyro',
        }, time_s  # fmt: skip
        assert (status.name, status.message) == ('/robot/gyro: loop', 'OK')
        assert (status.level, status.hardware_id) == (DiagnosticStatus.OK, 'ballbot')
        assert time_ns(reports[-1].header.stamp) == 12_000_000


def test_an_error_hides_warnings_until_it_is_cleared():
    node, log = stub_node(report=lambda: shown.append((node._level, node._problem)))
    shown = []
    for act, expected in (
        (lambda: node.warn('slow'), (DiagnosticStatus.WARN, 'slow')),
        (lambda: node.warn('slow'), (DiagnosticStatus.WARN, 'slow')),
        (node.clear_error, (DiagnosticStatus.WARN, 'slow')),
        (node.clear_warning, (DiagnosticStatus.OK, '')),
        (lambda: node.report_error('broken'), (DiagnosticStatus.ERROR, 'broken')),
        (lambda: node.warn('slow'), (DiagnosticStatus.ERROR, 'broken')),
        (node.clear_warning, (DiagnosticStatus.ERROR, 'broken')),
        (node.clear_error, (DiagnosticStatus.OK, '')),
    ):
        act()
        assert (node._level, node._problem) == expected
    assert (node.exit_status, node.failure) == (0, '')
    node.fail('gone')
    assert (node.exit_status, node.failure) == (1, 'gone')
    assert shown == [(DiagnosticStatus.ERROR, 'broken'), (DiagnosticStatus.ERROR, 'gone')]
    assert log.lines == [
        ('warning', 'slow'), ('error', 'broken'), ('warning', 'slow'), ('error', 'gone')
    ]  # fmt: skip
    node.logs_failure = False
    node.fail('gone again')
    assert shown[-1] == (DiagnosticStatus.ERROR, 'gone again')
    assert len(log.lines) == 4


def test_a_subscription_decodes_messages_and_ignores_malformed_ones():
    made, received, page = [], [], serialize_message(LCD.message_class(data='page'))
    node, log = stub_node(create_subscription=lambda *arguments, raw: made.append(arguments))
    for is_raw in (False, True):
        node.subscribe(LCD, received.append, depth=3, raw=is_raw)
        _, name, receive, qos = made.pop()
        assert (name, qos.depth, qos.durability) == (
            LCD.name, 3, DurabilityPolicy.TRANSIENT_LOCAL
        )  # fmt: skip
        for data in (page, b'no message'):
            receive(data)
    message, *raw = received
    assert message.data == 'page'
    assert raw == [page, b'no message']
    ((severity, text),) = log.lines
    assert severity == 'warning'
    assert text.startswith('lcd: message ignored: ')
    # A node must not answer the ticks before it has joined.
    node.subscribe(GYRO_IMU, received.append)
    assert made.pop()[-1].durability == DurabilityPolicy.VOLATILE


def test_what_is_kept_of_an_earlier_plant_is_dropped_except_the_announcements():
    dropped = []
    node, _ = stub_node(
        _own_outputs={
            topic: SimpleNamespace(recreate_publishers=lambda topic=topic: dropped.append(topic))
            for topic in (CLOCK, MOTOR_DUTY, RUN, MAP, WALL_HIT, LCD)
        }
    )
    node.recreate_publishers(exclude=RUN)
    assert dropped == [MAP, WALL_HIT, LCD]
    node.drop_latched(MAP)
    assert dropped[3:] == [MAP]


@pytest.fixture
def without_ros(monkeypatch):
    """Return the calls of `run_node`, which starts no ROS."""
    calls = []
    for name, stub in (
        ('prepare_middleware', lambda: calls.append('prepare')),
        ('spin', lambda nodes, done, stop: calls.append('spin')),
        ('end_with_parent', lambda: True),
    ):
        monkeypatch.setattr(base, name, stub)
    monkeypatch.setattr('rclpy.init', lambda **_: calls.append('init'))
    monkeypatch.setattr('rclpy.try_shutdown', lambda: calls.append('shutdown'))
    return calls


def failing(error):
    def fail(*_, **__):
        raise error

    return fail


def runnable(calls, **attributes):
    log = Log()
    given = {
        'awaits': '', 'done': None, 'exit_status': 0, 'log': log, 'get_logger': lambda: log,
        'get_name': lambda: 'gyro', 'close': lambda: calls.append('close'),
        'destroy_node': lambda: calls.append('destroy'),
    }  # fmt: skip
    return SimpleNamespace(**given | attributes)


def test_a_node_is_closed_after_its_work_and_gives_the_exit_status(without_ros):
    for awaits, line in (('', 'started'), ('a run', 'started, waits for a run')):
        without_ros.clear()
        node = runnable(without_ros, exit_status=1, awaits=awaits)
        assert run_node(lambda node=node: node) == 1
        assert without_ros == ['prepare', 'init', 'spin', 'close', 'destroy', 'shutdown']
        assert node.log.lines == [('info', line)]


def test_a_mistake_before_the_start_is_status_2_and_a_failure_at_the_end_1(
    without_ros, monkeypatch, capsys
):
    assert run_node(failing(BallbotError('no map'))) == 2
    assert capsys.readouterr().err == 'error: no map\n'
    unsaved = runnable(without_ros, close=failing(BallbotError('x: full')))
    assert run_node(lambda: unsaved) == 1
    assert capsys.readouterr().err == 'error: gyro: x: full\n'
    assert without_ros[-2:] == ['destroy', 'shutdown']
    with pytest.raises(RuntimeError, match='bug'):
        run_node(lambda: runnable(without_ros, close=failing(RuntimeError('bug'))))
    monkeypatch.setattr('rclpy.init', failing(RuntimeError('bad\nargument')))
    assert run_node(lambda: runnable(without_ros)) == 2
    assert capsys.readouterr().err == 'error: bad argument\n'
    monkeypatch.setattr(base, 'end_with_parent', lambda: False)
    without_ros.clear()
    assert not run_node(lambda: runnable(without_ros))
    assert without_ros == []


@pytest.mark.parametrize('ends_by', ['done', 'signal'])
def test_nodes_are_spun_until_they_are_done_or_asked_to_stop(monkeypatch, ends_by):
    spun, checks = [], []
    done, stop = Future(), SimpleNamespace(signal=0)

    def wait(end, limit_s):
        spun.append(end.done())
        if len(spun) == 3:
            if ends_by == 'done':
                done.set_result(None)
            else:
                stop.signal = signal.SIGTERM
            checks[0]()  # as long as there are callbacks, an executor does not return
            assert end.done()

    executor = SimpleNamespace(add_node=spun.append, spin_until_future_complete=wait)
    monkeypatch.setattr(base, 'EventsExecutor', lambda: executor)
    node = SimpleNamespace(create_timer=lambda period_s, check, clock: checks.append(check))
    spin([node], done, stop)
    assert spun == [node, False, False]
