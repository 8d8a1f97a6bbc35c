"""The plant's node, without the graph: its master's actions, its pace, and what it saves."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from stubs import bare

from ballbot_ros.engine.trajectory import TrajectoryLog, load_trajectory
from ballbot_ros.errors import BallbotError
from ballbot_ros.lockstep import run_actions as do
from ballbot_ros.lockstep.lockstep import RunIdentity
from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.nodes import plant_sim
from ballbot_ros.nodes.plant_sim import PlantActions, PlantSim
from ballbot_ros.nodes.processes import Heartbeat
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.recording.messages.topics import CLOCK, DIAGNOSTICS, MAP, MOTOR_DUTY, RUN_STATUS
from ballbot_ros.robot.plant.ground_truth import Push

TRUTH = SimpleNamespace(stamp_ns=8)
PUSH = Push(4, 8, (1.0, 0.0))


class Recorded:
    """Stores the calls of its methods, as their names and arguments."""

    def __init__(self, calls, name=''):
        self._calls, self._name = calls, name

    def __getattr__(self, name):
        return lambda *given, **named: self._calls.append(
            (f'{self._name}{name}', *given, *named.values())
        )


def summary(reason):
    return do.RunSummary(Outcome.FAILED, reason, 1, 'ab', 1.0, 0, 0, (), 0)


def carried_out(action):
    calls = []
    actions = bare(
        PlantActions,
        _node=Recorded(calls),
        _messages=Recorded(calls, 'publish '),
        _wake=Recorded(calls, 'wake.'),
    )
    actions._node.get_logger = lambda: Recorded(calls, 'log.')
    actions.carry_out([action])
    return calls, actions


def test_each_action_of_the_master_is_carried_out():
    for action, calls in (
        (
            do.PublishTruth(TRUTH, True, True),
            [
                ('publish truth', TRUTH, True, True),
                ('publish send_unrecorded', TRUTH),
                ('count_sample', 8),
            ],
        ),
        (
            do.ResendToDrivers(TRUTH),
            [('publish send_to_drivers', TRUTH), ('publish send_unrecorded', TRUTH)],
        ),
        (do.WakeIn(0.5), [('wake.start', 0.5)]),
        (do.CancelWake(), [('wake.cancel',)]),
        (do.AnnounceRun(RunIdentity('1 a', 4)), [('publish announce', 4, '1 a')]),
        (do.ClearMap(), [('drop_latched', MAP)]),
        (do.PublishPush(PUSH, 3), [('publish push', PUSH, 3)]),
        (do.StopMotors(4), [('publish stop_motors', 4)]),
        (do.Log('begins'), [('log.info', 'begins')]),
        (do.Log('late', True), [('log.warning', 'late')]),
        (do.Log('late', True, True), [('log.warning', 'late', 1.0)]),
        (do.Warn('slow'), [('warn', 'slow')]),
        (do.ClearWarning(), [('clear_warning',)]),
        (do.RaiseError('lost'), [('report_error', 'lost')]),
        (do.ClearError(), [('clear_error',)]),
        (do.Report(), [('report',)]),
        (do.EndRun(summary(''), 0), [('finish',), ('report',)]),
        (do.EndRun(summary('fell'), 2), [('finish',), ('fail', 'fell')]),
    ):  # fmt: skip
        found, actions = carried_out(action)
        assert found == calls, action
        if isinstance(action, do.EndRun):
            assert actions._node.exit_status == action.exit_status
    calls, actions = carried_out(do.BeginRun(4, None, 0.1))
    assert calls == [('publish begin', 4, None)]
    assert actions._messages.ball_radius == 0.1
    with pytest.raises(NotImplementedError):
        carried_out('jump')


def test_a_free_running_plant_ticks_at_the_pace_of_its_parameters():
    """It has no pace 'as fast as possible', for which it runs in real time."""
    for factor, period_ns in ((1.0, 4_000_000), (2.0, 2_000_000), (0.0, 4_000_000)):
        told, timer = [], SimpleNamespace(timer_period_ns=0)
        node = bare(
            PlantSim,
            _free_timer=timer,
            dispatch=lambda event, parameters, told=told: told.append((event, parameters)),
            master=SimpleNamespace(on_parameters='changed'),
            parameters=PlantParameters(real_time_factor=factor),
        )
        node.on_parameters_changed()
        assert timer.timer_period_ns == period_ns
        node._free_timer = None
        node.on_parameters_changed()
        assert told == [('changed', node.parameters)] * 2


def test_the_diagnostics_have_the_outcome_of_a_run_that_has_ended():
    state = {'run': 2, 'ticks': 125}
    node = bare(PlantSim, master=SimpleNamespace(state=lambda: state, summary=None))
    assert node.diagnose() == state
    assert node.summary == {}
    node.master.summary = summary('fell')
    assert node.diagnose().items() > {**state, 'outcome': Outcome.FAILED}.items()
    assert node.summary['reason'] == 'fell'


def test_a_plant_that_ends_saves_its_trajectory_and_releases_the_domain(monkeypatch, tmp_path):
    calls, flushed = [], []
    node = bare(
        PlantSim,
        _lock=SimpleNamespace(release=lambda: calls.append('release')),
        flush=lambda *topics: flushed.extend(topics),
        master=SimpleNamespace(
            log=TrajectoryLog(), summary=summary('fell'), has_begun=True, time_ns=8_000_000
        ),
        parameters=PlantParameters(trajectory_file=str(tmp_path / 'trajectory.npz')),
        stop=lambda: calls.append('stop'),
        _heartbeats=SimpleNamespace(send=calls.append),
    )
    node.close()
    assert load_trajectory(tmp_path / 'trajectory.npz')[1]['reason'] == 'fell'
    assert calls == ['stop', Heartbeat(8_000_000, has_ended=True), 'release']
    assert {CLOCK, MOTOR_DUTY, RUN_STATUS, DIAGNOSTICS} <= set(flushed)
    node.parameters = PlantParameters()
    node.close()
    assert list(tmp_path.iterdir()) == [tmp_path / 'trajectory.npz']

    def fail(*_):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(plant_sim, 'save_trajectory', fail)
    node.parameters = PlantParameters(trajectory_file='t.npz')
    with pytest.raises(BallbotError, match=r'^t\.npz: No space left on device$'):
        node.close()
