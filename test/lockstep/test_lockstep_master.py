"""The master of a run in lockstep: tables of events, and runs with random faults."""

from dataclasses import replace

import lockstep_world
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule
from lockstep_world import (
    DRIVERS,
    ROLES,
    TOPICS,
    WATCH_S,
    FakeNode,
    LockstepWorld,
    data_of,
    duty_of,
    make_participant,
)
from maps import open_floor, save

from ballbot_ros.engine.trajectory import TrajectoryLog
from ballbot_ros.lockstep import run_actions as do
from ballbot_ros.lockstep.lockstep import RunIdentity
from ballbot_ros.lockstep.lockstep_master import LockstepMaster
from ballbot_ros.lockstep.participants import Announcement, LocalNode, Objection, Publisher
from ballbot_ros.lockstep.run_actions import Outcome, ParameterChange
from ballbot_ros.lockstep.run_master import DISCOVERY_POLL_S, DISCOVERY_S
from ballbot_ros.parameters import COMMON_PERIOD_NS, CONTROLLER, GYRO, PLANT, RECORDER, SONAR
from ballbot_ros.parameters.timing import MAX_LEAD_TICKS, TICK_NS, next_start_ns
from ballbot_ros.robot.brick.brick import MotorDuty
from ballbot_ros.robot.brick.fault_effects import fault_row
from ballbot_ros.robot.brick.faults import faults_of
from ballbot_ros.robot.plant.ground_truth import STEP_VALUES

START_NS = 1_000_000_000
ENDLESS = 0.0
TIMEOUT_S = 2.0
"""The default of `timeout`."""
STARTUP_S = 30.0
"""The default of `startup_timeout`."""


def duties_sha256(ticks, start_ns=START_NS):
    log = TrajectoryLog(keep=False)
    for tick in range(ticks):
        log.add(None, *duty_of(start_ns + tick * TICK_NS))
    return log.duty_sha256


def begun(ticks=0, **values):
    """Return a world whose endless run has done some ticks."""
    world = LockstepWorld(duration=ENDLESS, **values).start()
    while not world.truths:
        world.deliver() or world.wait()
    return world.advance(ticks)


def recorded(ticks=10, **values):
    """Return a world with a recorder, whose endless run has done some ticks."""
    return LockstepWorld(duration=ENDLESS, **values).start(*ROLES, RECORDER).advance(ticks)


# The beginning and the end


@pytest.mark.parametrize('ticks', [1, 2, 50])
@pytest.mark.parametrize('more', [(), (RECORDER,)])
def test_a_run_completes_with_a_tick_for_each_duty(ticks, more):
    world = LockstepWorld(duration=ticks * 0.004).start(*ROLES, *more).wait(3)
    assert (world.summary.outcome, world.summary.reason) == ('completed', '')
    assert world.summary.ticks == ticks
    assert world.summary.duty_sha256 == duties_sha256(ticks)
    assert world.truths == [START_NS + tick * TICK_NS for tick in range(ticks)]
    assert world.summary.resends == 0
    assert world.warnings == []
    ended = world.actions(do.EndRun)
    assert [each.exit_status for each in ended] == [0]
    assert world.actions(do.StopMotors) == []


def test_the_run_begins_when_all_have_joined_in_any_order():
    for first in range(len(ROLES)):
        world = LockstepWorld()
        for role in (*ROLES[first:], *ROLES[:first]):
            assert world.wait(0.6).truths == []
            world.start(role)
        world.wait(1)
        assert world.summary.outcome == 'completed'
        assert world.summary.duty_sha256 == duties_sha256(50)


def test_an_announcement_is_processed_at_once():
    world = LockstepWorld(duration=ENDLESS).start(*DRIVERS).wait(1)
    assert world.truths == []
    world.start(CONTROLLER)
    node = world.nodes[CONTROLLER]
    node.run = world.actions(do.AnnounceRun)[-1].run.name
    world.dispatch(world.master.on_announcement, node.announcement())
    assert world.truths == [START_NS]


@pytest.mark.parametrize('missing', ROLES)
def test_a_missing_participant_is_named(missing):
    world = LockstepWorld(startup_timeout=5.0).start(*(role for role in ROLES if role != missing))
    world.wait(5)
    assert world.summary is None
    assert f'run 1 waits for {missing}' in world.logged
    world.wait(1.2)
    assert world.summary.reason == f'{missing} silent for 5 s before the first tick'
    assert world.summary.outcome == 'failed'


def test_with_on_timeout_wait_it_waits_for_a_missing_participant():
    world = LockstepWorld(startup_timeout=5.0, on_timeout='wait').start(*DRIVERS).wait(60)
    assert world.summary is None
    assert set(world.warnings) == {'waiting for controller'}
    world.start(CONTROLLER).wait(1)
    assert world.summary.outcome == 'completed'
    assert len(world.actions(do.ClearWarning)) == 1


def test_the_run_waits_for_a_required_recorder():
    world = LockstepWorld(require_recorder=True).start().wait(2)
    assert world.truths == []
    world.start(RECORDER).wait(1)
    assert world.summary.outcome == 'completed'


def test_the_first_run_is_announced_once_all_participants_are_discovered():
    world = LockstepWorld()
    world.graph.complete = False
    world.start().wait(0.5)
    assert world.done == [do.WakeIn(DISCOVERY_POLL_S)] * len(world.done)
    world.graph.complete = True
    world.wait(DISCOVERY_POLL_S)
    assert len(world.actions(do.AnnounceRun)) == 1
    world.wait(1)
    assert world.summary.outcome == 'completed'


def test_it_is_announced_without_them_after_a_time():
    world = LockstepWorld()
    world.graph.complete = False
    world.start().wait(DISCOVERY_S - DISCOVERY_POLL_S)
    assert world.actions(do.AnnounceRun) == []
    world.wait(WATCH_S)
    assert len(world.actions(do.AnnounceRun)) == 1
    assert 'on_wake' not in world.calls_s


def test_the_first_run_waits_for_a_present_node_that_has_not_joined():
    world = LockstepWorld().start()
    leftover = make_participant(CONTROLLER, generation=1)
    world.graph.present = {leftover.instance: LocalNode(CONTROLLER, leftover.process)}
    world.wait(STARTUP_S - 1)
    assert world.truths == []
    run = world.actions(do.AnnounceRun)[-1].run.name
    world.dispatch(world.master.on_announcement, Announcement(leftover, run))
    assert world.summary is None
    world.nodes['leftover'] = FakeNode(leftover, run=run)
    world.wait(1)
    assert world.truths == []
    assert "two nodes publish on 'motor_duty' as controller" in world.summary.reason


def test_it_begins_when_that_node_ends():
    world = LockstepWorld().start()
    world.graph.present = {'leftover': LocalNode(CONTROLLER, 4711)}
    world.wait(1)
    assert world.truths == []
    world.graph.present = {}
    world.wait(1)
    assert world.summary.outcome == 'completed'


def test_it_fails_if_that_node_does_neither():
    world = LockstepWorld().start()
    world.graph.present = {'leftover': LocalNode(CONTROLLER, 4711)}
    world.wait(STARTUP_S + 1)
    assert world.truths == []
    assert world.summary.reason == (
        'controller (process 4711) silent for 30 s before the first tick'
    )


def test_a_run_waits_for_the_nodes_of_its_command_even_if_leftover_nodes_have_every_role():
    world = LockstepWorld().start()
    own = make_participant(CONTROLLER, generation=1)
    world.process_observer.started = [LocalNode(CONTROLLER, own.process)]
    world.wait(STARTUP_S - 1)
    assert world.truths == []
    world.nodes['own'] = FakeNode(own)
    world.wait(1)
    assert world.truths == []
    assert "two nodes publish on 'motor_duty' as controller" in world.summary.reason


def test_a_node_of_the_command_that_is_replaced_in_mid_run_is_not_awaited():
    world = begun(ticks=3)
    driver = world.nodes[GYRO].participant
    world.process_observer.started = [LocalNode(GYRO, driver.process)]
    world.nodes[GYRO].is_hung = True
    world.wait(0.5)
    ticks = len(world.truths)
    world.nodes['hung'] = world.nodes.pop(GYRO)
    world.start(GYRO, generation=1).wait(2)
    assert len(world.truths) > ticks


def test_a_later_run_does_not_wait_for_present_nodes():
    world = LockstepWorld(duration=ENDLESS).start().wait(1)
    begun = len(world.truths)
    assert begun
    world.graph.present = {'newcomer': LocalNode(CONTROLLER, 4711)}
    world.dispatch(world.master.reset)
    world.wait(1)
    assert len(world.truths) > begun


@pytest.mark.parametrize('complete', [False, True])
def test_another_plant_discovered_before_the_first_run_ends_this_one(complete):
    world = LockstepWorld()
    world.graph.complete = False
    world.start().wait(WATCH_S)
    world.graph.clocks = 2
    world.graph.complete = complete
    world.wait(DISCOVERY_POLL_S)
    assert world.summary.reason == 'another plant publishes /clock in this ROS domain'
    assert [each.exit_status for each in world.actions(do.EndRun)] == [2]
    assert world.actions(do.AnnounceRun) == []


def test_another_plant_discovered_before_the_first_tick_ends_this_one():
    world = LockstepWorld().wait(0.5)
    world.graph.clocks = 2
    world.wait(WATCH_S)
    assert world.summary.reason == 'another plant publishes /clock in this ROS domain'


def test_it_can_be_stopped_before_its_run():
    world = LockstepWorld()
    world.graph.complete = False
    world.start().wait(WATCH_S)
    world.dispatch(world.master.stop)
    world.graph.complete = True
    world.wait(2)
    assert world.summary.outcome == 'stopped'
    assert world.actions(do.AnnounceRun) == []


@pytest.mark.parametrize('name', ['7 other', '1 other', 'nonsense'])
def test_the_run_of_another_plant_ends_ours(name):
    world = begun()
    world.dispatch(world.master.on_run, name, 'plant/run')
    world.wait(2)
    assert world.summary.reason.startswith(f'another run, {name!r}, is announced on ')


def test_an_earlier_run_of_our_own_does_not_count_as_another_plants():
    world = begun()
    world.dispatch(world.master.on_run, '0 token', 'plant/run')
    world.wait(1).advance(100)
    assert world.summary is None


def test_a_stopped_plant_stops_the_motors():
    world = begun(10)
    last_ns = world.truths[-1]
    world.dispatch(world.master.stop)
    assert [each.last_ns for each in world.actions(do.StopMotors)] == [last_ns]
    assert (world.summary.outcome, world.summary.ticks) == ('stopped', 10)
    before = list(world.done)
    world.wait(5)
    for event in (world.master.reset, world.master.stop, world.master.step):
        world.dispatch(event)
    assert world.done == before


def test_a_wall_ends_the_run_and_the_robot_is_shown_at_it(monkeypatch):
    monkeypatch.setattr(lockstep_world, 'duty_of', lambda stamp_ns: (100, 0))
    world = begun(map='track', start_position_x=0.8, hold_time=0.0).wait(3)
    assert world.summary.outcome == 'failed'
    assert world.summary.reason.startswith('wall hit at sim time 1.316 s')
    assert world.ticks > 70
    assert world.truths[-1] == START_NS + world.ticks * TICK_NS
    assert world.actions(do.RaiseError) == [], 'it is the reason of the end'


def test_a_plant_that_need_not_wait_neither_reports_nor_warns():
    world = begun(7)
    world.done.clear()
    world.nodes[GYRO].is_hung = True
    world.wait(0.3)
    assert world.actions(do.Report) == world.warnings == []
    world = LockstepWorld().wait(4.9)
    assert world.warnings == []
    assert not world.graph.is_listening
    assert world.wait(0.5).warnings[0].startswith('waiting for gyro_driver')


# Duties


def test_a_repeated_duty_changes_nothing():
    world = begun(5)
    for stamp_ns in (world.truths[-1] - TICK_NS, world.truths[0]):
        duty = MotorDuty(*duty_of(stamp_ns))
        world.dispatch(world.master.on_duty, stamp_ns, duty, data_of(stamp_ns, duty))
    assert world.ticks == 5
    world.advance(20).wait(1)
    assert world.summary is None


@pytest.mark.parametrize('offset', [TICK_NS, 0, -TICK_NS, 10**12])
def test_a_conflicting_duty_or_one_ahead_ends_the_run(offset):
    world = begun(5)
    stamp_ns = world.truths[-1] + offset
    world.dispatch(world.master.on_duty, stamp_ns, MotorDuty(99, 99), b'another')
    world.wait(2)
    assert world.summary.outcome == 'failed'
    assert "'motor_duty' has a second duty stamped" in world.summary.reason


def test_an_invalid_duty_is_ignored():
    world = begun()
    world.in_flight.clear()
    world.dispatch(world.master.on_duty, START_NS, None, b'')
    assert world.ticks == 0
    assert 'duty ignored: not whole numbers within' in world.logged[-1]


@pytest.mark.parametrize(
    'before', ['run', 'first tick of this run'], ids=['before a run', 'of an earlier run']
)
def test_a_duty_of_no_tick_of_the_run_is_ignored(before):
    world = LockstepWorld() if before == 'run' else begun()
    world.dispatch(world.master.on_duty, START_NS - TICK_NS, MotorDuty(99, 99), b'another')
    world.start().wait(2)
    assert world.logged[-1].startswith('run 1 completed') or world.summary is None


def test_a_controller_that_leaves_switches_off_but_answers_no_tick():
    world = begun()
    world.in_flight.clear()
    world.dispatch(world.master.on_duty, START_NS, MotorDuty(0, 0), b'stop', is_stop=True)
    assert world.ticks == 0
    world.wait(1)
    assert world.summary is None
    assert world.ticks > 0


@pytest.mark.parametrize('lost', range(1, 7))
def test_a_lost_message_is_asked_for_again_after_100_ms(lost):
    world = LockstepWorld().start().advance(lost)
    world.in_flight.clear()
    at_s = world.now_s
    world.wait(0.3)
    assert world.summary.resends == 1
    assert world.now_s - at_s == pytest.approx(0.3)
    assert world.summary.duty_sha256 == duties_sha256(50)
    assert world.truths == [START_NS + tick * TICK_NS for tick in range(50)]


# Silence


@pytest.mark.parametrize('timeout', [0.2, 2.0, 5.0])
@pytest.mark.parametrize('is_hung', [True, False])
def test_only_the_silent_node_is_named_and_in_time(timeout, is_hung):
    for role in ROLES:
        world = begun(7, timeout=timeout)
        if is_hung:
            world.nodes[role].is_hung = True
        else:
            world.kill(role)
        since_s = world.now_s
        while world.summary is None:
            world.wait(0.1)
        assert world.summary.reason.startswith(f'{role} silent for {timeout:g} s at sim time ')
        assert timeout < world.now_s - since_s < timeout + 0.7, role


@pytest.mark.parametrize('role', ROLES)
def test_the_dead_node_is_named_not_the_nodes_that_wait_for_it(role):
    world = begun(7, timeout=0.2)
    for other in ROLES:
        world.nodes[other].is_hung = True
    world.kill(role)
    world.wait(1.0)
    assert world.summary.reason.startswith(f'{role} silent for 0.2 s at sim time ')


@pytest.mark.parametrize('role', ROLES)
def test_a_node_that_answers_with_a_wrong_stamp_is_named_with_it(role):
    # The node says, and believes, that it has answered.
    world = begun(5)
    world.nodes[role].late_ns = TICK_NS
    world.wait(4)
    topic = TOPICS.duty if role == CONTROLLER else world.nodes[role].participant.topics[0]
    now_ns = world.master.time_ns
    assert world.summary.reason == (
        f'{role} silent for 2 s at sim time {now_ns / 1e9:.3f} s: its newest {topic!r} is stamped '
        f'{(now_ns - TICK_NS) / 1e9:.3f} s'
    )


@pytest.mark.parametrize('stamp_ns', [0, START_NS - TICK_NS])
def test_a_duty_from_before_the_run_is_named_with_its_stamp(stamp_ns):
    world = LockstepWorld(duration=ENDLESS, startup_timeout=2.0)
    world.start()
    world.nodes[CONTROLLER].late_ns = START_NS - stamp_ns
    world.wait(9)
    assert world.summary.reason == (
        "controller silent for 2 s at sim time 1.000 s: its newest 'motor_duty' is stamped "
        f'{stamp_ns / 1e9:.3f} s'
    )


@pytest.mark.parametrize('late_ns', [TICK_NS, START_NS])
def test_a_recorder_that_acknowledges_too_little_is_named_not_the_drivers(late_ns):
    world = LockstepWorld(duration=ENDLESS, startup_timeout=2.0).start(*ROLES, RECORDER)
    world.nodes[RECORDER].late_ns = late_ns
    # As the project's own: its tick is done, so it awaits the next one, and the truths that are
    # sent again give it older samples.
    world.nodes[CONTROLLER].expects = {'gyro': START_NS}
    world.wait(9)
    assert world.summary.reason == (
        "recorder silent for 2 s at sim time 1.000 s: its newest 'recorder/ack' is stamped "
        f'{(START_NS - late_ns) / 1e9:.3f} s'
    )


def test_a_role_that_does_not_exist_is_told():
    world = LockstepWorld(duration=ENDLESS).start()
    participant = replace(make_participant(GYRO), role='gyro', instance='mine')
    world.dispatch(world.master.on_announcement, Announcement(participant, 'any'))
    assert world.actions(do.Log)[-1].text == (
        "/gyro_driver (process 2 on here) announces 'gyro', which is not a role"
    )


def test_only_a_controller_says_what_it_awaits():
    world = begun(5)
    world.nodes[SONAR].awaits = {'gyro': 77_000_000}
    world.nodes[SONAR].is_mute = True
    world.wait(4)
    assert world.summary.reason.startswith(f'{SONAR} silent for 2 s at sim time ')
    assert 'gyro' not in world.summary.reason


def test_what_a_node_awaited_before_it_hung_accuses_nobody():
    world = begun(5)
    world.nodes[GYRO].is_hung = True
    world.wait(1)
    assert world.nodes[CONTROLLER].awaits
    world.nodes[GYRO].is_hung = False
    world.nodes[CONTROLLER].is_hung = True
    world.wait(3)
    assert world.summary.reason == 'controller silent for 2 s at sim time 1.024 s'


@pytest.mark.parametrize('role', ROLES)
def test_with_on_timeout_wait_the_run_continues_when_the_node_returns(role):
    world = begun(7, on_timeout='wait')
    world.nodes[role].is_hung = True
    world.wait(10)
    ticks = world.ticks
    assert world.warnings[-1].startswith(f'{role} silent for 2 s at sim time ')
    assert world.warnings[-1].endswith('; still waiting')
    world.nodes[role].is_hung = False
    world.wait(0.3)
    assert world.ticks > ticks
    assert isinstance(world.done[-1], do.PublishTruth) or world.actions(do.ClearWarning)


def test_a_silence_shorter_than_the_timeout_does_not_end_the_run():
    world = begun(7)
    for role in ROLES:
        world.nodes[role].is_hung = True
        world.wait(TIMEOUT_S - 0.1)
        world.nodes[role].is_hung = False
        ticks = world.ticks
        world.wait(0.4)
        assert world.ticks > ticks
    assert world.summary is None


def test_a_waiting_plant_keeps_reporting():
    world = begun(7, on_timeout='wait', timeout=3600.0)
    world.nodes[GYRO].is_hung = True
    world.wait(5)
    before = len(world.actions(do.Report))
    world.wait(5)
    assert len(world.actions(do.Report)) - before == 50


# Participants


@pytest.mark.parametrize(
    ('announced', 'steps'),
    [
        ({}, 0),
        ({'delay': 0, 'delay_jitter': 0}, 0),
        ({'delay': 7}, 8),
        ({'delay_jitter': 5.0}, 6),
        ({'delay': 100, 'delay_jitter': 100}, 201),
    ],
)
def test_the_truth_has_the_steps_for_the_announced_dead_times(announced, steps):
    world = LockstepWorld(duration=ENDLESS).start(*(role for role in ROLES if role != GYRO))
    world.start(GYRO, parameters=announced)
    for _ in range(2):
        world.wait().advance(3)
        sizes = {len(each.truth.steps) for each in world.actions(do.PublishTruth)}
        assert sizes == {steps * STEP_VALUES}
        world.dispatch(world.master.reset)


@pytest.mark.parametrize('name', ['delay', 'delay_jitter'])
@pytest.mark.parametrize('value', [-1, 101, 1.5, 'long', None, True, [4], {'ms': 4}])
def test_an_impossible_dead_time_is_refused(name, value):
    world = LockstepWorld().start(*(role for role in ROLES if role != GYRO))
    world.start(GYRO, parameters={name: value}).wait(1)
    assert world.truths == []
    assert world.summary.reason.startswith(f'/gyro_driver (process 2 on here) announces {name}: ')
    assert '\n' not in world.summary.reason


def test_a_delay_of_another_role_is_its_own_affair():
    world = LockstepWorld(duration=ENDLESS).start(*(role for role in ROLES if role != CONTROLLER))
    world.start(CONTROLLER, parameters={'delay': 'long'}).advance(2)
    assert world.ticks == 2
    assert world.actions(do.PublishTruth)[-1].truth.steps == ()


def test_a_restarted_controller_fails_the_run_at_its_end():
    world = LockstepWorld(duration=0.4).start().advance(7)
    world.kill(CONTROLLER)
    world.start(CONTROLLER, generation=1)
    world.wait(5)
    assert world.summary.outcome == 'failed'
    assert world.summary.reason.endswith(' restarted at 0.032 s of the run')
    assert [each.exit_status for each in world.actions(do.EndRun)] == [1]


def test_a_stranger_holds_the_run_and_is_refused_at_its_first_message():
    world = begun(7)
    world.graph.strangers['gyro'] = [Publisher(b'stranger', '/stranger')]
    world.wait(0.2)
    ticks = world.ticks
    world.wait(1.0)
    assert world.ticks == ticks
    assert world.graph.is_listening
    world.graph.heard_messages = [('gyro', 10**18)]
    world.wait(1.0)
    assert world.summary.reason == "/stranger publishes on 'gyro', but takes no part in the run"


def test_a_held_run_continues_when_the_stranger_leaves():
    world = begun(7)
    world.graph.strangers['gyro'] = [Publisher(b'stranger', '/stranger')]
    world.wait(1.0)
    ticks = world.ticks
    assert world.warnings[-1] == "waiting for /stranger on 'gyro' to join the run or to leave"
    del world.graph.strangers['gyro']
    world.wait(0.3)
    assert world.ticks > ticks
    assert not world.graph.is_listening
    assert world.summary is None


@pytest.mark.parametrize('has_duty', [True, False])
def test_a_held_run_continues_with_its_duty_or_asks_for_it(has_duty):
    world = begun(7)
    world.graph.strangers['gyro'] = [Publisher(b'stranger', '/stranger')]
    if not has_duty:
        world.in_flight.clear()
    world.wait(1.0)
    del world.graph.strangers['gyro']
    world.done.clear()
    world.dispatch(world.master.on_time)
    assert [each.is_resend for each in world.actions(do.PublishTruth)] == [not has_duty]


def ended_by_a_stranger(hung):
    """Return a world in which a stranger has answered the last tick, and has left again."""
    world = LockstepWorld(duration=10 * TICK_NS * 1e-9).start().advance(9)
    world.in_flight.clear()
    for role in {hung, CONTROLLER}:
        world.nodes[role].samples.remove(world.truths[-1])
    world.nodes[hung].is_hung = True
    world.graph.strangers['motor_duty'] = [Publisher(b'stranger', '/stranger')]
    world.wait(0.2)
    world.dispatch(world.master.on_duty, world.truths[-1], MotorDuty(99, 99), b'another')
    del world.graph.strangers['motor_duty']
    world.wait(1.0)
    assert (world.ticks, world.summary) == (10, None)
    return world


def test_the_last_tick_counts_only_if_the_controller_has_answered_it():
    """Its answer contradicts what a stranger has sent in the meantime."""
    world = ended_by_a_stranger(hung=GYRO)
    world.nodes[GYRO].is_hung = False
    problem = "/stranger publishes on 'motor_duty', but takes no part in the run"
    assert world.wait(1.0).summary.reason == problem


@pytest.mark.parametrize('hung', [GYRO, CONTROLLER])
def test_who_keeps_the_controller_from_answering_the_last_tick_is_named(hung):
    world = ended_by_a_stranger(hung)
    reason = world.wait(TIMEOUT_S).summary.reason
    assert reason.startswith(f'{hung} silent for 2 s')
    assert reason.endswith(": /stranger publishes on 'motor_duty', but takes no part in the run")


def test_only_who_has_not_sent_the_last_sample_is_named():
    """The controller has used the stranger's, and awaits the samples of a tick that never comes."""
    world = LockstepWorld(duration=10 * TICK_NS * 1e-9).start().advance(9)
    world.nodes[GYRO].samples.remove(world.truths[-1])
    world.nodes[GYRO].is_mute = True
    world.nodes[CONTROLLER].expects = {'gyro': None, 'joint_states': world.truths[-1]}
    world.graph.strangers['gyro'] = [Publisher(b'stranger', '/stranger')]
    world.wait(0.2)
    del world.graph.strangers['gyro']
    assert world.wait(TIMEOUT_S + 1.0).summary.reason == (
        'gyro_driver silent for 2 s at sim time 1.040 s: '
        "/stranger publishes on 'gyro', but takes no part in the run"
    )


def test_a_controller_that_replaces_one_after_the_last_tick_is_named_at_once():
    """It cannot repeat the answer that the recorder lacks."""
    world = LockstepWorld(duration=10 * TICK_NS * 1e-9).start(*ROLES, RECORDER).advance(9)
    world.nodes[RECORDER].is_hung = True
    world.advance(10)
    world.kill(CONTROLLER)
    world.start(CONTROLLER, generation=1)
    reason = world.wait(1.0).summary.reason
    assert reason == f'{world.nodes[CONTROLLER].participant} restarted at 0.040 s of the run'


def test_a_stranger_that_has_done_nothing_does_not_keep_a_run_from_ending():
    world = LockstepWorld().start().advance(9)
    world.graph.strangers['motor_duty'] = [Publisher(b'stranger', '/stranger')]
    world.wait(0.2)
    del world.graph.strangers['motor_duty']
    assert world.wait(1.0).summary.outcome == 'completed'


def test_a_hold_is_no_silence_of_the_recorder():
    world = recorded(10)
    world.nodes[RECORDER].is_hung = True
    world.settle()
    world.graph.strangers['gyro'] = [Publisher(b'stranger', '/stranger')]
    world.wait(5 * TIMEOUT_S)
    del world.graph.strangers['gyro']
    world.wait(TIMEOUT_S / 2)
    assert world.summary is None
    world.nodes[RECORDER].is_hung = False
    ticks = world.ticks
    assert world.wait(0.5).ticks > ticks


@pytest.mark.parametrize(
    ('text', 'told'),
    [
        ('broken', 'broken'),
        ('', 'it cannot continue'),
        ('on\nfire', 'on fire'),
        ('gyro_driver is full', 'is full'),
    ],
)
def test_an_objection_ends_the_run_in_one_line_that_names_its_role(text, told):
    world = begun(7)
    node = world.nodes[GYRO]
    node.objection = Objection(text)
    world.dispatch(world.master.on_announcement, node.announcement())
    world.wait(0.2)
    name, _, reason = world.summary.reason.partition(' ')
    assert (name.rstrip(':'), reason) == (GYRO, told)


# The recorder


def test_the_run_does_not_wait_for_a_recorder_that_has_left():
    world = recorded(10)
    world.leave(RECORDER)
    world.wait(1)
    assert 'the recorder has left the run' in world.logged
    assert world.ticks > 100


def test_a_required_recorder_may_not_leave():
    world = recorded(10, require_recorder=True)
    world.leave(RECORDER)
    world.wait(3)
    assert world.summary.reason.startswith('recorder silent for 2 s')


def complete_with_a_recorder_that_hangs(world):
    """Hang the recorder until all ticks are done; the run ends only when it has the last one."""
    world.nodes[RECORDER].is_hung = True
    world.wait(1.0)
    assert (world.ticks, world.summary) == (50, None)
    world.nodes[RECORDER].is_hung = False
    world.wait(0.5)
    assert (world.summary.outcome, world.ticks) == ('completed', 50)


def test_a_run_ends_only_when_its_last_tick_is_recorded():
    world = LockstepWorld().start(*ROLES, RECORDER)
    complete_with_a_recorder_that_hangs(world.advance(40))


@pytest.mark.parametrize('meanwhile', ['is paused', 'waits for a duty'])
@pytest.mark.parametrize('ticks', range(1, 7))
def test_a_recorder_may_join_while_the_plant(meanwhile, ticks):
    world = LockstepWorld(timeout=60.0).start().advance(ticks)
    if meanwhile == 'is paused':
        world.dispatch(world.master.set_paused, is_paused=True)
    else:
        world.nodes[GYRO].is_hung = True
    world.wait(1.0)
    stopped_ns = world.truths[-1]
    world.start(RECORDER).wait(1.0)
    assert world.nodes[RECORDER].run
    assert world.truths[-1] == stopped_ns
    world.dispatch(world.master.set_paused, is_paused=False)
    world.nodes[GYRO].is_hung = False
    world.wait(1.0)
    assert world.summary.outcome == 'completed'
    first_ns = -(-stopped_ns // COMMON_PERIOD_NS) * COMMON_PERIOD_NS
    recorded = {stamp_ns for stamp_ns in world.nodes[RECORDER].samples if stamp_ns >= first_ns}
    assert recorded == {stamp_ns for stamp_ns in world.truths if stamp_ns >= first_ns}


def test_an_ack_ahead_of_the_run_ends_it():
    world = recorded(10)
    world.dispatch(world.master.on_ack, world.truths[-1] + TICK_NS)
    world.wait(1)
    assert "'recorder/ack' is ahead of the run" in world.summary.reason


def test_ticks_that_the_recorder_lacks_are_requested_before_the_newest():
    world = recorded(10)
    recorder = world.nodes[RECORDER]
    recorder.is_hung = True
    acked_ns = max(recorder.samples)
    world.settle()
    world.wait(0.3)
    asked = [each.truth.stamp_ns for each in world.actions(do.ResendToDrivers)]
    assert asked[0] == acked_ns + TICK_NS


# Pause, step, pace, reset, pushes


def test_a_paused_plant_keeps_the_duty_and_runs_single_steps():
    world = begun(7)
    world.dispatch(world.master.set_paused, is_paused=True)
    world.wait(0.1)
    ticks = world.ticks
    world.wait(10)
    assert (world.ticks, world.summary) == (ticks, None)
    for step in range(1, 4):
        world.dispatch(world.master.step)
        world.wait(0.1)
        assert world.ticks == ticks + step
    world.dispatch(world.master.set_paused, is_paused=False)
    assert world.ticks == ticks + 4
    world.wait(0.1)
    assert world.ticks > ticks + 10
    assert [text for text in world.logged if text in ('paused', 'resumed')] == ['paused', 'resumed']


def test_a_run_that_starts_paused_waits_at_its_first_tick():
    """Its participants join and answer, nobody counts as silent, and the duties are the same."""
    world = LockstepWorld(start_paused=True).start(*ROLES, RECORDER)
    world.wait(1000)
    assert world.master.pause.awaits_start
    assert set(world.truths) == {START_NS}
    assert (world.ticks, world.summary, world.warnings) == (0, None, [])
    world.dispatch(world.master.start)
    assert world.ticks == 1
    world.wait()
    unpaused = LockstepWorld().start(*ROLES, RECORDER).wait(10)
    assert world.summary.outcome is Outcome.COMPLETED
    assert world.summary.duty_sha256 == unpaused.summary.duty_sha256
    assert world.summary.real_time_factor > 1.0


@pytest.mark.parametrize(
    ('earlier', 'details', 'starts'),
    [
        (None, {}, True),
        ('reset', {}, True),
        ('start', {}, False),
        ('set_paused', {'is_paused': True}, False),
        ('set_paused', {'is_paused': False}, False),
        ('step', {}, False),
        ('stop', {}, False),
    ],
)
def test_only_the_pause_at_the_start_is_ended_by_a_start(earlier, details, starts):
    """A pause that a user has asked for must not end because another page is opened."""
    world = LockstepWorld(start_paused=True, duration=ENDLESS).start().wait(1)
    if earlier:
        world.dispatch(getattr(world.master, earlier), **details)
        world.wait(1)
    ticks = world.ticks
    assert (do.Log('started') in world.dispatch(world.master.start)) == starts
    assert (world.ticks > ticks) == starts


def test_a_change_of_the_pause_or_the_pace_is_reported_at_once():
    world = LockstepWorld(start_paused=True, duration=ENDLESS).start().wait(1)
    assert do.Report() in world.dispatch(world.master.start)
    for is_paused in (True, False):
        assert do.Report() in world.dispatch(world.master.set_paused, is_paused=is_paused)
    assert do.Report() in world.dispatch(world.master.on_parameters, world.parameters)


def test_the_state_of_a_run():
    world = begun(3, real_time_factor=0.0)
    world.dispatch(world.master.set_paused, is_paused=True)
    state = world.master.state()
    assert state.pop('run name').startswith('1 ')
    assert state == {
        'run': 1, 'sim time [s]': '1.012', 'ticks': 3, 'late ticks': 0, 'resends': 0,
        'fallen': False, 'paused': True, 'awaits start': False, 'pace': 0.0, 'missing': '',
    }  # fmt: skip


def test_a_plant_that_gathers_says_for_whom_it_waits():
    world = LockstepWorld(duration=ENDLESS).start(*DRIVERS).wait(1)
    assert world.master.state()['missing'] == CONTROLLER
    world.start(CONTROLLER).wait(1)
    assert world.ticks
    assert world.master.state()['missing'] == ''


@pytest.mark.parametrize('event', [LockstepMaster.step, LockstepMaster.set_paused])
def test_a_run_that_ended_in_a_pause_stays_ended(event):
    world = begun(7)
    world.dispatch(world.master.set_paused, is_paused=True)
    world.wait(0.1)
    ticks = world.ticks
    world.dispatch(world.master.stop)
    details = {'is_paused': False} if event is LockstepMaster.set_paused else {}
    assert event(world.master, world.now_s, **details) == []
    assert world.ticks == ticks


def test_a_single_step_does_not_wait_for_its_time():
    world = begun(3, real_time_factor=0.01)
    world.dispatch(world.master.set_paused, is_paused=True)
    world.wait(1.0)
    ticks = world.ticks
    for step in range(1, 4):
        world.settle()
        world.dispatch(world.master.step)
        assert world.ticks == ticks + step


def test_a_paused_plant_does_not_wait_for_a_recorder_that_has_left():
    world = recorded(10)
    world.nodes[RECORDER].is_hung = True
    world.settle()
    world.dispatch(world.master.set_paused, is_paused=True)
    world.leave(RECORDER)
    world.wait(0.3)
    ticks = world.ticks
    world.dispatch(world.master.step)
    assert world.ticks == ticks + 1


def test_another_request_to_pause_keeps_a_pending_step():
    world = begun()
    world.dispatch(world.master.set_paused, is_paused=True)
    world.dispatch(world.master.step)
    world.dispatch(world.master.set_paused, is_paused=True)
    assert world.wait(1).ticks == 1


def test_pending_steps_are_dropped_at_the_end_of_the_pause():
    world = begun()
    world.in_flight.clear()
    world.dispatch(world.master.set_paused, is_paused=True)
    world.dispatch(world.master.step)
    world.dispatch(world.master.set_paused, is_paused=False)
    world.dispatch(world.master.set_paused, is_paused=True)
    world.wait(1)
    assert world.ticks == 0


def test_a_step_has_no_effect_unless_the_plant_is_paused():
    world = begun()
    world.dispatch(world.master.step)
    world.dispatch(world.master.set_paused, is_paused=True)
    world.wait(0.5)
    assert world.ticks == 0


def test_a_standing_robot_is_shown_to_late_subscribers_once_a_second():
    world = begun(7)
    world.dispatch(world.master.set_paused, is_paused=True)
    world.wait(1)
    before = len(world.actions(do.PublishTruth))
    world.wait(11)
    assert len(world.actions(do.PublishTruth)) - before in (10, 11)


@pytest.mark.parametrize('factor', [0.01, 0.5, 1.0, 10.0])
def test_ticks_run_at_the_requested_pace(factor):
    world = LockstepWorld(duration=1.0, real_time_factor=factor).start()
    while world.summary is None:
        world.wait(0.1)
    assert world.summary.real_time_factor == pytest.approx(factor, rel=0.01)
    assert world.summary.late_ticks == 0
    # A node that waits for the next tick is not counted as silent.
    assert world.summary.resends == 0
    assert world.warnings == []


@pytest.mark.parametrize('factor', [0.0, 1.0])
def test_another_pace_acts_at_once(factor):
    world = begun(1, real_time_factor=0.01)
    world.settle()
    assert world.wake_s > world.now_s + 0.3
    world.parameters = replace(world.parameters, real_time_factor=factor)
    ticks = world.ticks
    world.dispatch(world.master.on_parameters, world.parameters)
    assert world.wake_s is None
    assert world.ticks == ticks + 1


def test_a_tick_that_is_more_than_a_period_late_is_counted():
    world = begun(3, real_time_factor=1.0)
    world.now_s += 0.1
    world.wait(0.1)
    assert world.master.state()['late ticks'] == 1


@pytest.mark.parametrize('ticks', [0, 1, 24, 25, 26])
def test_a_reset_begins_another_run_at_the_next_multiple_of_100_ms(ticks):
    world = begun(ticks)
    world.in_flight.clear()
    now_ns = world.truths[-1]
    world.dispatch(world.master.reset)
    start_ns = next_start_ns(now_ns)
    assert [each.run.start_ns for each in world.actions(do.AnnounceRun)] == [START_NS, start_ns]
    assert [each.run.number for each in world.actions(do.AnnounceRun)] == ['1', '2']
    world.advance(10)
    assert world.truths[ticks + 1 : ticks + 3] == [start_ns, start_ns + TICK_NS]
    assert world.master.log.duty_sha256 == duties_sha256(10, start_ns)


def test_a_reset_cancels_the_wait_for_the_next_tick():
    world = begun(1, real_time_factor=0.01)
    world.settle()
    assert world.wake_s is not None
    world.dispatch(world.master.reset)
    assert world.wake_s is None


def test_a_run_without_a_map_clears_the_map_of_the_previous_one(tmp_path):
    world = begun(map=str(save(open_floor(40, 40), tmp_path / 'floor.png')))
    assert world.actions(do.ClearMap) == []
    world.parameters = replace(world.parameters, map='')
    cleared, announced = (
        do.ClearMap(),
        do.AnnounceRun(RunIdentity('2 token', START_NS + 100_000_000)),
    )
    actions = world.dispatch(world.master.reset)
    assert actions.index(cleared) < actions.index(announced)


def test_leftover_messages_of_the_previous_run_change_nothing():
    world = begun(30)
    late = [*world.in_flight]
    world.dispatch(world.master.reset)
    world.in_flight.extendleft(late)
    stamp_ns = world.truths[-1]
    world.dispatch(world.master.on_duty, stamp_ns, duty_of(stamp_ns), b'late')
    world.advance(10).wait(0.1)
    assert world.summary is None
    assert world.ticks > 10


def test_a_push_acts_and_is_published():
    world = begun(3, push_duration=0.1)
    now_ns = world.truths[-1]
    world.dispatch(world.master.on_push, 0, (1.0, 0.0), (0.0, 0.0))
    (push,) = world.actions(do.PublishPush)
    assert (push.number, push.push.start_ns) == (1, now_ns)
    assert push.push.end_ns - push.push.start_ns == 100_000_000
    world.dispatch(world.master.stop)
    assert world.master.summary.external_pushes == (push.push,)


def test_parameters_set_during_a_run_are_in_its_summary():
    world = begun(3)
    world.dispatch(world.master.on_retuned, START_NS - TICK_NS, {'k_i': 1.0})  # of an earlier run
    world.dispatch(world.master.on_retuned, START_NS + 2 * TICK_NS, {'k_i': 2.0, 'dst_thr': 9})
    world.dispatch(world.master.stop)
    assert world.master.summary.parameter_changes == (
        ParameterChange(0.008, CONTROLLER, 'k_i', 2.0),
        ParameterChange(0.008, CONTROLLER, 'dst_thr', 9),
    )


def test_parameters_set_since_the_first_run_are_those_of_a_later_run():
    world = LockstepWorld(duration=ENDLESS).start(parameters={'noise': 1.0, 'k_f': [1.0]})
    world.advance(3)
    world.dispatch(world.master.on_retuned, START_NS, {'k_i': 2.0})
    for role, noise in ((GYRO, 3.0), (SONAR, 1.0)):
        world.nodes[role].participant = make_participant(
            role, parameters={'noise': noise, 'k_f': [1.0]}
        )
    pace = make_participant(PLANT, parameters={'real_time_factor': 2.0})
    world.plant_node.participant = pace  # which moves the robot as before
    world.dispatch(world.master.reset)
    world.advance(10)
    world.dispatch(world.master.stop)
    assert world.master.state()['run'] == 2
    assert world.master.summary.parameter_changes == (ParameterChange(0.0, GYRO, 'noise', 3.0),)


@pytest.mark.parametrize(
    ('push', 'reason'),
    [
        ((0, (float('nan'), 0.0), (0.0, 0.0)), 'not within'),
        ((0, (1e4, 0.0), (0.0, 0.0)), 'not within'),
        ((10**18, (1.0, 0.0), (0.0, 0.0)), 'ahead of sim time'),
    ],
)
def test_an_impossible_push_is_ignored(push, reason):
    world = begun()
    world.dispatch(world.master.on_push, *push)
    assert world.actions(do.PublishPush) == []
    assert reason in world.logged[-1]


def test_at_most_a_hundred_pushes_are_accepted():
    world = begun()
    for _ in range(101):
        world.dispatch(world.master.on_push, 0, (0.0, 0.0), (0.0, 0.0))
    assert len(world.actions(do.PublishPush)) == 100
    assert '100 pushes are already active or pending' in world.logged[-1]


def test_pushes_before_the_first_truth_are_ignored():
    world = LockstepWorld()
    world.dispatch(world.master.on_push, 0, (1.0, 0.0), (0.0, 0.0))
    assert world.done == []


# Random faults


class TroubledRun(RuleBasedStateMachine):
    """A run whose messages are lost, repeated and reordered, and whose nodes hang and are replaced.

    Nevertheless each tick has the duty of its own time; and once the faults end, the run completes.
    """

    TICKS = 100

    def __init__(self):
        super().__init__()
        self.world = LockstepWorld(
            duration=self.TICKS * 0.004, on_timeout='wait', timeout=1.0, startup_timeout=1.0
        )
        self.world.start(*ROLES, RECORDER).wait(1e-3)
        self.generation = 0

    @rule(count=st.integers(1, 30))
    def deliver(self, count):
        for _ in range(count):
            self.world.deliver()

    @rule(seconds=st.sampled_from([0.004, 0.05, 0.1, 0.35, 1.5]))
    def wait(self, seconds):
        self.world.wait(seconds)

    @precondition(lambda self: self.world.in_flight)
    @rule(data=st.data())
    def lose(self, data):
        del self.world.in_flight[data.draw(st.integers(0, len(self.world.in_flight) - 1))]

    @precondition(lambda self: self.world.in_flight)
    @rule(data=st.data())
    def repeat(self, data):
        chosen = data.draw(st.integers(0, len(self.world.in_flight) - 1))
        self.world.in_flight.append(self.world.in_flight[chosen])

    @precondition(lambda self: len(self.world.in_flight) > 1)
    @rule(by=st.integers(1, 5))
    def reorder(self, by):
        self.world.in_flight.rotate(by)

    @rule(role=st.sampled_from((*ROLES, RECORDER)))
    def hang(self, role):
        self.world.nodes[role].is_hung = True

    @rule(role=st.sampled_from((*ROLES, RECORDER)))
    def come_back(self, role):
        self.world.nodes[role].is_hung = False

    @rule(role=st.sampled_from((GYRO, SONAR)))
    def replace(self, role):
        self.generation += 1
        self.world.leave(role)
        # If the replacement were faster than the roll calls, the two nodes would count as
        # duplicates.
        self.world.wait(1.0)
        self.world.start(role, generation=self.generation)

    @rule(is_paused=st.booleans())
    def pause(self, is_paused):
        self.world.dispatch(self.world.master.set_paused, is_paused=is_paused)

    @rule()
    def step(self):
        self.world.dispatch(self.world.master.step)

    @rule()
    def end_the_pause_at_the_start(self):
        self.world.dispatch(self.world.master.start)

    @rule(factor=st.sampled_from([0.0, 1.0, 1000.0]))
    def change_pace(self, factor):
        self.world.parameters = replace(self.world.parameters, real_time_factor=factor)
        self.world.dispatch(self.world.master.on_parameters, self.world.parameters)

    @invariant()
    def each_tick_has_its_own_duty(self):
        log = self.world.master.log
        assert log.duty_sha256 == duties_sha256(log.ticks)

    @invariant()
    def truths_follow_one_another(self):
        truths = self.world.truths
        assert truths == [START_NS + tick * TICK_NS for tick in range(len(truths))]

    @invariant()
    def the_plant_is_never_far_ahead_of_the_recorder(self):
        recorder = self.world.nodes[RECORDER]
        if self.world.truths and recorder.samples:
            lead = (self.world.truths[-1] - max(recorder.samples)) // TICK_NS
            assert lead <= MAX_LEAD_TICKS + 1

    @invariant()
    def no_waiting_run_fails(self):
        assert self.world.summary is None or self.world.summary.outcome == 'completed'

    def teardown(self):
        world = self.world
        for node in world.nodes.values():
            node.is_hung = False
        world.parameters = replace(world.parameters, real_time_factor=0.0)
        world.dispatch(world.master.on_parameters, world.parameters)
        world.dispatch(world.master.set_paused, is_paused=False)
        world.wait(10)
        assert world.summary.outcome == 'completed'
        assert world.summary.duty_sha256 == duties_sha256(self.TICKS)


TestTroubledRun = TroubledRun.TestCase
TestTroubledRun.settings = settings(max_examples=60, stateful_step_count=40, deadline=None)


def test_a_wait_for_the_recorder_at_the_end_does_not_slow_the_reported_pace():
    world = LockstepWorld(real_time_factor=1.0).start(*ROLES, RECORDER)
    while world.ticks < 40:
        world.wait(0.004)
    complete_with_a_recorder_that_hangs(world)
    assert world.summary.real_time_factor == pytest.approx(1.0, rel=0.05)


def test_a_publisher_that_may_be_a_dead_process_is_no_silent_participant():
    world = LockstepWorld(startup_timeout=5.0)
    world.graph.strangers['gyro'] = [Publisher(b'dead', '/dead')]
    world.start().wait(10.0)
    assert world.truths == []
    assert world.warnings[-1] == "waiting for /dead on 'gyro' to join the run or to leave"
    del world.graph.strangers['gyro']
    world.wait(1.0)
    assert world.summary.outcome == 'completed'


@pytest.mark.parametrize(
    ('offset', 'is_counted_from_the_start', 'is_foreign'),
    [(-1, True, True), (0, True, False), (0, False, False), (1, False, True)],
)
def test_only_a_sample_of_another_run_reveals_a_stranger(
    offset, is_counted_from_the_start, is_foreign
):
    world = begun(7)
    world.graph.strangers['gyro'] = [Publisher(b'new', '/new')]
    world.wait(0.2)
    since_ns = START_NS if is_counted_from_the_start else world.truths[-1]
    world.graph.heard_messages = [('gyro', since_ns + offset * TICK_NS)]
    world.wait(1.0)
    assert (world.summary is not None) is is_foreign


def test_ticks_that_a_previous_controller_answered_are_not_requested_again():
    world = recorded(10, timeout=10.0)
    world.nodes[RECORDER].is_hung = True
    world.settle().leave(CONTROLLER)
    world.wait(0.5)
    assert world.actions(do.ResendToDrivers)
    world.start(CONTROLLER, generation=1).wait(1.0)
    assert world.master._participants.roster.history[-1].is_successor
    requests = len(world.actions(do.ResendToDrivers))
    world.wait(0.5)
    assert len(world.actions(do.ResendToDrivers)) == requests
    assert world.summary is None


def test_an_ack_of_an_earlier_run_changes_nothing():
    world = recorded(10)
    world.nodes[RECORDER].is_hung = True
    acked_ns = max(world.nodes[RECORDER].samples)
    # Leave the next duty in flight.
    while len(world.in_flight) > 1:
        world.deliver()
    world.dispatch(world.master.on_ack, START_NS - TICK_NS)
    world.settle()
    assert world.truths[-1] - acked_ns == (MAX_LEAD_TICKS + 1) * TICK_NS


def test_faults_given_to_the_plant_act_and_are_announced():
    world = begun(3)
    before = len(world.actions(do.CallRoll))
    parameters = world.master._parameters
    world.dispatch(world.master.on_parameters, parameters)
    assert len(world.actions(do.CallRoll)) == before
    given = replace(parameters, faults='battery sag time=0.02 amount=2')
    world.dispatch(world.master.on_parameters, given)
    assert len(world.actions(do.CallRoll)) == before + 1
    assert world.master._plant.faults == fault_row(faults_of(given), START_NS)
