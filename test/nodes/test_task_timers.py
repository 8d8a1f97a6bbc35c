"""The timers of the controller, with some of their callbacks manipulated."""

import math
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

import rclpy
from rclpy.clock import ClockType, ROSClock
from rclpy.time import Time
from std_srvs.srv import Trigger

from ballbot_ros.controllers.document.axis import TASK_TS1
from ballbot_ros.engine.golden import duty_sha256
from ballbot_ros.engine.scenario.reader import load_scenario
from ballbot_ros.engine.trajectory import load_trajectory
from ballbot_ros.lockstep import lockstep_master
from ballbot_ros.nodes.controller import ControllerNode, TaskTimers
from ballbot_ros.nodes.plant_sim import OneShotTimer
from ballbot_ros.parameters import CONTROLLER, NODES, PLANT, RECORDER, PlantParameters
from ballbot_ros.parameters.timing import FIRST_TICK_NS, MILLISECOND_NS, TICK_NS
from ballbot_ros.recording.messages.topics import DIAGNOSTICS, PLANT_IMU
from ballbot_ros.run import one_process
from ballbot_ros.run.execution import execute
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.spec import RunOptions, RunSpec

pytestmark = pytest.mark.graph

TS2 = 'task_ts2'
DURATION_S = 2.0
DROPPED_NS = FIRST_TICK_NS + 1_200 * MILLISECOND_NS
LATE_S = 0.01


def test_a_one_shot_timer_calls_back_once_after_each_start():
    calls = []

    class Timer:
        timer_period_ns = 0

        def reset(self):
            calls.append(self.timer_period_ns)

        def cancel(self):
            calls.append('cancelled')

    def create_timer(period_s, callback, *, clock, autostart):
        calls.append((clock.clock_type, autostart))
        node.fire = callback
        return Timer()

    node = SimpleNamespace(create_timer=create_timer)
    timer = OneShotTimer(node, lambda: calls.append('called'))
    assert calls == [(ClockType.STEADY_TIME, False)]
    for delay_s, period_ns in ((0.25, 250_000_000), (0.0, 1)):
        calls.clear()
        timer.start(delay_s)
        node.fire()
        timer.cancel()
        assert calls == [period_ns, 'cancelled', 'called', 'cancelled']


def test_the_timers_of_other_tasks_replace_those_before():
    made, fired = {}, []

    def create_timer(period_s, callback, *, clock, autostart):
        calls = []
        timer = SimpleNamespace(
            calls=calls, fire=callback, reset=lambda: calls.append('reset'),
            cancel=lambda: calls.append('cancelled'),
        )  # fmt: skip
        made[round(period_s * 1e3), clock, autostart] = timer
        return timer

    node = SimpleNamespace(
        create_timer=create_timer, destroy_timer=lambda timer: timer.calls.append('destroyed')
    )
    timers = TaskTimers(node, 'clock', fired.append, ticking=TASK_TS1)
    timers.set([(TASK_TS1, 1, 4), (TS2, 2, 20), ('background', 3, 0)])
    first, second = made[4, 'clock', True], made[20, 'clock', False]
    assert len(made) == 2
    for timer in (first, second):
        timer.fire()
    assert fired == [TASK_TS1, TS2]
    timers.stop()
    timers.restart([TASK_TS1])
    assert (first.calls, second.calls) == (['reset'], ['cancelled'])
    timers.set([(TASK_TS1, 1, 4)])
    assert first.calls[-1] == second.calls[-1] == 'destroyed'


@pytest.fixture
def context():
    context = rclpy.Context()
    rclpy.init(context=context)
    yield context
    context.try_shutdown()


def test_timers_without_an_executor_are_polled(context):
    clock = ROSClock()
    node = SimpleNamespace(default_callback_group=None, context=context)
    fired = []
    timers = TaskTimers(node, clock, fired.append, ticking='')
    timers.set([(TASK_TS1, 1, 4), (TS2, 2, 20)])
    clock._set_ros_time_is_active(True)
    for tick in range(1, 12):
        clock.set_ros_time_override(Time(nanoseconds=tick * TICK_NS, clock_type=ClockType.ROS_TIME))
        if tick == 1:
            timers.restart([TASK_TS1, TS2])
        timers.poll()
        timers.poll()  # a second look finds nothing
    assert fired == [*[TASK_TS1] * 5, TS2, *[TASK_TS1] * 5, TS2]
    timers.stop()
    clock.set_ros_time_override(Time(nanoseconds=20 * TICK_NS, clock_type=ClockType.ROS_TIME))
    timers.poll()
    assert len(fired) == 12
    timers.set([])


class Tampered(ControllerNode):
    """A controller with unchanged timers, which keeps its diagnostics when it closes."""

    def now(self):
        return self.get_clock().now().nanoseconds

    def close(self):
        type(self).counts = self.diagnose()
        super().close()


class Doubled(Tampered):
    def _on_timer(self, task):
        super()._on_timer(task)
        super()._on_timer(task)


class AtEveryTick(Tampered):
    """The callback of task_ts2 also runs off its schedule."""

    def _on_timer(self, task):
        if task == TASK_TS1:
            super()._on_timer(TS2)
        super()._on_timer(task)
        if task == TASK_TS1:
            super()._on_timer(TS2)


class Late(Tampered):
    """The callback of task_ts2 runs late, by the wall clock."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self._later = OneShotTimer(self, lambda: super(Late, self)._on_timer(TS2))

    def _on_timer(self, task):
        if task == TS2:
            self._later.start(LATE_S)
        else:
            super()._on_timer(task)


class DroppedOnce(Tampered):
    def _on_timer(self, task):
        if (task, self.now()) != (TS2, DROPPED_NS):
            super()._on_timer(task)


class ATickTooLate(DroppedOnce):
    def _on_timer(self, task):
        if task == TASK_TS1 and self.now() == DROPPED_NS + 4 * MILLISECOND_NS:
            super()._on_timer(TS2)
        super()._on_timer(task)


@pytest.fixture(scope='module')
def expected_sha256():
    scenario = load_scenario('stationary')
    scenario.parameters.set(PLANT, 'duration', DURATION_S)
    return duty_sha256(scenario)


@pytest.mark.parametrize(
    ('kind', 'forced'),
    [(Tampered, 0), (Doubled, 0), (AtEveryTick, 0), (Late, 0), (DroppedOnce, 1), (ATickTooLate, 1)],
    ids=lambda value: getattr(value, '__name__', str(value)),
)
def test_the_duties_do_not_depend_on_the_timers(domain, monkeypatch, expected_sha256, kind, forced):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    monkeypatch.setattr(one_process, 'ControllerNode', kind)
    if kind is Late:
        # On a busy machine the callback may come later than any limit. The plant would then ask
        # again, and the controller rightly make the release good.
        monkeypatch.setattr(lockstep_master, 'RESEND_S', math.inf)
    options = RunOptions(
        processes=Processes.ONE, record=False, assignments=(f'plant_sim.duration={DURATION_S}',)
    )
    result = execute(RunSpec.of_scenario('stationary', options))
    assert result.ticks == round(DURATION_S * 250), result.reason
    assert result.duty_sha256 == expected_sha256
    assert kind.counts['forced releases'] == forced
    # The plant has to ask again for each tick whose timers omit a release.
    assert result.resends >= forced


def test_the_timers_are_in_phase_with_every_run_of_a_lasting_controller(
    client, start_node, tmp_path, expected_sha256
):
    client.watch(DIAGNOSTICS, depth=100)
    for name in NODES:
        if name not in (PLANT, RECORDER):
            start_node(name)
    start_pitch = load_scenario('stationary').parameters.of(PlantParameters).start_pitch_x
    # The timer of the display has a period of 500 ms, and runs begin at multiples of 100 ms.
    for number, resets_ms in enumerate(([], [112, 350], [220])):
        path = tmp_path / f'{number}.npz'
        client.newest.clear()
        plant = start_node(
            PLANT,
            duration=DURATION_S,
            start_pitch_x=start_pitch,
            # Slow until the last reset: a run at full speed may end before the request arrives.
            real_time_factor=0.2 if resets_ms else 0.0,
            timeout=60.0,
            trajectory_file=path,
        )
        for reset_ms in resets_ms:
            client.spin_until(lambda: PLANT_IMU.name in client.newest, what='the run')
            reset_ns = client.now_ns() + reset_ms * MILLISECOND_NS
            client.spin_until(lambda reset_ns=reset_ns: client.now_ns() > reset_ns)
            assert client.call(Trigger, 'plant_sim/reset', Trigger.Request()).success
        if resets_ms:
            assert client.set_value(PLANT, 'real_time_factor', 0.0).successful
        assert plant.finish() == 0, plant.output
        assert load_trajectory(path)[1]['duty_sha256'] == expected_sha256
        assert client.await_diagnosis(CONTROLLER, 'forced releases') == '0'
