"""The viewer's decisions, without ROS and page."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from parts import DIMENSIONS

pytest.importorskip('rclpy')

from stubs import bare

from ballbot_ros.errors import WorldError
from ballbot_ros.nodes import viewer
from ballbot_ros.nodes.viewer import Viewer
from ballbot_ros.parameters import PlantParameters, ViewerParameters
from ballbot_ros.parameters.timing import MILLISECOND_NS, SECOND_NS
from ballbot_ros.recording.messages.conversions import encode_joy
from ballbot_ros.recording.messages.run_reports import PlantReport
from ballbot_ros.recording.messages.topics import MAP, PLANT_IMU, PLANT_ODOM, RUN, SOUND
from ballbot_ros.viewer.overlay import Hold, Press
from ballbot_ros.viewer.run_activity import PAUSE, RealTimeFactor, RunActivity
from ballbot_ros.viewer.snapshot import History, Snapshot


def test_released_sticks_are_published_as_neutral_once():
    """Other inputs take over at once, and a page at rest does not disturb them."""
    held = iter([None, (0.5, 0.0), None, None])
    sent = []
    node = bare(
        Viewer,
        _sticks=SimpleNamespace(value=lambda now_s: next(held)),
        _joy=SimpleNamespace(publish=sent.append),
        _is_driving=False,
        now_ns=SECOND_NS,
    )
    for _ in range(4):
        node._drive()
    assert sent == [encode_joy(SECOND_NS, sticks) for sticks in ((0.5, 0.0), (0.0, 0.0))]


def test_only_a_new_tone_is_played(monkeypatch):
    monkeypatch.setattr(viewer, 'stamp_ns', lambda message: message)
    monkeypatch.setattr(viewer, 'sound_tone', lambda message: message)
    played = []
    for stamp_ns in (SECOND_NS, SECOND_NS - 499 * MILLISECOND_NS, SECOND_NS // 2):
        node = bare(
            Viewer,
            _newest={SOUND: stamp_ns},
            _panel=SimpleNamespace(play=played.append),
            now_ns=SECOND_NS,
        )
        node._sound()
    assert played == [SECOND_NS, SECOND_NS - 499 * MILLISECOND_NS]


SNAPSHOT = Snapshot(1.0, (1.5, 0.5), (0.0, 0.0), state='remote')


def test_a_run_begins_on_its_floor_and_without_the_trail_of_another(monkeypatch):
    """The floor is that of the viewer's own map, or else the published one."""
    for name in ('map_grid', 'floor_map_of'):
        monkeypatch.setattr(viewer, name, lambda message: message)
    shown, asked = [], []
    for own, published, floor in (
        (None, None, None),
        (None, 'published', 'published'),
        ('own', 'published', 'own'),
    ):
        history = History()
        history.add(SNAPSHOT)
        node = bare(
            Viewer,
            _history=history,
            _load_floor=lambda own=own: own,
            _page=SimpleNamespace(show_floor=lambda *arguments: shown.append(arguments)),
            _requests=SimpleNamespace(plant_parameters=lambda names, take: asked.append(names)),
            apply_parameters=lambda: None,
            parameters=ViewerParameters(),
        )
        node._begin(SNAPSHOT, published)
        assert shown.pop() == (floor, (1.5, -0.5)), (own, published)
        assert history.trail() == []
        assert {'scenario', 'map', 'body_height'} <= set(asked.pop())


def test_the_robot_is_shown_with_the_dimensions_of_the_plant():
    shown = []
    node = bare(
        Viewer,
        _scenarios=SimpleNamespace(show=lambda name: None),
        _newest={PLANT_IMU: None, PLANT_ODOM: None},
        _page=SimpleNamespace(dimensions=DIMENSIONS),
        _show_robot=shown.append,
    )
    node._take_parameters(PlantParameters())
    assert shown == []
    node._take_parameters(PlantParameters(body_height=0.3))
    assert [dimensions.body_height for dimensions in shown] == [0.3]


def test_a_run_whose_plant_is_gone_has_ended():
    shown, offered = [], []
    for lost_plant in (False, True):
        node = bare(
            Viewer,
            _activity=lambda has_pose, lost=lost_plant: RunActivity(has_lost_plant=lost),
            _scenarios=SimpleNamespace(offer=lambda *, offer: offered.append(offer)),
            _history=History(),
            _newest=SimpleNamespace(take=lambda: (SNAPSHOT, set())),
            _page=SimpleNamespace(
                dimensions=DIMENSIONS,
                has_clients=True,
                overlay=SimpleNamespace(show=lambda state: None, take=list),
                update_cameras=lambda snapshot: None,
            ),
            _plots=SimpleNamespace(refresh=lambda source: None),
            _start_position=None,
            _panel=SimpleNamespace(show=lambda snapshot, *_: shown.append(snapshot.state)),
            _panel_period=1,
            _processor=SimpleNamespace(show=lambda *jobs: None),
            _real_time_factor=RealTimeFactor(),
            _requests=SimpleNamespace(send_queued=lambda: None, can_start=not lost_plant),
            _robot=SimpleNamespace(show=lambda snapshot: None, show_trail=lambda trail: None),
            _tuning=SimpleNamespace(send_queued=lambda: None),
            _updates=0,
        )
        node._update()
    assert shown == ['remote', 'run ended']
    assert offered == [True, False]


@pytest.mark.parametrize(
    ('changed', 'expected'),
    [
        (set(), []),
        ({RUN}, ['begin']),
        ({MAP}, ['begin']),
        ({SOUND}, ['sound']),
        ({PLANT_ODOM}, [2_000_000_000]),
    ],
)
def test_what_has_changed_is_shown(changed, expected):
    """Without a page nothing is drawn, but the trail grows."""
    odometry = PLANT_ODOM.message_class()
    odometry.header.stamp.sec = 2
    done, history = [], History()
    node = bare(
        Viewer,
        _begin=lambda snapshot, published: done.append('begin'),
        _history=history,
        _newest={PLANT_ODOM: odometry, MAP: None},
        _page=SimpleNamespace(has_clients=False),
        _sound=lambda: done.append('sound'),
        _updates=0,
        count_sample=done.append,
    )
    node._show(SNAPSHOT, changed)
    assert done == expected
    assert len(history.trail()) == (PLANT_ODOM in changed)


class EmptyViewer:
    """A viewer without a state of a robot to show; `done` is what it does."""

    def __init__(self, *, is_empty=True, is_drawn=True, report=None, requests=()):
        self.done = []
        act = lambda what: lambda *_: self.done.append(what)  # noqa: E731
        self.node = bare(
            Viewer,
            _history=SimpleNamespace(clear=act('history')),
            _is_empty=is_empty,
            _newest=SimpleNamespace(
                take=lambda: (None, set()),
                close=act('closed'),
                run=SimpleNamespace(name='1 a'),
                session=None,
            ),
            _page=SimpleNamespace(
                overlay=SimpleNamespace(
                    is_drawn=is_drawn, show=lambda state: None, take=lambda: requests
                ),
                stop=act('stopped'),
            ),
            _panel=SimpleNamespace(clear=act('panel')),
            _plant_report=PlantReport(),
            _plant_reports=lambda: [report] if report else [],
            _requests=SimpleNamespace(
                send_queued=act('sent'),
                lost_plant=False,
                forget_plant=act('another plant'),
                carry_out=lambda request, activity: self.done.append(
                    f'{request.name}, paused: {activity.is_paused}'
                ),
            ),
            _robot=SimpleNamespace(hide=act('robot')),
            _show_plots=act('plots'),
            _run='1 a',
            _start=SimpleNamespace(request=act('start')),
            _sticks=SimpleNamespace(hold=act('hold')),
            _tuning=SimpleNamespace(send_queued=act('tuned')),
        )

    def update(self):
        """Update once, and return what was done besides sending requests."""
        self.node._update()
        assert self.done[:2] == ['sent', 'tuned']
        return self.done[2:]


def test_a_viewer_that_shows_nothing_yet_sends_its_requests_and_closes_its_page():
    viewer = EmptyViewer()
    assert viewer.update() == []
    viewer.node.close()
    assert viewer.done[2:] == ['closed', 'stopped']


def test_what_is_shown_of_a_run_is_dropped_once_when_another_is_awaited():
    viewer = EmptyViewer(is_empty=False)
    assert viewer.update() == ['history', 'robot', 'panel', 'plots']
    assert viewer.update()[4:] == ['sent', 'tuned']


def test_a_run_that_waits_for_its_start_begins_when_a_page_has_drawn_the_robot():
    waiting = PlantReport('1 a', is_paused=True, awaits_start=True)
    for report, is_drawn, done in (
        (waiting, True, ['start']),
        (waiting, False, []),
        (replace(waiting, run='1 b'), True, []),
        (replace(waiting, awaits_start=False), True, []),
    ):
        viewer = EmptyViewer(report=report, is_drawn=is_drawn)
        assert viewer.update() == done, (report, is_drawn)


def test_the_requests_of_a_page_reach_stick_and_plant():
    """A press is carried out during what the newest report about the run says."""
    for report, done in (
        (None, ['pause, paused: False', 'hold']),
        (PlantReport('1 a', is_paused=True), ['pause, paused: True', 'hold']),
        (PlantReport('1 b', is_paused=True), ['pause, paused: False', 'hold']),
    ):
        viewer = EmptyViewer(report=report, requests=(Press(PAUSE), Hold(0, 1.0, 0.0, 0.0)))
        assert viewer.update() == done, report


def test_the_plant_of_another_run_has_not_been_lost():
    viewer = EmptyViewer()
    viewer.node._newest.run.name = '1 b'
    assert viewer.update() == ['another plant']


def test_an_unknown_map_is_refused_and_an_empty_one_is_no_floor():
    node = bare(Viewer, parameters=ViewerParameters())
    assert node._load_floor() is None
    node.check(ViewerParameters())
    with pytest.raises(WorldError, match='unknown map'):
        node.check(ViewerParameters(map='mars'))
    node.parameters = ViewerParameters(map='track')
    assert node._load_floor().walls.any()
