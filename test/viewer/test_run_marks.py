"""The events of a recorded run on the time line."""

from types import SimpleNamespace

import pytest

from ballbot_ros.analysis.figure_parts import Interval, IntervalKind
from ballbot_ros.analysis.recorded_scenario import RecordedAttachments, RecordedPush
from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.robot.brick.brick import Tone
from ballbot_ros.run.library import simulate
from ballbot_ros.viewer.overlay import Mark, MarkKind
from ballbot_ros.viewer.playback_run import run_marks


def run(end=100.0, states=(), pushes=(), wall_hits=(), tones=()):
    return SimpleNamespace(
        end=end, states=states, pushes=pushes, wall_hits=wall_hits, tones=tones,
        attached=RecordedAttachments(),
    )  # fmt: skip


def hit(time):
    return Interval(time, time + 0.02, 'wall hit', IntervalKind.WALL_HIT)


def test_each_event_has_a_mark():
    events = run(
        states=(Interval(0.0, 1.0, 'calibration'), Interval(1.0, 9.0, 'out_of_control')),
        pushes=(
            RecordedPush(2.0, 2.1, (1.5, -0.0), (0.0, 0.0), is_external=False),
            RecordedPush(4.0, 4.1, (0.0, 0.0), (0.0, -0.2), is_external=True),
        ),
        wall_hits=(hit(3.0),),
        tones=((1.0, Tone(440, 500, 70)),),
    )
    assert run_marks(events) == (
        Mark(0.0, MarkKind.STATE, 'calibration'),
        Mark(1.0, MarkKind.STATE, 'out of control'),
        Mark(2.0, MarkKind.PUSH, 'push of 1.5 N forward'),
        Mark(4.0, MarkKind.PUSH, 'outside push of torque x 0, y −0.2 N·m'),
        Mark(3.0, MarkKind.HIT, 'wall hit'),
        Mark(1.0, MarkKind.TONE, 'tone of 440 Hz, 500 ms'),
    )


def test_events_upon_each_other_share_a_mark():
    tones = tuple((0.02 * number, Tone(440, 20, 70)) for number in range(5000))
    marks = run_marks(run(tones=tones))
    assert 100 < len(marks) <= 201
    assert marks[0].text.startswith('tone of 440 Hz, 20 ms, and ')
    assert run_marks(run(wall_hits=(hit(1.0), hit(1.1), hit(50.0)))) == (
        Mark(1.0, MarkKind.HIT, 'wall hit, and 1 more'),
        Mark(50.0, MarkKind.HIT, 'wall hit'),
    )


@pytest.fixture(scope='module')
def pushed(tmp_path_factory):
    path = tmp_path_factory.mktemp('pushed') / 'push.mcap'
    simulate('push').save(path)
    return read_run(path)


def test_the_pushes_of_a_recorded_run_are_marked(pushed):
    marks = [mark for mark in run_marks(pushed) if mark.kind is MarkKind.PUSH]
    assert [mark.time for mark in marks] == [push.start for push in pushed.pushes]
    assert len(marks) >= 1
    assert all(mark.text.startswith('push of ') for mark in marks)


def test_the_wall_hit_of_a_recorded_run_is_marked_once(tmp_path):
    path = tmp_path / 'hit.mcap'
    simulate('autonomous', parameters={'plant_sim.duration': 30.0}).save(path)
    (hit,) = (mark for mark in run_marks(read_run(path)) if mark.kind is MarkKind.HIT)
    assert hit.time == pytest.approx(21.26)
