"""The viewer's decisions, without ROS and page."""

from types import SimpleNamespace

import pytest
from robot import DIMENSIONS

pytest.importorskip('rclpy')

from ballbot_ros.messages.conversions import encode_joy
from ballbot_ros.messages.topics import PLANT_IMU, PLANT_ODOM, SOUND
from ballbot_ros.nodes import viewer
from ballbot_ros.nodes.viewer import Viewer
from ballbot_ros.parameters import PlantParameters, ViewerParameters
from ballbot_ros.timing import MILLISECOND_NS, SECOND_NS
from ballbot_ros.viewer.real_time_factor import RealTimeFactor
from ballbot_ros.viewer.snapshot import History, Snapshot


def stub_viewer(**attributes):
    """Return a viewer that has only these attributes."""
    node = Viewer.__new__(Viewer)
    vars(node).update(attributes)
    return node


def test_released_sticks_are_published_as_neutral_once():
    """Other inputs take over at once, and a page at rest does not disturb them."""
    held = iter([None, (0.5, 0.0), None, None])
    sent = []
    node = stub_viewer(
        _controls=SimpleNamespace(drive=lambda now_s: next(held)),
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
        node = stub_viewer(
            _newest={SOUND: stamp_ns}, _panel=SimpleNamespace(play=played.append), now_ns=SECOND_NS
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
    shown = []
    for own, published, floor in (
        (None, None, None),
        (None, 'published', 'published'),
        ('own', 'published', 'own'),
    ):
        history = History()
        history.add(SNAPSHOT)
        node = stub_viewer(
            _history=history,
            _load_floor=lambda own=own: own,
            _page=SimpleNamespace(show_floor=lambda *arguments: shown.append(arguments)),
            _requests=SimpleNamespace(plant_parameters=lambda names, take: None),
            apply_parameters=lambda: None,
            parameters=ViewerParameters(),
        )
        node._begin(SNAPSHOT, published)
        assert shown.pop() == (floor, (1.5, -0.5)), (own, published)
        assert history.trail() == []


def test_the_robot_is_shown_with_the_dimensions_of_the_plant():
    shown = []
    node = stub_viewer(
        _controls=SimpleNamespace(show_scenario=lambda name: None),
        _newest={PLANT_IMU: None, PLANT_ODOM: None},
        _page=SimpleNamespace(dimensions=DIMENSIONS, show_robot=shown.append),
    )
    node._take_parameters(PlantParameters())
    assert shown == []
    node._take_parameters(PlantParameters(body_height=0.3))
    assert [dimensions.body_height for dimensions in shown] == [0.3]


def test_a_run_whose_plant_is_gone_has_ended():
    shown = []
    for lost_plant in (False, True):
        node = stub_viewer(
            _controls=SimpleNamespace(offer_scenarios=lambda offer: None),
            _history=History(),
            _newest=SimpleNamespace(take=lambda: (SNAPSHOT, set())),
            _page=SimpleNamespace(has_clients=True, update_cameras=lambda snapshot: None),
            _panel=SimpleNamespace(show=lambda snapshot, *_: shown.append(snapshot.state)),
            _panel_period=1,
            _real_time_factor=RealTimeFactor(),
            _requests=SimpleNamespace(
                send_queued=lambda: None, lost_plant=lost_plant, can_start=False
            ),
            _robot=SimpleNamespace(show=lambda snapshot: None, show_trail=lambda trail: None),
            _updates=0,
        )
        node._update()
    assert shown == ['remote', 'run ended']
