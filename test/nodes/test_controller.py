"""Decisions of the controller's node, without the graph."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from ballbot_ros.controllers.controller_program import TickTimes
from ballbot_ros.lockstep.lockstep import DueTick, RunIdentity, SampleReaction
from ballbot_ros.lockstep.participants import Objection
from ballbot_ros.nodes.controller import ControllerNode
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.recording.messages.topics import MOTOR_DUTY, PARTICIPANTS


@pytest.mark.parametrize(('now_ns', 'stops'), [(0, []), (1_000_000_000, [1_000_000_000])])
def test_only_a_controller_that_has_driven_switches_off_the_motors(now_ns, stops):
    stopped, flushed = [], []
    controller = SimpleNamespace(
        now_ns=now_ns,
        _messages=SimpleNamespace(stop_motors=stopped.append),
        _implementation=SimpleNamespace(times=TickTimes()),
        flush=lambda *topics: flushed.extend(topics),
    )
    ControllerNode.close(controller)
    assert stopped == stops
    assert flushed == [MOTOR_DUTY, PARTICIPANTS]


TICK = DueTick(1_004_000_000, ('task_ts1', 'task_ts2'), ('task_ts2',))


@pytest.mark.parametrize(
    ('reaction', 'expected'),
    [
        (TICK, ['run']),
        (SampleReaction.IGNORE, []),
        (SampleReaction.STORE, []),
        (SampleReaction.RESEND, ['resend']),
        (SampleReaction.FORCE_RELEASES, ['force', 'run']),
        (SampleReaction.OBJECT, [Objection.to_sample('gyro', 5)]),
        (SampleReaction.MISSED_START, ['missed']),
    ],
)
def test_each_reaction_to_a_sample_is_carried_out(reaction, expected):
    done = []
    controller = SimpleNamespace(
        _lockstep_ticks=SimpleNamespace(
            take=lambda *sample: reaction,
            force=lambda: done.append('force') or TICK,
        ),
        _messages=SimpleNamespace(resend=lambda stamp: done.append('resend')),
        _participation=SimpleNamespace(raise_objection=done.append),
        _on_missed_start=lambda stamp: done.append('missed'),
        _run=lambda tick: done.append('run'),
        _resends=0,
    )
    ControllerNode._take(controller, 'gyro', 5, b'', None)
    assert done == expected
    assert controller._resends == expected.count('resend')


@pytest.mark.parametrize(
    ('reaction', 'expected'),
    [
        (SampleReaction.RESTART, ['restarts in mid-run, at 1.500 s']),
        (SampleReaction.ABORT, ['objects', 'finished', 'failed']),
        (SampleReaction.IGNORE, []),
    ],
)
def test_a_controller_that_starts_in_mid_run_restarts_or_fails(reaction, expected):
    done, problems = [], []
    controller = SimpleNamespace(
        _lockstep_ticks=SimpleNamespace(on_missed_start=lambda stamp, now_ns, rejoin: reaction),
        _participation=SimpleNamespace(
            raise_objection=lambda objection: (
                done.append('objects') or problems.append(objection.text)
            )
        ),
        parameters=ControllerParameters(),
        get_clock=lambda: SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=0)),
        get_logger=lambda: SimpleNamespace(warning=done.append),
        finish=lambda: done.append('finished'),
        fail=lambda problem: done.append('failed') or problems.append(problem),
    )
    controller._abort = lambda problem: ControllerNode._abort(controller, problem)
    ControllerNode._on_missed_start(controller, 1_500_000_000)
    assert done == expected
    assert len(set(problems)) == (len(problems) > 0)
    assert all('started in mid-run, at 1.500 s' in problem for problem in problems)


def test_a_run_begins_with_a_new_program_and_timers_that_its_ticks_start():
    for lockstep in (True, False):
        begun = []

        def ticks(name, begun=begun):
            return SimpleNamespace(begin=lambda *arguments: begun.append((name, *arguments)))

        controller = SimpleNamespace(
            _lockstep=lockstep,
            _lockstep_ticks=ticks(True),
            _free_ticks=ticks(False),
            _implementation=SimpleNamespace(make=lambda: 'program', tasks='tasks'),
            _messages=SimpleNamespace(begin=lambda begun=begun: begun.append('messages')),
            _task_timers=SimpleNamespace(stop=lambda begun=begun: begun.append('timers stop')),
            parameters=ControllerParameters(),
        )
        ControllerNode._on_run(controller, RunIdentity('1 abc', 7))
        assert controller._program == 'program'
        assert controller._program_parameters is controller.parameters
        faults = ({},) if lockstep else ()  # none that restarts the program
        assert begun == ['messages', (lockstep, 7, 'tasks', *faults), 'timers stop']


def test_timers_are_restarted_only_at_the_time_of_the_tick():
    for lockstep, now_ns, restarted in (
        (True, TICK.time_ns, [TICK.untimed]),
        (True, TICK.time_ns - 1, []),
        (False, 0, [TICK.untimed]),
    ):
        done = []
        controller = SimpleNamespace(
            _lockstep=lockstep,
            _task_timers=SimpleNamespace(restart=done.append),
            get_clock=lambda now_ns=now_ns: SimpleNamespace(
                now=lambda: SimpleNamespace(nanoseconds=now_ns)
            ),
        )
        ControllerNode._start_timers(controller, TICK)
        assert done == restarted, (lockstep, now_ns)
