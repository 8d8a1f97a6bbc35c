"""Setting the parameters of a running node."""

import contextlib
import gc
from dataclasses import replace
from types import SimpleNamespace

import pytest
from own_controllers import BALANCE

pytest.importorskip('rclpy')

import rclpy
from rclpy.clock import ClockType
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Header

from ballbot_ros.controllers.document.axis import task_timings
from ballbot_ros.errors import BallbotError
from ballbot_ros.nodes.node_parameters import NEXT_RUN
from ballbot_ros.nodes.registry import REGISTRY
from ballbot_ros.nodes.teleop.terminal import KeyboardSticks
from ballbot_ros.parameters import (
    ALL_NODES,
    CONTROLLER,
    GAMEPAD,
    GYRO,
    NODES,
    PLANT,
    RECORDER,
    SONAR,
    GyroParameters,
    TakesEffect,
    parameters_of,
)
from ballbot_ros.recording.messages.topics import PLANT_SLOW_ODOM, SONAR_RANGE

pytestmark = pytest.mark.graph

VALUES = {
    PLANT: {'timeout': 3},
    GYRO: {'noise': 1},
    SONAR: {'map': 'track'},
    CONTROLLER: {'k_f': [0, -1, 0, 0]},
    GAMEPAD: {'device': ''},
}


@pytest.fixture
def make(domain, monkeypatch, tmp_path):
    """Create nodes in this process, until the end of the test."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    monkeypatch.chdir(tmp_path)
    with contextlib.ExitStack() as stack:

        def make(role, arguments=(), **values):
            rclpy.init(args=['--ros-args', *arguments] if arguments else [])
            stack.callback(rclpy.try_shutdown)
            entry = REGISTRY[role]
            node = entry.maker(None if arguments else entry.parameters(**values))
            stack.callback(node.destroy_node)
            stack.callback(node.close)
            return node

        yield make
    gc.collect()  # a traceback keeps a node alive whose creation failed


def set_one(node, name, value):
    return node.set_parameters([Parameter(name, value=value)])[0]


@pytest.mark.parametrize('role', NODES)
def test_a_node_takes_its_own_dump(make, role):
    node = make(role, **VALUES.get(role, {}))
    names = [*node.list_parameters([], 10).names, 'use_sim_time', 'start_type_description_service']
    dump = node.get_parameters(sorted({*names}))
    assert {each.name for each in dump} >= set(parameters_of(node.role))
    # Convert the parameters as a service does.
    sent = [Parameter.from_parameter_msg(each.to_parameter_msg()) for each in dump]
    for parameter, result in zip(dump, node.set_parameters(sent), strict=True):
        assert result.successful, (parameter.name, result.reason)


@pytest.mark.parametrize('role', NODES)
def test_every_parameter_takes_effect_as_the_table_says(make, role):
    node = make(role, **VALUES.get(role, {}))
    for name, row in parameters_of(node.role).items():
        value = another(row, getattr(node.parameters, name))
        if value is None:
            continue
        before = getattr(node.parameters, name)
        result = set_one(node, name, value)
        if row.takes_effect is TakesEffect.READ_ONLY:
            assert not result.successful
            assert 'read-only' in result.reason
            continue
        assert result.successful, (name, result.reason)
        at_once = row.takes_effect is TakesEffect.IMMEDIATELY
        assert getattr(node.parameters, name) == (row.check(value, '') if at_once else before)
        assert ('takes effect in the next run' in result.reason) == (not at_once)
        assert set_one(node, name, list(before) if isinstance(before, tuple) else before).successful


OTHER_TEXTS = {
    'map': 'corridor',
    'scenario': 'square',
    'output': 'x.mcap',
    'attachments': '.',
}


def another(row, value):
    """Return another allowed value, for parameters that need no file or device."""
    if isinstance(value, bool):
        return None if row.name == 'keyboard' else not value
    if row.choices:
        others = [each for each in row.choices if each not in (value, 'arm', 'c')]
        return others[0] if others else None
    if isinstance(value, str):
        return OTHER_TEXTS.get(row.name)
    if isinstance(value, tuple):
        return [each / 2 for each in value]
    if row.name == 'cone_rays':
        return 9
    low, high = row.bounds
    half = type(row.default)(value / 2)
    return half if half != value and half >= low else high


def test_parameters_of_the_next_run_take_effect_together(make):
    node = make(GYRO)
    assert set_one(node, 'noise', 2.5).successful
    assert set_one(node, 'seed', 7).successful
    assert (node.parameters.noise, node.parameters.seed) == (0.0, 1)
    node.apply_parameters()
    assert (node.parameters.noise, node.parameters.seed) == (2.5, 7)


def test_if_one_of_several_values_is_refused_none_is_set(make):
    node = make(PLANT)
    pair = [Parameter('push_duration', value=0.5), Parameter('real_time_factor', value=1e-4)]
    result = node.set_parameters_atomically(pair)
    assert not result.successful
    assert result.reason == 'plant_sim.real_time_factor: 0.0001 is not within 0 or 0.01 … 1000'
    assert node.parameters.push_duration == 0.1
    assert node.get_parameter('push_duration').value == 0.1


REFUSED = {
    PLANT: [
        ('map', 'nowhere', 'unknown map'),
        ('scenario', 'nothing', 'unknown scenario'),
        ('gravity', 'much', 'not a number'),
        ('gravity', True, 'not a number'),
        ('gravity', -1.0, 'not within 0 … 100 m/s²'),
        ('real_time_factor', -1, 'not within 0 or 0.01 … 1000'),
        ('lockstep', False, 'read-only'),
    ],
    SONAR: [('cone_rays', 4, 'even'), ('map', 'nowhere', 'unknown map')],
    GAMEPAD: [
        ('scenario', 'nothing', 'unknown scenario'),
        ('keyboard', True, 'keyboard'),
    ],
    CONTROLLER: [
        ('k_f', [1.0, 2.0], 'not a list of 4 numbers'),
        ('ts2_period', 5, 'not one of 4, 20, 100'),
        ('use_sim_time', False, 'timers run on /clock'),
    ],
    RECORDER: [('output', 'other.mcap', 'read-only')],
}


@pytest.mark.parametrize('role', REFUSED)
def test_an_impossible_value_is_refused_with_the_reason(make, role):
    node = make(role)
    for name, value, words in REFUSED[role]:
        result = set_one(node, name, value)
        assert not result.successful, (name, value)
        assert words in result.reason, (name, value)
        assert '\n' not in result.reason, (name, value)


def test_an_unknown_parameter_is_refused(make):
    with pytest.raises(BallbotError, match="gyro_driver has no parameter 'nois'; "):
        make(GYRO, ['-p', 'nois:=1.0'])


def test_the_qos_of_a_topic_is_a_parameter_of_every_node(make):
    make(GYRO, ['-p', 'qos_overrides./gyro.publisher.depth:=5'])


def test_an_integer_is_accepted_for_a_float(make):
    node = make(PLANT, duration=4)
    assert node.parameters.duration == 4.0
    assert set_one(node, 'real_time_factor', 1).successful
    assert node.get_parameter('real_time_factor').value == 1.0
    assert type(node.parameters.real_time_factor) is float
    assert set_one(node, 'real_time_factor', 0).successful


def test_a_number_that_yaml_reads_as_text_is_accepted_for_a_float(make):
    node = make(PLANT)
    assert set_one(node, 'motor_inertia', '2e-05').successful
    assert node.get_parameter('motor_inertia').value == 2e-5
    assert not set_one(node, 'motor_inertia', 'nan').successful
    assert not set_one(node, 'map', '1e-05').successful


def test_an_integer_is_accepted_for_a_float_on_the_command_line(make):
    node = make(GYRO, ['-p', 'noise:=1'])
    assert node.parameters.noise == 1.0


def test_parameters_can_be_set_while_the_keyboard_drives(make):
    node = make(GAMEPAD)
    # While the panel is up, standard output is a pipe.
    node.parameters = node._requested = replace(node.parameters, keyboard=True)
    assert set_one(node, 'gp_max', 50).successful
    node.terminal = SimpleNamespace(keys=KeyboardSticks(100), close=lambda: None)
    node._display = node.terminal
    node.apply_parameters()
    assert node.terminal.keys.full == 50


def test_in_lockstep_the_controller_requires_sim_time(make):
    with pytest.raises(BallbotError, match='use_sim_time: false: in lockstep'):
        make(CONTROLLER, ['-p', 'use_sim_time:=false'])


def test_free_running_it_may_have_another_clock(make):
    node = make(CONTROLLER, ['-p', 'use_sim_time:=false', '-p', 'lockstep:=false'])
    assert node.get_parameter('use_sim_time').value is False
    assert set_one(node, 'use_sim_time', True).successful


def test_the_clock_is_sim_time_by_default(make):
    node = make(CONTROLLER)
    assert node.get_parameter('use_sim_time').value is True
    assert node.get_clock().ros_time_is_active


def test_a_node_on_sim_time_has_timers_on_the_wall_clock(make):
    """For example, it reports its diagnostics while the plant is paused."""
    timer = make(CONTROLLER).create_wall_timer(1.0, print)
    assert timer.clock.clock_type is ClockType.STEADY_TIME


@pytest.mark.parametrize('role', [PLANT, GYRO, CONTROLLER])
def test_a_renamed_node_keeps_its_role_and_parameters(make, role):
    node = make(role, ['-r', '__node:=another', '-r', '__ns:=/robot'])
    assert node.get_fully_qualified_name() == '/robot/another'
    assert node.role in ALL_NODES
    assert not set_one(node, next(iter(parameters_of(node.role))), 'none').successful
    for name, value in node.parameters.values().items():
        assert set_one(node, name, list(value) if isinstance(value, tuple) else value).successful


def test_a_node_with_given_values_ignores_the_arguments_of_its_process(make):
    make(CONTROLLER, ['-r', '__node:=another'])
    node = REGISTRY[GYRO].maker(REGISTRY[GYRO].parameters(noise=0.5))
    assert (node.get_name(), node.parameters.noise) == (GYRO, 0.5)
    node.destroy_node()


def test_a_sample_has_the_parameters_of_its_run(make):
    node = make(SONAR)
    samples = []
    node._output = SimpleNamespace(publish=samples.append)
    truth = PLANT_SLOW_ODOM.message_class()
    truth.header.stamp.sec = 1
    for run in ('1 abc', '2 abc'):
        node._participation._on_roll_call(Header(frame_id=run, stamp=truth.header.stamp))
        node._on_truth(PLANT_SLOW_ODOM, serialize_message(truth))
        assert set_one(node, 'cone_angle', 0.5).successful
    ranges = [deserialize_message(each, SONAR_RANGE.message_class) for each in samples]
    assert [each.field_of_view for each in ranges] == [0.0, 0.5]


def test_a_task_with_another_period_has_another_timer(make):
    node = make(CONTROLLER)
    assert set_one(node, 'ts2_period', 100).successful
    node.apply_parameters()
    timers = node._task_timers._timers
    periods_ms = {name: each.timer_period_ns / 1e6 for name, each in timers.items()}
    tasks = task_timings(100, node.parameters.ts3_period)
    assert periods_ms == {task.name: task.period_ms for task in tasks if task.period_ms}


@pytest.fixture
def own_controller(tmp_path):
    """Return the arguments of a node whose controller's class is in a file."""
    file = tmp_path / 'mine.py'
    file.write_text(BALANCE)
    return ['-p', f'implementation:={file}:Balance']


def test_a_users_controller_has_its_own_parameters(make, own_controller):
    node = make(CONTROLLER, [*own_controller, '-p', 'user.rate:=2.0', '-p', 'model.gravity:=9'])
    names = node.list_parameters([], 10).names
    assert {'user.rate', 'user.pitch', 'model.gravity', 'model.body_mass'} <= set(names)
    assert node.get_parameter('user.rate').value == 2.0
    assert node.get_parameter('model.gravity').value == 9.0
    descriptor = node.describe_parameter('user.rate')
    assert descriptor.description == 'gain of the rate of the body pitch [%·s/deg]'
    assert descriptor.floating_point_range[0].to_value == 10.0

    assert NEXT_RUN in set_one(node, 'user.rate', 3).reason
    assert node.parameters.values()['user.rate'] == 2.0
    node.apply_parameters()
    assert node.parameters.values()['user.rate'] == 3.0
    refused = set_one(node, 'user.rate', 11.0)
    assert (refused.successful, refused.reason) == (
        False,
        'controller.user.rate: 11.0 is not within 0 … 10 %·s/deg',
    )
    dump = node.get_parameters(names)
    sent = [Parameter.from_parameter_msg(each.to_parameter_msg()) for each in dump]
    assert all(result.successful for result in node.set_parameters(sent))


@pytest.mark.parametrize('other', [True, False], ids=['to python', 'from python'])
def test_a_running_node_keeps_its_controller(make, own_controller, other):
    reference = own_controller[1].partition(':=')[2]
    node = make(CONTROLLER, own_controller if other else ())
    wanted = 'python' if other else reference
    result = set_one(node, 'implementation', wanted)
    assert not result.successful
    assert f'takes another node: start it with -p implementation:={wanted}' in result.reason


@pytest.mark.parametrize(
    ('arguments', 'told'),
    [
        (['-p', 'user.speeed:=1.0'], "controller has no parameter 'user.speeed'; did you"),
        (['-p', 'user.speed:=11.0'], 'controller.user.speed: 11.0 is not within 0 … 10 %·s/deg'),
        (['-p', 'user.speed:=fast'], "controller.user.speed: 'fast' is not a number"),
    ],
)  # fmt: skip
def test_a_node_refuses_own_parameters_that_are_not_allowed(make, own_controller, arguments, told):
    with pytest.raises(BallbotError) as raised:
        make(CONTROLLER, [*own_controller, *arguments])
    assert told in str(raised.value)


def test_own_parameters_of_the_controller_do_not_disturb_other_nodes(make):
    assert make(GYRO, ['-p', 'user.speed:=1.0']).parameters == GyroParameters()


def test_a_node_without_a_design_says_how_to_get_it(make, tmp_path):
    file = tmp_path / 'mine.py'
    file.write_text(
        BALANCE.replace('import TICK_S,', 'import designed, TICK_S,').replace(
            'class Gains:\n',
            "class Gains:\n    gain: tuple[float, ...] = designed('1', None, '')\n",
        )
    )
    arguments = ['-p', f'implementation:={file}:Balance']
    told = r'controller\.user\.gain: not designed: the commands run and drive and the launch file'
    with pytest.raises(BallbotError, match=told):
        make(CONTROLLER, arguments)
    rclpy.try_shutdown()
    node = make(CONTROLLER, [*arguments, '-p', 'user.gain:=[1.0, 2.0, 3.0]'])
    assert node.parameters.values()['user.gain'] == (1.0, 2.0, 3.0)
    assert set_one(node, 'user.gain', [4.0]).successful


def test_values_that_take_effect_at_once_are_checked_with_those_still_in_effect(make, tmp_path):
    """The values of the next run would be allowed; those of the rest of this run are not."""
    file = tmp_path / 'own.py'
    file.write_text(
        """
from dataclasses import dataclass
from ballbot_ros.controllers import Controller, TakesEffect, quantity

@dataclass(frozen=True)
class Limits:
    gain: float = quantity(1.0, '1', (0.0, 9.0), 'x', takes_effect=TakesEffect.IMMEDIATELY)
    limit: float = quantity(2.0, '1', (0.0, 9.0), 'its largest value')

    def __post_init__(self):
        if self.gain > self.limit:
            raise ValueError('gain above limit')

class Own(Controller[Limits]):
    def tick(self, readings):
        return 0, 0
"""
    )
    node = make(CONTROLLER, implementation=f'{file}:Own')
    assert set_one(node, 'user.limit', 8.0).reason == NEXT_RUN
    result = set_one(node, 'user.gain', 7.0)
    assert not result.successful
    assert 'gain above limit' in result.reason
    assert set_one(node, 'user.gain', 2.0).successful
    assert dict(node.parameters.own)['user.gain'] == 2.0
    node.apply_parameters()
    assert set_one(node, 'user.gain', 7.0).successful


def test_an_unknown_name_is_refused_with_the_known_ones(make):
    result = set_one(make(CONTROLLER), 'k_y', 1.0)
    assert not result.successful
    assert "controller has no parameter 'k_y'; did you mean k_f or k_i?" in result.reason


def test_faults_take_effect_in_the_present_run_and_end_with_it(make):
    node = make(GYRO)
    assert set_one(node, 'faults', 'gyro_y off').reason == NEXT_RUN
    assert set_one(node, 'faults', 'gyro_z off').reason.startswith(
        "gyro_driver.faults: 'gyro_z' is"
    )
    node.start_ns = 1_000_000_000
    node.apply_parameters()
    node.now_ns = 3_200_000_000
    answer = set_one(node, 'faults', 'gyro_x off')
    assert (answer.successful, answer.reason) == (True, '')
    text = 'gyro_y off duration=2.208; gyro_x off time=2.208'
    assert node.get_parameter('faults').value == node.parameters.faults == text
    refused = set_one(node, 'faults', 'gyro_x off time=1')
    reason = 'gyro_driver.faults: gyro_x off time=1: can begin only from 2.208 s on'
    assert (refused.successful, refused.reason) == (False, reason)
    assert node.get_parameter('faults').value == text
    node.apply_parameters()
    assert node.get_parameter('faults').value == node.parameters.faults == 'gyro_y off'


@pytest.mark.parametrize('role', [PLANT, SONAR, GAMEPAD, CONTROLLER])
def test_faults_begin_after_the_next_sample(make, role):
    node = make(role, **{**VALUES[role], **({'kernel': True} if role == CONTROLLER else {})})
    component = {PLANT: 'motor_x weak', SONAR: 'sonar off', GAMEPAD: 'gamepad off'}
    fault = component.get(role, 'task_ts1 slow')
    node.start_ns = 1_000_000_000
    period = {SONAR: 0.02, GAMEPAD: 0.02}.get(role, 0.004)
    for now_ns, next_sample in ((0, 0.0), (1_000_000_000, period), (2_000_000_000, 1.0 + period)):
        node.now_ns = now_ns
        answer = set_one(node, 'faults', f'{fault} time=9')
        assert answer.successful, answer.reason
        assert set_one(node, 'faults', f'{fault} duration=1').successful
        begins = round(next_sample + period, 3)
        assert node.parameters.faults.endswith(f'{fault} time={begins} duration=1')
        assert 'time=9' not in node.parameters.faults
