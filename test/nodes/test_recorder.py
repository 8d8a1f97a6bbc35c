"""Decisions of the recorder's node about messages that are not those of the run."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from ballbot_ros.messages.participation import RunStatus
from ballbot_ros.nodes.recorder import Recorder


@pytest.mark.parametrize(('run', 'is_noted'), [('1 abc', False), ('2 abc', True), ('2 x', False)])
def test_only_the_status_of_the_current_run_says_how_it_ended(run, is_noted):
    required = []
    recorder = SimpleNamespace(
        _run='2 abc',
        _status=RunStatus(run, is_lockstep=False, periodic_topics=(), participants={},
                          result={'outcome': 'failed'}),
        _gate=SimpleNamespace(is_lockstep=True),
        _ticks=SimpleNamespace(require=required.append),
        _channels={},
        _outcome={},
        _members={},
    )  # fmt: skip
    Recorder._take_status(recorder)
    assert len(required) == is_noted
    assert recorder._outcome == ({'outcome': 'failed'} if is_noted else {})
    assert recorder._gate.is_lockstep is not is_noted


RELIABLE, BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
LATCHED, VOLATILE = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE


@pytest.mark.parametrize(
    ('offered', 'requested'),
    [
        ([(RELIABLE, LATCHED)], (RELIABLE, LATCHED)),
        ([(RELIABLE, LATCHED), (RELIABLE, VOLATILE)], (RELIABLE, VOLATILE)),
        ([(BEST_EFFORT, VOLATILE), (RELIABLE, LATCHED)], (BEST_EFFORT, VOLATILE)),
        ([(RELIABLE, VOLATILE), (BEST_EFFORT, LATCHED)], (BEST_EFFORT, VOLATILE)),
    ],
)
def test_a_topic_is_recorded_from_each_of_its_publishers(offered, requested):
    offers = [
        SimpleNamespace(
            node_namespace='/',
            node_name='talker',
            topic_type='std_msgs/msg/String',
            qos_profile=QoSProfile(depth=1, reliability=reliability, durability=durability),
        )
        for reliability, durability in offered
    ]
    subscribed = []
    recorder = SimpleNamespace(
        _channels={},
        _refused=set(),
        _sighted=set(),
        _histories=set(),
        _publishers_of=lambda topic: set(),
        _subscribe=lambda topic, qos: subscribed.append((topic.name, qos)),
        get_topic_names_and_types=lambda: [('/talk', ['std_msgs/msg/String'])],
        get_publishers_info_by_topic=lambda name: offers,
    )
    Recorder._discover(recorder)
    ((name, qos),) = subscribed
    assert (name, qos.reliability, qos.durability) == ('/talk', *requested)
