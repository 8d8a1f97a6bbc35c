"""A node's announcements in the runs of a plant, without the graph."""

import hashlib
from contextlib import ExitStack
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from builtin_interfaces.msg import Time
from std_msgs.msg import Header

from ballbot_ros import __version__
from ballbot_ros.lockstep.participants import MAP_HASH, Objection
from ballbot_ros.nodes import participation
from ballbot_ros.nodes.participation import Participation
from ballbot_ros.parameters import GYRO, ControllerParameters, GyroParameters, SonarParameters
from ballbot_ros.parameters.timing import FIRST_TICK_NS
from ballbot_ros.recording.messages.run_reports import decode_announcement
from ballbot_ros.recording.messages.topics import GYRO_IMU, PARTICIPANTS
from ballbot_ros.robot.world.floor_map import read_map_file

CONFLICT = Objection.to_sample('gyro', 1_000_000_000)


@pytest.fixture
def node(monkeypatch):
    monkeypatch.setattr(participation, 'guid_prefix', lambda node, instance: '')
    announced, dropped = [], []
    stack = ExitStack()
    yield SimpleNamespace(
        role=GYRO,
        program='GyroDriver',
        context=SimpleNamespace(get_domain_id=lambda: 0),
        get_namespace=lambda: '/test',
        on_destroy=stack,
        parameters=GyroParameters(),
        now_ns=0,
        announced=announced,
        announced_values=lambda: {'code': 'abc'},
        get_fully_qualified_name=lambda: f'/{GYRO}',
        get_logger=lambda: SimpleNamespace(info=lambda text: None),
        awaited=dict,
        output=lambda topic: SimpleNamespace(
            publish=lambda data: announced.append(decode_announcement(data))
        ),
        subscribe=lambda topic, callback: None,
        apply_parameters=lambda: None,
        dropped=dropped,
        recreate_publishers=lambda *, exclude: dropped.append(exclude),
    )
    stack.close()


def test_an_objection_and_an_answer_concern_only_their_run(node):
    member = Participation(node)
    for run in ('1 abc', '2 abc', '1 xyz'):
        member._on_roll_call(Header(frame_id=run))
        node.now_ns = 5
        member.raise_objection(CONFLICT)
        member._on_roll_call(Header(frame_id=run))
    told = [(each.run, each.answered_ns, each.objection) for each in node.announced]
    assert told == [
        announcement
        for run in ('1 abc', '2 abc', '1 xyz')
        for announcement in ((run, 0, None), (run, 5, CONFLICT), (run, 5, CONFLICT))
    ]


def test_a_node_that_another_plant_has_called_away_cannot_continue(node):
    member = Participation(node)
    for run in ('1 abc', '2 abc', '1 xyz', '2 abc', '3 abc'):
        member._on_roll_call(Header(frame_id=run))
    interrupted = Objection("another run, '1 xyz', has interrupted it")
    assert [each.objection for each in node.announced] == [None, None, None, interrupted, None]


def test_a_repeated_objection_is_told_once(node):
    member = Participation(node)
    member._on_roll_call(Header(frame_id='1 abc'))
    for _ in range(3):
        member.raise_objection(CONFLICT)
    assert [each.objection for each in node.announced] == [None, CONFLICT]


def test_messages_of_an_earlier_plant_are_dropped_but_not_those_of_its_earlier_run(node):
    member = Participation(node)
    for run, count in (('1 abc', 0), ('2 abc', 0), ('1 xyz', 1)):
        member._on_roll_call(Header(frame_id=run))
        assert node.dropped == [PARTICIPANTS] * count, run


def test_nothing_is_announced_before_a_run_and_only_its_samples_belong_to_it(node):
    member = Participation(node)
    member.raise_objection(CONFLICT)
    assert node.announced == []
    assert not member.includes(FIRST_TICK_NS)
    member._on_roll_call(Header(frame_id='1 abc', stamp=Time(sec=1)))
    assert [member.includes(FIRST_TICK_NS + each) for each in (-1, 0, 1)] == [False, True, True]


def test_a_node_announces_the_parameters_of_its_run_but_no_path(node, tmp_path):
    path = tmp_path / 'floor.png'
    path.write_bytes(read_map_file('track'))
    runs = []
    member = Participation(node, runs.append, lambda: runs.append('called'))
    for run, parameters in (
        ('1 abc', GyroParameters(seed=7)),
        ('2 abc', SonarParameters(map=str(path))),
    ):
        node.parameters = parameters
        member._on_roll_call(Header(frame_id=run))
    first, second = (each.participant for each in node.announced)
    assert first.parameters['seed'] == 7
    assert first.parameters['code'] == 'abc'
    assert MAP_HASH not in first.parameters
    assert second.parameters['map'] == 'floor.png'
    assert second.parameters[MAP_HASH] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert first.parameters_sha256 != second.parameters_sha256
    assert first.implementation == f'ballbot_ros {__version__} GyroDriver'
    assert first.topics == (GYRO_IMU.name,)
    assert [getattr(run, 'name', run) for run in runs] == ['1 abc', 'called', '2 abc', 'called']


def test_the_folder_of_a_controllers_file_is_not_announced(node):
    node.parameters = ControllerParameters(implementation='/home/me/mine.py:Mine')
    Participation(node)._on_roll_call(Header(frame_id='1 abc'))
    (announced,) = (each.participant.parameters for each in node.announced)
    assert announced['implementation'] == 'mine.py:Mine'
