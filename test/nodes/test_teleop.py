"""Live inputs over topics: they drive, they are arbitrated, and the robot stops when they end."""

import contextlib
import itertools
import math
import subprocess
from collections import deque

import pytest
from graph import BALLBOT, Node, free_domain

rclpy = pytest.importorskip('rclpy')

from diagnostic_msgs.msg import DiagnosticStatus  # noqa: E402
from geometry_msgs.msg import Twist, TwistStamped  # noqa: E402
from nav_msgs.msg import Odometry  # noqa: E402
from rclpy.qos import qos_profile_sensor_data  # noqa: E402
from ros_client import Client, header  # noqa: E402
from sensor_msgs.msg import Joy  # noqa: E402

from ballbot_ros.engine.closed_loop import ClosedLoop  # noqa: E402
from ballbot_ros.engine.scenario.reader import load_scenario  # noqa: E402
from ballbot_ros.engine.scenario.scenario import Scenario  # noqa: E402
from ballbot_ros.engine.trajectory import TrajectoryLog  # noqa: E402
from ballbot_ros.nodes.teleop.sticks import NO_SOURCE  # noqa: E402
from ballbot_ros.parameters import GAMEPAD, NODES, PLANT, RECORDER, ParameterSet  # noqa: E402
from ballbot_ros.parameters.timing import FIRST_TICK_NS, MAX_LEAD_TICKS, SLOW_PERIOD_NS, TICK_NS  # noqa: E402
from ballbot_ros.recording.messages.conversions import odometry_position, stamp_ns  # noqa: E402
from ballbot_ros.recording.messages.topics import (  # noqa: E402
    DIAGNOSTICS,
    GAMEPAD_JOY,
    JOY,
    OPERATING_STATE,
    PLANT_IMU,
    PLANT_ODOM,
    PLANT_SLOW_ODOM,
    ROLL_CALL,
)
from ballbot_ros.recording.reader import RecordingReader  # noqa: E402

pytestmark = pytest.mark.graph

PERIOD_S = 0.05


def sticks_of(message):
    """Return the sticks in a message of `gamepad`, as integers."""
    return tuple(round(axis * 100.0) for axis in message.axes)


class Driver(Client):
    """Publishes inputs, and observes the resulting sticks."""

    def __init__(self, domain):
        super().__init__(domain)
        self.domain = domain
        for topic in (PLANT_IMU, PLANT_ODOM, GAMEPAD_JOY, OPERATING_STATE, DIAGNOSTICS):
            self.watch(topic)

    @contextlib.contextmanager
    def sending(self, topic, message, qos=10):
        """Publish a message every PERIOD_S within the block."""
        publisher = self.node.create_publisher(type(message), topic, qos)
        timer = self.node.create_timer(PERIOD_S, lambda: publisher.publish(message))
        try:
            yield
        finally:
            self.node.destroy_timer(timer)
            self.node.destroy_publisher(publisher)

    @property
    def sticks(self):
        return sticks_of(self.newest[GAMEPAD_JOY.name])

    @property
    def source(self):
        return self.newest[GAMEPAD_JOY.name].header.frame_id

    def await_command(self, source, sticks):
        self.spin_until(lambda: (self.source, self.sticks) == (source, sticks))

    def await_rest(self):
        self.await_command('scenario', (0, 0))

    def status(self):
        """The newest diagnostics of the gamepad node."""
        reports = self.seen.get(DIAGNOSTICS.name, [])
        for report in reversed(reports):
            for status in report.status:
                if status.name.startswith(f'/{GAMEPAD}'):
                    return status
        return DiagnosticStatus()


def joy(forward=0.0, left=0.0):
    return Joy(axes=[0.0, forward, left, 0.0, 0.0, 0.0], buttons=[0] * 15)


def twist(forward=0.0, left=0.0):
    message = Twist()
    message.linear.x, message.linear.y = forward, left
    return message


@pytest.fixture(scope='module')
def graph(fork_client):
    """A graph for all tests of this module; its inputs use the wall clock."""
    parameters = {GAMEPAD: {'device': "''"}, PLANT: {'real_time_factor': 0.4, 'on_timeout': 'wait'}}
    with contextlib.ExitStack() as stack:
        domain = stack.enter_context(free_domain())
        for name in NODES:
            if name != RECORDER:
                stack.callback(
                    Node.fork(fork_client, domain, name, **parameters.get(name, {})).kill
                )
        driver = stack.enter_context(contextlib.closing(Driver(domain)))
        needed = {PLANT_ODOM.name, GAMEPAD_JOY.name, OPERATING_STATE.name, DIAGNOSTICS.name}
        driver.spin_until(lambda: needed <= set(driver.newest))
        driver.spin_until(lambda: driver.newest[OPERATING_STATE.name].data == 'remote')
        yield driver


@pytest.fixture
def driver(graph):
    graph.await_rest()
    graph.seen.clear()
    return graph


def test_joy_drives_the_robot_forward_and_silence_stops_it(driver):
    start, _ = odometry_position(driver.newest[PLANT_ODOM.name])
    with driver.sending('joy', joy(forward=1.0), qos_profile_sensor_data):
        driver.await_command('joy', (-100, 0))
        driver.spin_until(
            lambda: odometry_position(driver.newest[PLANT_ODOM.name])[0] > start + 0.05
        )
    # test_arbiter.py tests how long a silence counts as driving.
    driver.spin_until(lambda: driver.sticks == (0, 0))


def test_a_stamped_cmd_vel_drives(driver):
    velocity = twist(0.0862, -10.0 * 0.0862)
    with driver.sending('cmd_vel', TwistStamped(twist=velocity)):
        driver.await_command('cmd_vel', (-10, 100))


def test_cmd_vel_that_is_not_finite_stops_the_robot_and_is_reported(driver):
    with driver.sending('cmd_vel', twist(1.0)):
        driver.await_command('cmd_vel', (-100, 0))
    with driver.sending('cmd_vel', twist(math.nan)):
        driver.spin_until(lambda: driver.sticks == (0, 0))
        driver.spin_until(lambda: driver.status().level == DiagnosticStatus.WARN)
        assert driver.status().message == 'cmd_vel: linear.x is nan, not a finite number'
        assert {v.key: v.value for v in driver.status().values}['in command'] in (
            'cmd_vel',
            NO_SOURCE,
        )
    with driver.sending('cmd_vel', twist()):
        driver.spin_until(lambda: driver.status().level == DiagnosticStatus.OK)


def test_priorities_over_topics(driver):
    with driver.sending('cmd_vel', twist(1.0)):
        driver.await_command('cmd_vel', (-100, 0))
        with driver.sending('viewer/joy', joy(left=1.0)):
            driver.await_command('viewer', (0, -100))
            with driver.sending('joy', joy(forward=-1.0)):
                driver.await_command('joy', (100, 0))
            driver.await_command('viewer', (0, -100))
        # test_arbiter.py tests that the sticks rest before each change to a lower priority.
        driver.await_command('cmd_vel', (-100, 0))


def test_a_repeated_request_for_a_tick_gets_the_same_sticks(domain, start_node):
    """This holds back to the oldest tick that the recorder may lack."""
    start_node(GAMEPAD, device="''")
    with contextlib.closing(Client(domain)) as client:
        client.watch(GAMEPAD_JOY, depth=10)
        client.publish(ROLL_CALL, lambda: header(FIRST_TICK_NS, '1 a'))
        stick = itertools.count(1)
        client.publish(JOY, lambda: joy(forward=next(stick) % 100 / 100.0), period_s=0.01)
        plant = client.node.create_publisher(Odometry, PLANT_SLOW_ODOM.name, 10)
        answers = client.seen[GAMEPAD_JOY.name] = []

        def ask(stamp):
            answers.clear()
            while stamp not in map(stamp_ns, answers):
                plant.publish(Odometry(header=header(stamp)))
                client.executor.spin_once(timeout_sec=0.1)
            return sticks_of(answers[-1])

        stamps = itertools.count(FIRST_TICK_NS, SLOW_PERIOD_NS)
        asked = deque(maxlen=MAX_LEAD_TICKS * TICK_NS // SLOW_PERIOD_NS + 1)
        while len(asked) < asked.maxlen or len({sticks for _, sticks in asked}) == 1:
            stamp = next(stamps)
            asked.append((stamp, ask(stamp)))
        assert [(stamp, ask(stamp)) for stamp, _ in asked] == list(asked)


class Recorded(Scenario):
    """The sticks of a recording."""

    def __init__(self, sticks):
        super().__init__()
        object.__setattr__(self, '_sticks', sticks)

    def sticks_at(self, time):
        return self._sticks[round(time * 1e9)]


def test_the_recorded_sticks_give_the_same_duties_again(domain, start_run, tmp_path):
    run = start_run('stationary', '--json', '--output', tmp_path, '--real-time-factor', 2,
                    '--set=plant_sim.duration=5', '--set=gyro_driver.noise=0.7')  # fmt: skip
    with contextlib.closing(Client(domain)) as client:
        publisher = client.node.create_publisher(Joy, 'joy', 10)
        stick = itertools.count()
        client.node.create_timer(
            0.01, lambda: publisher.publish(joy(math.sin(next(stick) / 7), math.cos(next(stick))))
        )
        client.spin_until(lambda: run.process.poll() is not None)
    assert run.finish() in (0, 1), run.stderr
    assert run.result['ticks'] == 1250, run.result['reason']
    with RecordingReader(tmp_path / 'stationary.mcap') as reader:
        assert reader.complete
        messages = list(reader.messages({'/gamepad'}))
        assert reader.topics()['/joy'].message_count > 50
        # Other programs stamp joy messages by another clock, or not at all.
        stamps = [stamp for _, stamp, _ in reader.messages({'/joy'})]
    assert 1e9 <= min(stamps) <= max(stamps) <= 6e9
    assert 'joy' in {message.header.frame_id for _, _, message in messages}
    assert len({sticks_of(message) for _, _, message in messages}) > 20
    sticks = {stamp - 1_000_000_000: sticks_of(message) for _, stamp, message in messages}

    parameters = ParameterSet()
    parameters.update(load_scenario('stationary').parameters)
    parameters.set('gyro_driver', 'noise', 0.7)
    loop, log = ClosedLoop(parameters, Recorded(sticks)), TrajectoryLog()
    for _ in range(1250):
        tick = loop.tick()
        log.add(tick.truth, *tick.outputs.duty)
    assert log.duty_sha256 == run.result['duty_sha256']


def test_a_keyboard_without_a_terminal_is_a_mistake(start_node):
    node = start_node(GAMEPAD, keyboard='true')
    assert node.finish() == 2
    assert node.output == 'error: keyboard: standard input and output are not a terminal\n'


def test_list_devices_reports_that_none_was_found():
    pytest.importorskip('pygame')
    found = subprocess.check_output([*BALLBOT, 'drive', '--list-devices'])
    assert found == b'no gamepad found\n'
