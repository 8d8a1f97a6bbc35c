"""Branches: the recorded run up to a moment, whatever it was, and another future from then on."""

import hashlib
import signal
import subprocess
import sys

import pytest
from branching import EVENTFUL, recorded, run
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from own_controllers import BALANCE
from recordings import copy_recording

import ballbot_ros as bb
from ballbot_ros.analysis.parent import Parent
from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.engine.scenario.scenario import ScheduledPush
from ballbot_ros.errors import BallbotError
from ballbot_ros.recording.messages.conversions import encode_accepted_push
from ballbot_ros.recording.messages.topics import ACCEPTED_PUSH
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.repair import repair
from ballbot_ros.robot.brick.faults import Fault
from ballbot_ros.robot.plant.ground_truth import Push
from ballbot_ros.run.branch import Proof, branch_spec, prove, read_past
from ballbot_ros.run.future import RECORDED, Future

TO_FIND = Phase.explicit, Phase.reuse, Phase.generate
"""Without shrinking: an example takes half a second."""


@pytest.fixture(scope='module')
def parent(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp('parent'), EVENTFUL)


@pytest.fixture
def branch(tmp_path):
    def make(recording, future, **options):
        scratch = tmp_path / 'scratch'
        scratch.mkdir(exist_ok=True)
        with RecordingReader(recording) as reader:
            names = 'number', 'controller', 'trust_attached_code'
            given = {name: options.pop(name) for name in names if name in options}
            past = read_past(reader, given.pop('number', None), scratch, **given)
            spec = branch_spec(past, future, scratch, output=tmp_path, **options)
            path = tmp_path / f'{len(list(tmp_path.iterdir()))}.mcap'
            run(spec, path)
            return path, prove(past, path, future.at)

    return make


def sha256(path):
    return read_run(path).duty_sha256


@settings(max_examples=4, deadline=None, phases=TO_FIND)
@given(at=st.floats(0.0, 4.496))
def test_without_a_change_it_is_the_same_run(at, parent, tmp_path_factory):
    folder = tmp_path_factory.mktemp('branch')
    with RecordingReader(parent) as reader:
        past = read_past(reader, None, folder)
        spec = branch_spec(past, Future(at=at), folder)
        path = folder / 'branch.mcap'
        result = run(spec, path)
        proof = prove(past, path, at)
    assert result.duty_sha256 == sha256(parent)
    assert proof == Proof(proof.messages)
    assert proof.messages > 9_000


def held(at):
    return st.tuples(st.integers(-100, 100), st.integers(-100, 100))


@st.composite
def futures(draw):
    at = draw(st.integers(0, 4400).map(lambda ms: ms / 1000))
    pushes = draw(
        st.lists(
            st.builds(
                ScheduledPush, st.floats(at, 4.49), st.floats(0.01, 0.5),
                force=st.floats(0.1, 1.0), direction=st.floats(0.0, 360.0),
            ),
            max_size=2,
        )
    )  # fmt: skip
    values = {'k_thetadot': st.floats(100.0, 400.0), 'dst_thr': st.integers(0, 80)}
    return Future(
        at=at,
        pushes=tuple(pushes),
        values=draw(st.fixed_dictionaries({}, optional=values)),
        sticks=draw(st.one_of(st.just(RECORDED), held(at))),
    )


@settings(max_examples=4, deadline=None, phases=TO_FIND)
@given(future=futures())
def test_nothing_differs_before_the_change(future, parent, tmp_path_factory):
    folder = tmp_path_factory.mktemp('branch')
    with RecordingReader(parent) as reader:
        past = read_past(reader, None, folder)
        path = folder / 'branch.mcap'
        run(branch_spec(past, future, folder), path)
        proof = prove(past, path, future.at)
    assert not proof.problem
    assert proof.at is None or proof.at >= future.at


def test_a_push_acts_in_the_next_tick(parent, branch):
    push = ScheduledPush(2.5, 0.1, force=0.8, direction='left')
    path, proof = branch(parent, Future(at=2.5, pushes=(push,)))
    assert proof.at == 2.504
    assert proof.difference.topic == 'plant/imu'
    assert [each.start for each in read_run(path).pushes] == [2.0, 2.5, 3.0]


def test_recorded_changes_go_on_unless_they_are_changed(parent, branch):
    path, _ = branch(parent, Future(at=2.0, values={'k_i': -0.006}))
    told = [(each.time, each.name, each.value) for each in read_run(path).parameter_changes]
    assert told == [(1.7, 'k_thetadot', 300.0), (2.0, 'k_i', -0.006), (3.3, 'dst_thr', 40)]
    assert not read_run(path).outside_changes


def test_sticks_are_held_from_the_moment_on(parent, branch):
    path, _ = branch(parent, Future(at=2.01, sticks=(-20, 0)))
    sticks = read_run(path).series
    frame = bb.open(path).frame()
    before = bb.open(parent).frame()
    names = ['stick_x_percent', 'stick_y_percent']
    assert sticks
    assert frame[names].loc[:2.016].equals(before[names].loc[:2.016])
    assert (frame[names].loc[2.02:].to_numpy() == [20.0, 0.0]).all()


def test_a_branch_can_be_branched(parent, branch):
    once, _ = branch(parent, Future(at=2.0, sticks=(-20, 3), values={'k_i': -0.006}))
    again, proof = branch(once, Future(at=1.0))
    assert proof.difference is None
    assert sha256(again) == sha256(once) != sha256(parent)


def live_copy(parent, path, **options):
    """Return a copy without its scenario, as of a drive by hand."""
    return copy_recording(
        path, parent, attach=lambda data: None if data.startswith(b'\npurpose') else data, **options
    )


def test_recorded_sticks_replace_those_of_a_missing_scenario(parent, branch, tmp_path):
    copy = live_copy(parent, tmp_path / 'live.mcap')
    path, proof = branch(copy, Future(at=3.0))
    assert proof.difference is None
    assert sha256(path) == sha256(parent)


def test_an_outside_push_happens_again(branch, tmp_path):
    push = Push(3_000_000_000, 3_100_000_000, (0.25, -0.125), (0.0, 0.03125))
    plain = 'purpose: stands\nduration: 4.0\n'
    values = 'pushes:\n  - {time: 2, duration: 0.1, force: [0.25, -0.125], torque: [0, 0.03125]}\n'
    pushed = recorded(tmp_path, plain + values, 'pushed')
    parent = copy_recording(
        tmp_path / 'outside.mcap', pushed,
        attach=lambda data: data.replace(values.encode(), b''),
    )  # fmt: skip
    assert [each.is_external for each in read_run(parent).pushes] == [True]
    path, proof = branch(parent, Future(at=1.0))
    assert proof.difference is None
    assert sha256(path) == sha256(pushed)
    assert encode_accepted_push(3_000_000_000, push, 1, acts=True) in [
        raw.data for raw in RecordingReader(path).raw_messages([ACCEPTED_PUSH.resolved()])
    ]


def test_it_names_its_parent(parent, branch, tmp_path):
    path, _ = branch(parent, Future(at=1.5, sticks=(0, 0)))
    with RecordingReader(path) as reader:
        found = Parent.decode(reader.attachments())
    name, content = f'../{parent.parent.name}/{parent.name}', parent.read_bytes()
    assert found == Parent(name, hashlib.sha256(content).hexdigest(), 1, 1.5, ('sticks 0, 0',))
    assert found.find(path).samefile(parent)
    moved = tmp_path / 'moved/branch.mcap'
    moved.parent.mkdir()
    assert found.find(moved) is None
    moved.with_name(parent.name).write_bytes(content)
    assert found.find(moved).samefile(moved.with_name(parent.name))
    moved.with_name(parent.name).write_bytes(content[:-1])
    assert found.find(moved) is None


def test_a_fault_begins_at_the_moment(parent, branch):
    fault = Fault('gyro_x', 'off', 2.0, 0.1)
    path, proof = branch(parent, Future(at=2.0, faults=(fault,)))
    assert (proof.at, proof.difference.topic) == (2.0, 'gyro')
    again, proof = branch(path, Future(at=3.0))
    assert proof.difference is None
    assert sha256(again) == sha256(path) != sha256(parent)


def test_recorded_sticks_do_not_pass_a_fault_again(branch, tmp_path):
    text = EVENTFUL + 'faults:\n  - {component: gamepad, type: delayed, time: 1.6, amount: 300}\n'
    parent = recorded(tmp_path, text, 'late')
    path, proof = branch(parent, Future(at=3.0))
    assert proof.difference is None
    assert sha256(path) == sha256(parent)


@pytest.fixture
def mine(tmp_path):
    path = tmp_path / 'mine.py'
    path.write_text(BALANCE)
    return f'{path}:Balance'


@pytest.mark.parametrize('is_mine', [False, True])
def test_another_controller_takes_over(is_mine, parent, branch, mine, command):
    path, proof = branch(parent, Future(at=2.0, controller=mine if is_mine else 'lqg'))
    assert (proof.at, proof.difference.topic) == (2.0, 'motor_duty')
    run = read_run(path)
    told = [each.value for each in run.parameter_changes if each.name == 'implementation']
    assert told == ['mine.py:Balance' if is_mine else 'lqg']
    assert not run.outside_changes
    words = ('--controller', mine) if is_mine else ()
    status, differences, problem = command('replay', path, *words)
    assert status == 0, differences + problem
    assert f'implementation: python, as recorded; {told[0]} takes over at 2.000 s' in differences
    if is_mine:
        status, _, problem = command('replay', path)
        assert status == 2
        assert 'its controller is mine.py:Balance' in problem


def test_two_controllers_of_ones_own_can_follow_each_other(branch, mine, tmp_path):
    plain = (
        f'purpose: stands\nduration: 2.0\nparameters:\n  controller: {{implementation: {mine}}}\n'
    )
    parent = recorded(tmp_path, plain, 'owned')
    path, proof = branch(parent, Future(at=1.5, controller='pid'), controller=mine)
    assert proof.at >= 1.5
    trusted = branch(path, Future(at=1.8), trust_attached_code=True)
    assert sha256(trusted[0]) == sha256(path)


@pytest.mark.parametrize('name', ['../../x.mcap', '/etc/passwd', 'a/../../x.mcap'])
def test_a_parent_elsewhere_is_not_looked_for(name, tmp_path):
    assert Parent(name, '', 1, 0.0, ()).find(tmp_path / 'a/b.mcap') is None


def test_the_parent_next_to_it_has_a_relative_path(tmp_path):
    file = tmp_path / 'runs/a/a.mcap'
    file.parent.mkdir(parents=True)
    file.write_bytes(b'x')
    assert Parent.of(file, 1, 0.0, (), tmp_path / 'runs/b').file == '../a/a.mcap'
    assert Parent.of(file, 1, 0.0, (), tmp_path / 'other/folder').file == 'a.mcap'


@pytest.mark.parametrize(
    ('future', 'told'),
    [
        (Future(at=5.0), 'at 5 s: not within the recorded run, 0 … 4.496 s'),
        (
            Future(at=2.0, pushes=(ScheduledPush(1.0, 0.1),)),
            '--push: begins at 1 s, not within 2 … 4.5 s',
        ),
        (
            Future(at=2.0, values={'user.kp': 1.0}),
            "controller.user.kp can't change during a run of python; it has dst_thr",
        ),
    ],
)
def test_an_impossible_future_is_refused(future, told, parent, branch):
    with pytest.raises(BallbotError) as caught:
        branch(parent, future)
    assert str(caught.value).startswith(told)


def test_a_run_that_never_happens_again_is_refused(parent, branch, tmp_path):
    free = copy_recording(
        tmp_path / 'free.mcap', parent,
        attach=lambda data: data.replace(b'lockstep: true', b'lockstep: false'),
    )  # fmt: skip
    with pytest.raises(BallbotError, match='cannot be branched: it ran without lockstep'):
        branch(free, Future(at=1.0))
    with pytest.raises(BallbotError, match=r'run 2 not found; it has 1 … 1'):
        branch(parent, Future(at=1.0), number=2)


def test_another_beginning_is_no_branch(parent, branch, tmp_path):
    other = recorded(tmp_path, EVENTFUL.replace('seed: 3', 'seed: 4'), 'other')
    scratch = tmp_path / 'scratch'
    scratch.mkdir()
    with RecordingReader(parent) as reader:
        problem = prove(read_past(reader, None, scratch), other, 2.0).problem
    assert problem.startswith(f'{other}: no branch of {parent}: they differ at 0.000 s, /')


def test_the_library_returns_both(parent):
    before = bb.open(parent)
    after = bb.branch(before, 2.0, pushes={'force': 0.5, 'direction': 'right'}, sticks=(0, 0))
    assert after.earlier is before
    assert after.duty_sha256 != before.duty_sha256
    assert bb.branch(str(parent), 2.0).duty_sha256 == before.duty_sha256
    assert len(after.plot().axes[0].lines) == 4
    with pytest.raises(BallbotError, match=r'^pushes: 2000 is not within'):
        bb.branch(before, 2.0, pushes=[{'force': 2000, 'direction': 'left'}])
    with pytest.raises(BallbotError, match=r'^pushes: begins at 1 s, not within 2'):
        bb.branch(before, 2.0, pushes={'time': 1, 'force': 1, 'direction': 'left'})
    with pytest.raises(BallbotError, match=r'^parameters: plant_sim\.seed is not of the form'):
        bb.branch(before, 2.0, parameters={'plant_sim.seed': 3})
    with pytest.raises(BallbotError, match=r'^sticks: \(0, 101\) is not recorded, neutral'):
        bb.branch(before, 2.0, sticks=(0, 101))


def test_separate_processes_make_the_same_branch(parent, branch, tmp_path, command):
    words = ('--at', '2.0', '--push', 'force=0.5 direction=left', '--sticks=-20,0')
    values = ('--set', 'controller.k_i=-0.006', '--fault', 'motor_x weak duration=0.5')
    status, _, problem = command(
        'branch', parent, *words, *values, '--json', '--output', tmp_path / 'graph'
    )
    assert status == 0, problem
    push = ScheduledPush(2.0, 0.1, force=0.5, direction='left')
    fault = Fault('motor_x', 'weak', 2.0, 0.5)
    future = Future(
        at=2.0, pushes=(push,), faults=(fault,), values={'k_i': -0.006}, sticks=(-20, 0)
    )
    path, _ = branch(parent, future)
    written = tmp_path / 'graph/parent_branch.mcap'
    assert sha256(written) == sha256(path)
    status, differences, _ = command('replay', written)
    assert status == 0, differences


KILLED = """
import os, signal, sys
from pathlib import Path
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.run import simulated_recording
from ballbot_ros.run.branch import branch_spec, read_past
from ballbot_ros.run.future import Future
from ballbot_ros.run.observer import LogObserver
from ballbot_ros.run.offline import run_offline

def flush_and_die(self, now_ns, flush=simulated_recording.SimulatedRecording._flush):
    flush(self, now_ns)
    if now_ns > 4_000_000_000:
        os.kill(os.getpid(), signal.SIGKILL)

simulated_recording.SimulatedRecording._flush = flush_and_die
folder = Path(sys.argv[2])
with RecordingReader(Path(sys.argv[1])) as reader:
    spec = branch_spec(read_past(reader, None, folder), Future(at=2.0, sticks=(0, 0)), folder)
    run_offline(spec, folder / 'branch.mcap', LogObserver())
"""


def test_a_kill_leaves_the_parent_alone_and_the_branch_repairable(parent, tmp_path):
    before = parent.read_bytes()
    killed = subprocess.run([sys.executable, '-c', KILLED, parent, tmp_path], check=False)
    assert killed.returncode == -signal.SIGKILL
    assert parent.read_bytes() == before
    repair(tmp_path / 'branch.mcap', tmp_path / 'repaired.mcap')
    run = read_run(tmp_path / 'repaired.mcap')
    assert run.end > 1.9
    assert run.missing_ticks == 0
    assert Parent.decode(run.attached.files).at == 2.0
