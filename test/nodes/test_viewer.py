"""The viewer's decisions, without ROS and page."""

from types import SimpleNamespace

import pytest
from robot import DIMENSIONS

pytest.importorskip('rclpy')

from stubs import bare

from ballbot_ros.messages.conversions import encode_joy
from ballbot_ros.messages.topics import MAP, PLANT_IMU, PLANT_ODOM, RUN, SOUND
from ballbot_ros.nodes import viewer
from ballbot_ros.nodes.viewer import Viewer
from ballbot_ros.parameters import PlantParameters, ViewerParameters
from ballbot_ros.timing import MILLISECOND_NS, SECOND_NS
from ballbot_ros.viewer.real_time_factor import RealTimeFactor
from ballbot_ros.viewer.snapshot import History, Snapshot
from ballbot_ros.world.errors import WorldError


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
    monkeypatch.setattr(viewer, 'tone_of', lambda message: message)
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


def test_the_start_is_in_the_frame_map():
    assert viewer._start(SimpleNamespace(position=(1.5, 0.5))) == (1.5, -0.5)


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
        _controls=SimpleNamespace(show_scenario=lambda name: None),
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
            _controls=SimpleNamespace(offer_scenarios=lambda *, offer: offered.append(offer)),
            _history=History(),
            _newest=SimpleNamespace(take=lambda: (SNAPSHOT, set())),
            _page=SimpleNamespace(
                dimensions=DIMENSIONS, has_clients=True, update_cameras=lambda snapshot: None
            ),
            _plots=SimpleNamespace(refresh=lambda source: None),
            _start_position=None,
            _panel=SimpleNamespace(show=lambda snapshot, *_: shown.append(snapshot.state)),
            _panel_period=1,
            _real_time_factor=RealTimeFactor(),
            _requests=SimpleNamespace(
                send_queued=lambda: None, lost_plant=lost_plant, can_start=not lost_plant
            ),
            _robot=SimpleNamespace(show=lambda snapshot: None, show_trail=lambda trail: None),
            _take_requests=lambda: None,
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
        _newest=stub_newest({PLANT_ODOM: odometry, MAP: None}, changed),
        _page=SimpleNamespace(has_clients=False),
        _requests=SimpleNamespace(send_queued=lambda: None, lost_plant=False),
        _sound=lambda: done.append('sound'),
        _take_requests=lambda: None,
        _tuning=SimpleNamespace(send_queued=lambda: None),
        _updates=0,
        count_sample=done.append,
    )
    node._update()
    assert done == expected
    assert len(history.trail()) == (PLANT_ODOM in changed)


def stub_newest(messages, changed):
    class Newest(dict):
        def take(self):
            return SNAPSHOT, changed

    return Newest(messages)


def test_a_viewer_that_shows_nothing_yet_sends_its_requests_and_closes_its_page():
    done = []
    node = bare(
        Viewer,
        _newest=SimpleNamespace(take=lambda: (None, set()), close=lambda: done.append('closed')),
        _page=SimpleNamespace(stop=lambda: done.append('stopped')),
        _requests=SimpleNamespace(send_queued=lambda: done.append('sent')),
        _take_requests=lambda: done.append('taken'),
        _tuning=SimpleNamespace(send_queued=lambda: done.append('tuned')),
    )
    node._update()
    node.close()
    assert done == ['taken', 'sent', 'tuned', 'closed', 'stopped']


def test_an_unknown_map_is_refused_and_an_empty_one_is_no_floor():
    node = bare(Viewer, parameters=ViewerParameters())
    assert node._load_floor() is None
    node.check(ViewerParameters())
    with pytest.raises(WorldError, match='unknown map'):
        node.check(ViewerParameters(map='mars'))
    node.parameters = ViewerParameters(map='track')
    assert node._load_floor().walls.any()
