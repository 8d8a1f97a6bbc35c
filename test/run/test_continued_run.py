"""A recorded run that goes on as somebody changes it, and the recording of what was done."""

import random

import pytest
from branching import EVENTFUL, recorded
from own_controllers import BALANCE

from ballbot_ros.analysis.parent import Parent
from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.errors import BallbotError
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.run.branch import read_past
from ballbot_ros.run.continued_run import ContinuedRun
from ballbot_ros.run.observer import LogObserver

FAULTS = (
    'gyro_x stuck duration=0.1', 'gyro_y garbage duration=0.04', 'encoder_x slow amount=40',
    'encoder_y intermittent duration=0.3', 'sonar off', 'motor_x weak duration=1',
    'battery sag duration=0.5', 'gamepad delayed amount=200 duration=0.5', 'gamepad off',
    'gyro_x delayed amount=8 duration=0.2', 'task_ts1 slow amount=300', 'brick restart',
)  # fmt: skip
"""Each kind of them; all need nothing but the kernel, which the profile has."""


@pytest.fixture(scope='module')
def parents(tmp_path_factory):
    folder = tmp_path_factory.mktemp('parents')
    # Its gains have other names.
    lqg = EVENTFUL.partition('changes:')[0] + 'parameters: {controller: {implementation: lqg}}\n'
    return {'python': recorded(folder, EVENTFUL), 'lqg': recorded(folder, lqg, 'lqg')}


@pytest.fixture
def continued(parents, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    opened = []

    def make(name='python', code=None):
        path = parents.get(name, name)
        reader = RecordingReader(path)
        run = ContinuedRun(read_past(reader, None, tmp_path, code), tmp_path)
        opened.extend([reader, run])
        return run

    yield make
    for each in reversed(opened):
        each.close()


def duties(run, ticks):
    return [tick.outputs.duty for tick in (run.advance() for _ in range(ticks)) if tick]


def duties_of(recording, start, end):
    """Return the recorded duties from a time on, to before another [s]."""
    motion = read_run(recording).trajectory
    chosen = (motion.time > start - 0.002) & (motion.time < end - 0.002)
    return list(map(tuple, motion.duty[chosen].tolist()))


def live(run, draw, ticks):
    """Let somebody do something from time to time; return the duties by time."""
    found = {}
    for _ in range(ticks):
        choice = draw.random()
        if choice < 0.02:
            run.push((draw.uniform(-0.3, 0.3), draw.uniform(-0.3, 0.3)))
        elif choice < 0.03:
            row = draw.choice(
                [row for row in run.implementation.tunable if isinstance(row.default, float)]
            )
            now = run.parameters.values()[row.name]
            run.retune({row.name: now * draw.uniform(0.95, 1.05)})
        elif choice < 0.035:
            run.add_fault(draw.choice(FAULTS))
        if 0.3 < run.time - run.begun < 0.6:
            run.hold((draw.uniform(-0.5, 0.5), draw.uniform(-0.5, 0.5)))
        time = run.time
        tick = run.advance()
        found[time] = tick.outputs.duty
    return found


@pytest.mark.parametrize(
    ('name', 'seed'), [('python', 1), ('python', 2), ('python', 3), ('lqg', 4)]
)
def test_what_was_done_is_the_same_run_again(continued, tmp_path, name, seed):
    """Also after a part of it was taken back; the first difference is never before its moment."""
    draw, run = random.Random(seed), continued(name)
    begun = 0.004 * draw.randrange(1000)
    run.go_to(begun)
    done = live(run, draw, 200)
    run.go_to(begun + 0.5)
    assert run.begun == pytest.approx(begun)
    done = {time: duty for time, duty in done.items() if time < run.time}
    done |= live(run, draw, 100)
    kept = run.keep(LogObserver())
    assert duties_of(kept, begun, run.time) == list(done.values())
    with RecordingReader(kept) as reader:
        parent = Parent.decode(reader.attachments())
    assert parent.at == pytest.approx(begun)
    assert 'driven by hand' in parent.changes


def test_again_returns_to_the_moment_and_the_recorded_run_goes_on(continued, parents):
    run = continued()
    run.go_to(1.998)
    assert run.begun == pytest.approx(2.0)
    first = duties(run, 300)
    assert first == duties_of(parents['python'], run.begun, run.time)
    run.go_to(run.begun)
    run.push((0.5, 0.0))
    assert duties(run, 300) != first
    run.go_to(run.begun)
    assert run.pushes == run.pushes[: len(run._robot.loop.pushes)]
    assert duties(run, 300) == first


def test_a_run_goes_on_beyond_its_recorded_end(continued):
    run = continued()
    run.go_to(99.0)
    assert run.time == pytest.approx(4.496)
    run.hold((1.0, 0.0))
    duties(run, 500)
    kept = run.keep(LogObserver())
    assert read_run(kept).end == pytest.approx(run.time - 0.004)


def test_a_fault_may_begin_beyond_the_recorded_end(continued):
    run = continued()
    run.go_to(4.0)
    done = duties(run, 200)
    run.add_fault('gyro_x off')
    assert run.time == pytest.approx(4.8)
    done += duties(run, 100)
    assert duties_of(run.keep(LogObserver()), 4.0, run.time) == done


def test_a_fault_that_has_not_begun_when_the_run_is_kept_is_not_in_it(continued):
    run = continued()
    run.go_to(2.0)
    done = duties(run, 100)
    run.add_fault('gyro_x off')
    kept = run.keep(LogObserver())
    assert duties_of(kept, 2.0, run.time) == done
    with RecordingReader(kept) as reader:
        assert Parent.decode(reader.attachments()).changes == ()


def test_what_is_refused_changes_nothing(continued):
    run = continued('lqg')
    run.go_to(2.0)
    for wrong, reason in (
        (lambda: run.add_fault('gyro_x weak'), 'only motor can have this'),
        (lambda: run.add_fault('task_ts1 slow'), 'no such task; it has'),
        (lambda: run.retune({'k_p': 3.0}), "can't change during a run"),
    ):
        with pytest.raises(BallbotError, match=reason):
            wrong()
    first = duties(run, 100)
    run.go_to(run.begun)
    assert duties(run, 100) == first


def test_a_controller_that_can_not_be_copied_runs_again_from_the_start(continued, tmp_path):
    (tmp_path / 'own.py').write_text(
        f'import threading\n{BALANCE}\n\nLOCKED = Balance.__init__\n\n\n'
        'def locked(self, *arguments):\n    LOCKED(self, *arguments)\n'
        '    self.lock = threading.Lock()\n\n\nBalance.__init__ = locked\n'
    )
    text = (
        'purpose: stands\nduration: 2\nparameters:\n'
        f'  controller: {{implementation: "{tmp_path}/own.py:Balance"}}\n'
    )
    path = recorded(tmp_path, text, 'own')
    run = continued(path, f'{tmp_path}/own.py:Balance')
    run.go_to(1.5)
    first = duties(run, 100)
    run.go_to(1.7)
    assert run.begun == pytest.approx(1.5)
    run.go_to(run.begun)
    assert duties(run, 100) == first
    assert run._states == []


def test_a_wall_ends_it_until_one_goes_back(continued, tmp_path):
    text = (
        'purpose: meets a wall\nduration: 3\nmap: corridor\nsticks:\n  vertical:\n'
        '    - {name: forward, from: 2, value: 0}\n'
    )
    run = continued(recorded(tmp_path, text, 'wall'))
    run.go_to(2.0)
    while (tick := run.advance()) is not None:
        run.hold((0.0, 1.0))
        assert tick.truth.stamp_ns < 60e9
    assert 'wall' in run.wall_hit
    kept = run.keep(LogObserver())
    assert kept is not None
    run.go_to(run.begun)
    assert run.wall_hit == ''
    assert len(duties(run, 10)) == 10
