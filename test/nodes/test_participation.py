"""A node's announcements in the runs of a plant, without the graph."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from std_msgs.msg import Header

from ballbot_ros.messages.participation import decode_announcement
from ballbot_ros.nodes import participation
from ballbot_ros.nodes.participation import Participation
from ballbot_ros.parameters import GYRO, GyroParameters
from ballbot_ros.simulation.participants import Objection

CONFLICT = Objection.to_sample('gyro', 1_000_000_000)


@pytest.fixture
def node(monkeypatch):
    monkeypatch.setattr(participation, 'guid_prefix', lambda node, instance: '')
    announced = []
    return SimpleNamespace(
        role=GYRO,
        program='GyroDriver',
        parameters=GyroParameters(),
        now_ns=0,
        announced=announced,
        get_fully_qualified_name=lambda: f'/{GYRO}',
        get_logger=lambda: SimpleNamespace(info=lambda text: None),
        output=lambda topic: SimpleNamespace(
            publish=lambda data: announced.append(decode_announcement(data))
        ),
        subscribe=lambda topic, callback: None,
        apply_parameters=lambda: None,
        recreate_publishers=lambda exclude: None,
    )


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


def test_a_repeated_objection_is_told_once(node):
    member = Participation(node)
    member._on_roll_call(Header(frame_id='1 abc'))
    for _ in range(3):
        member.raise_objection(CONFLICT)
    assert [each.objection for each in node.announced] == [None, CONFLICT]
