"""The robot's duties do not depend on the order of its messages, on delays or on timers."""

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule
from lockstep_world import DRIVERS, ROLES
from parts import steps
from pushes import pushes
from robot_world import RobotWorld

from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.engine.trajectory import TrajectoryLog
from ballbot_ros.parameters import CONTROLLER, GYRO, PLANT, ParameterSet
from ballbot_ros.parameters.timing import TICK_NS

TICKS = 500
SCENARIO = Scenario(
    vertical=steps((0.0, 0), (0.3, -60), (0.5, 40)),
    horizontal=steps((0.0, 0), (0.4, 100)),
    pushes=pushes(0.35, 0.05, 0.5, -0.3),
)
TASKS = ('task_ts1', 'task_ts2', 'task_ts3', 'task_lcd')


def parameters_of_runs(ticks, **plant):
    """Noisy devices, a robot that leans, and a short calibration."""
    parameters = ParameterSet()
    parameters.set(PLANT, 'start_pitch_x', 0.04)
    parameters.set(GYRO, 'noise', 0.7)
    parameters.set(CONTROLLER, 'time_start', 200)
    changes = {'hold_time': 0.2, 'battery_model': 'draining', 'real_time_factor': 0.0, **plant}
    for name, value in {'duration': ticks * TICK_NS * 1e-9, **changes}.items():
        parameters.set(PLANT, name, value)
    return parameters


def undisturbed_sha256(parameters, ticks):
    """Return the hash of the duties of the loop without messages."""
    loop, log = ClosedLoop(parameters, SCENARIO), TrajectoryLog()
    for _ in range(ticks):
        tick = loop.tick()
        log.add(tick.truth, *tick.outputs.duty)
    return log.duty_sha256


@pytest.mark.parametrize('seed', range(2))
def test_messages_in_any_order_give_the_duties_of_the_loop(seed):
    world = RobotWorld(parameters_of_runs(TICKS), SCENARIO, seed).start()
    world.wait(60)
    assert world.summary.ticks == TICKS
    assert world.summary.duty_sha256 == undisturbed_sha256(world.parameter_set, TICKS)


@pytest.mark.parametrize('role', DRIVERS)
def test_a_restarted_driver_changes_no_duty(role):
    world = RobotWorld(parameters_of_runs(TICKS, timeout=60.0), SCENARIO).start()
    for ticks in (100, 203):
        world.advance(ticks)
        world.kill(role)
        world.wait(1.0)
        world.start(role, generation=ticks)
    world.wait(60)
    assert world.summary.ticks == TICKS
    assert world.summary.duty_sha256 == undisturbed_sha256(world.parameter_set, TICKS)


@pytest.mark.parametrize('seed', range(2))
def test_a_restarted_driver_continues_with_the_same_dead_times(seed):
    parameters = parameters_of_runs(TICKS, actuator_delay=1, actuator_delay_jitter=3, timeout=60.0)
    for node, delay, jitter in (('gyro', 2, 4), ('encoder', 3, 0), ('sonar', 20, 90)):
        parameters.set(f'{node}_driver', 'delay', delay)
        parameters.set(f'{node}_driver', 'delay_jitter', jitter)
    expected = undisturbed_sha256(parameters, TICKS)
    assert expected != undisturbed_sha256(parameters_of_runs(TICKS), TICKS)
    world = RobotWorld(parameters, SCENARIO, seed).start()
    for generation, role in enumerate(DRIVERS, 1):
        world.advance(100)
        world.kill(role)
        world.wait(1.0)
        world.start(role, generation=generation)
    world.wait(60)
    assert world.summary.duty_sha256 == expected


@pytest.mark.parametrize('lost', ['on_duty', 'on_clock', 'on_truth', 'on_sample', 'on_timer'])
def test_a_lost_message_is_repeated(lost):
    """The answer to a message is repeated, too, by the node that has given it."""
    world = RobotWorld(parameters_of_runs(TICKS), SCENARIO).start()
    for ticks in (10, 105, 330):
        world.advance(ticks)
        while not (ways := [event.__name__ for event, _ in world.in_flight]).count(lost):
            assert world.deliver()
        del world.in_flight[ways.index(lost)]
    world.wait(60)
    assert world.summary.ticks == TICKS
    assert world.summary.duty_sha256 == undisturbed_sha256(world.parameter_set, TICKS)


@pytest.mark.parametrize('task', TASKS)
def test_a_tick_waits_for_a_lost_callback_until_the_plant_asks_again(task):
    world = RobotWorld(parameters_of_runs(TICKS), SCENARIO).start()
    world.advance(10)
    brick = world.robot[CONTROLLER]
    before = world.master.resends, brick.forced
    brick.dropped.add(task)
    world.wait(60)
    assert (world.master.resends, brick.forced) == (before[0] + 1, before[1] + 1)
    assert world.summary.duty_sha256 == undisturbed_sha256(world.parameter_set, TICKS)


class TroubledRobot(RuleBasedStateMachine):
    """A robot with delayed messages, nodes that hang and are replaced, and failing timers.

    Nevertheless no duty changes; and once the faults end, the run completes.
    """

    TICKS = 150

    def __init__(self):
        super().__init__()
        parameters = parameters_of_runs(
            self.TICKS, on_timeout='wait', timeout=1.0, startup_timeout=1.0
        )
        self.world = RobotWorld(parameters, SCENARIO).start()
        self.generation = 0

    @property
    def brick(self):
        return self.world.robot[CONTROLLER]

    @rule(ticks=st.integers(1, 20))
    def go_on(self, ticks):
        for _ in range(10 * ticks):
            self.world.deliver()

    @rule(seconds=st.sampled_from([0.004, 0.05, 0.1, 0.35, 1.5]))
    def wait(self, seconds):
        self.world.wait(seconds)

    @rule(role=st.sampled_from(ROLES))
    def hang(self, role):
        self.world.nodes[role].is_hung = True

    @rule(role=st.sampled_from(ROLES))
    def come_back(self, role):
        self.world.nodes[role].is_hung = False

    @rule(role=st.sampled_from(DRIVERS))
    def replace(self, role):
        self.generation += 1
        self.world.leave(role)
        # If the replacement were faster than the roll calls, the two nodes would count as
        # duplicates.
        self.world.wait(1.0)
        self.world.start(role, generation=self.generation)

    @rule(task=st.sampled_from(TASKS))
    def drop_a_callback(self, task):
        self.brick.dropped.add(task)

    @rule(task=st.sampled_from(TASKS))
    def call_back_twice(self, task):
        self.brick.release(task)

    @rule(task=st.sampled_from(TASKS))
    def shift_a_timer(self, task):
        self.brick.shift(task)

    @rule(data=st.data())
    def lose_a_message(self, data):
        in_flight = self.world.in_flight
        if in_flight:
            del in_flight[data.draw(st.integers(0, len(in_flight) - 1))]

    @rule(is_paused=st.booleans())
    def pause(self, is_paused):
        self.world.dispatch(self.world.master.set_paused, is_paused=is_paused)

    @rule()
    def step(self):
        self.world.dispatch(self.world.master.step)

    def teardown(self):
        world = self.world
        for node in world.nodes.values():
            node.is_hung = False
        world.dispatch(world.master.set_paused, is_paused=False)
        world.wait(120)
        assert world.summary.outcome == 'completed'
        assert world.summary.duty_sha256 == undisturbed_sha256(world.parameter_set, self.TICKS)


TestTroubledRobot = TroubledRobot.TestCase
TestTroubledRobot.settings = settings(max_examples=40, stateful_step_count=30, deadline=None)
