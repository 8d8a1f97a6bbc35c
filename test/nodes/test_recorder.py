"""Decisions of the recorder's node about messages that are not those of the run."""

from types import SimpleNamespace

import pytest
from graph import wait_for

rclpy = pytest.importorskip('rclpy')

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy  # noqa: E402

from ballbot_ros.messages.conversions import encode_header  # noqa: E402
from ballbot_ros.messages.participation import RunStatus  # noqa: E402
from ballbot_ros.messages.topics import RUN, RUN_STATUS  # noqa: E402
from ballbot_ros.nodes.recorder import Recorder  # noqa: E402
from ballbot_ros.nodes.recorder_channels import Channel, Channels  # noqa: E402
from ballbot_ros.parameters import RecorderParameters  # noqa: E402

ANNOUNCED = encode_header(1_000_000_000, '1 abc')
MALFORMED = (ANNOUNCED[:7], ANNOUNCED.replace(b'abc', b'\xff\xff\xff'))


@pytest.mark.graph
def test_a_malformed_announcement_of_a_run_is_ignored(domain, monkeypatch, tmp_path):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    rclpy.init()
    try:
        recorder = Recorder(RecorderParameters(output=str(tmp_path / 'run.mcap')))
        publisher = recorder.create_publisher(RUN.message_class, RUN.name, 10)

        def has_begun():
            for data in (*MALFORMED, ANNOUNCED):
                publisher.publish(data)
            recorder._poll()
            return recorder._run == '1 abc'

        wait_for(has_begun, what='the run')
        recorder.close()
        recorder.destroy_node()
    finally:
        rclpy.try_shutdown()


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
    channels = SimpleNamespace(
        _channels={},
        _sighted=set(),
        _ignored=set(),
        _publishers_of=lambda topic: set(),
        _subscribe=lambda topic, qos: subscribed.append((topic.name, qos)),
        _node=SimpleNamespace(
            get_topic_names_and_types=lambda: [('/talk', ['std_msgs/msg/String'])],
            get_publishers_info_by_topic=lambda name: offers,
        ),
    )
    Channels.discover(channels)
    ((name, qos),) = subscribed
    assert (name, qos.reliability, qos.durability) == ('/talk', *requested)


@pytest.mark.parametrize(
    ('counts', 'has_several'),
    [
        ({'/plant/run_status': 1, '/plant/run_status/_history': 1}, False),
        ({'/plant/run_status': 2, '/plant/run_status/_history': 1}, True),
        ({'/plant/run_status': 1, '/plant/run_status/_history': 2}, True),
    ],
)
def test_a_stranger_may_publish_on_a_topic_or_on_its_history(counts, has_several):
    subscriptions = [SimpleNamespace(topic_name=name) for name in counts]
    channel = Channel(RUN_STATUS, *subscriptions)
    recorder = SimpleNamespace(
        _channels={channel.stream.name: channel}, count_publishers=counts.__getitem__
    )
    assert Recorder.has_several_publishers(recorder, channel.stream) is has_several


def test_a_malformed_status_is_reported_and_changes_nothing():
    warned = []
    recorder = SimpleNamespace(
        warn_malformed=lambda topic, error: warned.append(topic), _status='known'
    )
    Recorder._note_status(recorder, RUN.message_class.__name__.encode())
    assert warned == [RUN_STATUS]
    assert recorder._status == 'known'
