"""The master of a run on the wall clock, which waits for no participant."""

import hashlib

import pytest
from lockstep_world import FREE_PERIODS_S, LockstepWorld, data_of, make_participant

from ballbot_ros.engine.trajectory import TrajectoryLog
from ballbot_ros.lockstep import run_actions as do
from ballbot_ros.lockstep.free_running import FreeRunningMaster
from ballbot_ros.lockstep.participants import Announcement, Objection, Publisher
from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.parameters import CONTROLLER, GYRO
from ballbot_ros.parameters.timing import FREE_RUNNING_SILENCE_S, TICK_NS, TICK_S
from ballbot_ros.robot.brick.brick import MotorDuty
from ballbot_ros.robot.plant.ground_truth import STEP_VALUES

START_NS = 1_000_000_000


class FreeRunningWorld(LockstepWorld):
    """A world with a tick every 4 ms."""

    kind = FreeRunningMaster
    periods_s = FREE_PERIODS_S


def begun(**values):
    """Return a world whose endless run has been announced."""
    return FreeRunningWorld(duration=0.0, **values).wait(0.2)


def send_duty(world, duty=(10, -20), stamp_ns=START_NS):
    duty = duty and MotorDuty(*duty)
    world.dispatch(world.master.on_duty, stamp_ns, duty, data_of(stamp_ns, duty))


def test_it_waits_for_the_first_duty_and_asks_for_it_repeatedly():
    world = begun(startup_timeout=5.0)
    assert world.truths == [START_NS]
    world.wait(3)
    assert world.ticks == 0
    assert len([each for each in world.actions(do.PublishTruth) if each.is_resend]) > 20
    for is_paused in (True, False):
        world.dispatch(world.master.set_paused, is_paused=is_paused)
    world.wait(1)
    assert world.ticks == 0
    send_duty(world)
    world.wait(1)
    assert world.ticks == pytest.approx(250, abs=2)
    assert world.master.state()['late ticks'] == 0


def test_without_a_controller_it_begins_after_the_startup_timeout_with_motors_off():
    world = begun(startup_timeout=5.0).wait(4.5)
    assert world.ticks == 0
    world.wait(1)
    assert world.ticks > 100
    assert world.summary is None
    assert world.master.log.duty_sha256 == hashlib.sha256(bytes(2 * world.ticks)).hexdigest()


def test_a_newer_duty_acts_and_a_silence_switches_off():
    world = begun()
    send_duty(world)
    world.wait(1.0)
    world.dispatch(world.master.stop)
    sha256 = world.summary.duty_sha256
    other = begun()
    send_duty(other)
    other.wait(FREE_RUNNING_SILENCE_S + 0.1)
    send_duty(other)
    other.wait(1.0 - FREE_RUNNING_SILENCE_S - 0.1)
    other.dispatch(other.master.stop)
    assert other.summary.ticks == world.summary.ticks
    assert other.summary.duty_sha256 != sha256


def test_an_invalid_duty_or_one_of_an_earlier_run_is_ignored():
    world = begun()
    send_duty(world, None)
    send_duty(world, stamp_ns=START_NS - TICK_NS)
    world.wait(1)
    assert world.ticks == 0
    assert 'duty ignored: not whole numbers within' in world.logged[-1]


def test_it_completes_and_keeps_its_pace():
    world = FreeRunningWorld(duration=1.0).wait(0.6)
    send_duty(world)
    world.wait(2)
    assert (world.summary.outcome, world.summary.ticks) == ('completed', 250)
    assert world.summary.real_time_factor == pytest.approx(1.0, rel=0.02)
    assert world.summary.late_ticks == 0


def test_a_tick_that_is_more_than_a_period_late_is_counted():
    for factor in (0.5, 1.0, 4.0):
        for periods, late_ticks in ((1.9, 0), (2.1, 1), (20.0, 1)):
            world = begun(real_time_factor=factor)
            send_duty(world)
            world.dispatch(world.master.on_tick)
            world.now_s += periods * TICK_S / factor
            world.dispatch(world.master.on_tick)
            assert world.master.state()['late ticks'] == late_ticks, (factor, periods)


def test_a_paused_plant_makes_single_steps_and_no_tick_is_late():
    world = begun()
    send_duty(world)
    world.wait(0.1)
    world.dispatch(world.master.set_paused, is_paused=True)
    ticks = world.ticks
    world.done.clear()
    world.wait(3)
    assert world.ticks == ticks
    repeated = [each.is_resend for each in world.actions(do.PublishTruth)]
    assert repeated == [True] * 2, 'for late subscribers'
    world.dispatch(world.master.step)
    world.wait(1)
    assert world.ticks == ticks + 1
    world.dispatch(world.master.set_paused, is_paused=False)
    world.wait(0.1)
    assert world.ticks > ticks + 20
    assert world.master.state()['late ticks'] == 0


def test_only_a_standing_robot_is_shown_again():
    world = begun()
    send_duty(world)
    world.wait(0.1)
    world.done.clear()
    world.wait(3)
    assert not any(each.is_resend for each in world.actions(do.PublishTruth))


def test_a_stranger_neither_holds_a_run_nor_causes_a_warning():
    world = begun()
    send_duty(world)
    world.graph.strangers['gyro'] = [Publisher(b'stranger', '/stranger')]
    world.wait(10)
    assert world.ticks > 2400
    assert world.warnings == []


def test_a_run_ends_only_when_a_stranger_has_left():
    world = FreeRunningWorld(duration=1.0).wait(0.2)
    send_duty(world)
    world.graph.strangers['gyro'] = [Publisher(b'stranger', '/stranger')]
    world.wait(3)
    assert (world.ticks, world.summary) == (250, None)
    del world.graph.strangers['gyro']
    assert world.wait(0.2).summary.outcome == 'completed'


def test_a_run_waits_for_no_participant():
    world = begun(require_recorder=True)
    send_duty(world)
    assert world.wait(0.1).ticks > 20


def test_the_truth_has_the_steps_of_a_driver_that_comes_late():
    world = begun()
    send_duty(world)
    world.wait(0.3)
    world.start(GYRO, parameters={'delay': 3}).wait(0.3)
    steps = [len(each.truth.steps) // STEP_VALUES for each in world.actions(do.PublishTruth)]
    assert steps == sorted(steps)
    assert set(steps) == {0, 4}


def test_a_reset_waits_for_a_duty_of_the_new_run():
    world = begun(startup_timeout=5.0)
    send_duty(world)
    world.wait(10)
    now_ns = world.truths[-1]
    world.dispatch(world.master.reset)
    start_ns = world.truths[-1]
    assert start_ns > now_ns
    world.wait(1)
    assert world.ticks == 0
    send_duty(world, stamp_ns=start_ns)
    world.wait(0.1)
    assert world.ticks > 20


def test_it_does_not_wait_for_a_recorder():
    world = begun()
    send_duty(world)
    world.dispatch(world.master.on_ack, START_NS)
    world.dispatch(world.master.on_ack, 10**18)
    world.wait(1)
    assert world.ticks > 200
    assert world.summary is None


def test_a_pause_is_no_silence_of_the_controller():
    world = begun()
    send_duty(world)
    world.wait(0.1)
    world.dispatch(world.master.set_paused, is_paused=True)
    world.wait(10 * FREE_RUNNING_SILENCE_S)
    world.dispatch(world.master.set_paused, is_paused=False)
    world.wait(0.1)
    log = TrajectoryLog(keep=False)
    for _ in range(world.ticks):
        log.add(None, 10, -20)
    assert world.master.log.duty_sha256 == log.duty_sha256


@pytest.mark.parametrize(
    ('role', 'objection', 'fails'),
    [
        (CONTROLLER, Objection('mine.py:3: KeyError'), True),
        (GYRO, Objection('broken'), False),
        (CONTROLLER, Objection.to_sample('gyro', START_NS), False),
    ],
)
def test_a_controller_that_can_not_continue_ends_the_run(role, objection, fails):
    world = begun()
    send_duty(world)
    world.wait(0.1)
    (call,) = {each.run.name for each in world.actions(do.CallRoll)}
    announcement = Announcement(make_participant(role), call, START_NS, objection)
    world.dispatch(world.master.on_announcement, announcement)
    world.wait(0.1)
    assert (world.summary is not None) == fails
    if fails:
        assert (world.summary.outcome, world.summary.reason) == (
            Outcome.FAILED,
            f'controller: {objection.text}',
        )
