"""Decisions of the recorder's node about messages that are not those of the run."""

import math
from types import SimpleNamespace

import pytest
from graph import wait_for

rclpy = pytest.importorskip('rclpy')

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy  # noqa: E402
from stubs import bare  # noqa: E402

from ballbot_ros.errors import RecordingError  # noqa: E402
from ballbot_ros.lockstep.lockstep import RunIdentity, SampleStatus  # noqa: E402
from ballbot_ros.nodes import recorder  # noqa: E402
from ballbot_ros.nodes.recorder import RecordedChannel, RecordedChannels, Recorder  # noqa: E402
from ballbot_ros.parameters import RecorderParameters  # noqa: E402
from ballbot_ros.recording.messages.conversions import encode_duty, encode_header, encode_stop  # noqa: E402
from ballbot_ros.recording.messages.raw import decoder  # noqa: E402
from ballbot_ros.recording.messages.topics import (  # noqa: E402
    CLOCK,
    JOY,
    LCD,
    MARKERS,
    MOTOR_DUTY,
    PARTICIPANTS,
    PLANT_IMU,
    RUN,
    RUN_STATUS,
    Topic,
)
from ballbot_ros.recording.rosbag2 import RELIABLE_LATCHED, QosProfile  # noqa: E402
from ballbot_ros.recording.writer import RUN_PARTICIPANTS  # noqa: E402

ANNOUNCED = encode_header(1_000_000_000, '1 abc')
MALFORMED = (ANNOUNCED[:7], ANNOUNCED.replace(b'abc', b'\xff\xff\xff'))


@pytest.mark.graph
def test_a_malformed_announcement_of_a_run_is_ignored(domain, monkeypatch, tmp_path):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    rclpy.init()
    try:
        recorder = Recorder(RecorderParameters(output=str(tmp_path / 'run.mcap')))
        publisher = recorder.create_publisher(RUN.message_class, RUN.name, 10)

        def has_begun():
            for data in (*MALFORMED, ANNOUNCED):
                publisher.publish(data)
            recorder._poll()
            return recorder._recording.run == '1 abc'

        wait_for(has_begun, what='the run')
        recorder.close()
        recorder.destroy_node()
    finally:
        rclpy.try_shutdown()


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
        _subscribe=lambda topic, qos: subscribed.append((topic.name, qos)),
        _node=SimpleNamespace(
            get_topic_names_and_types=lambda: [('/talk', ['std_msgs/msg/String'])],
            get_publishers_info_by_topic=lambda name: offers,
        ),
    )
    RecordedChannels.discover(channels)
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
    channel = RecordedChannel(RUN_STATUS, *subscriptions)
    recorder = SimpleNamespace(
        _channels={channel.stream.name: channel}, count_publishers=counts.__getitem__
    )
    assert Recorder.has_several_publishers(recorder, channel.stream) is has_several


def test_a_malformed_status_is_reported_and_changes_nothing():
    warned = []
    recorder = SimpleNamespace(
        warn_malformed=lambda topic, error: warned.append(topic),
        _recording=SimpleNamespace(note_status=warned.append),
    )
    Recorder._note_status(recorder, RUN.message_class.__name__.encode())
    assert warned == [RUN_STATUS]


def channel_of(topic, *, history=None):
    subscriptions = [SimpleNamespace(topic_name=f'/{topic.name}')]
    return RecordedChannel(topic, *subscriptions, history)


def test_a_topic_is_recorded_as_its_publishers_use_it():
    """Live topics can't hold messages of an earlier run; only the plant and tools publish these."""
    for topic, is_clock, is_live, is_shared, is_stamped in (
        (CLOCK, True, True, False, True),
        (PLANT_IMU, False, True, False, True),
        (MOTOR_DUTY, False, False, False, True),
        (JOY, False, True, True, False),
    ):
        channel = channel_of(topic)
        stream = channel.stream
        found = stream.is_clock, stream.is_live, channel.is_stamped
        assert found == (is_clock, is_live, is_stamped), topic.name
        stream.has_lost_before(1)
        assert stream.has_lost_before(5) is not is_shared, topic.name
        classified = [stream.classify(8, encode_duty(8, (1, 2)), number) for number in (6, 7)]
        assert (classified[1] is SampleStatus.NEW) == (not topic.period_ns), topic.name
    assert not channel_of(Topic('talk', 'std_msgs/msg/Header', None)).is_stamped


def test_messages_are_read_from_the_history_once_there_is_one(monkeypatch):
    waiting, publishers = {}, 0
    monkeypatch.setattr(recorder, 'drain', lambda source: waiting[source.topic_name])
    history = SimpleNamespace(topic_name='/lcd/_history', get_publisher_count=lambda: publishers)
    channel = channel_of(LCD, history=history)
    assert channel.topic_names == ['/lcd', '/lcd/_history']
    info = {'publication_sequence_number': 3, 'received_timestamp': 5}
    for publishers, expected in ((0, [b'topic']), (1, [b'history']), (0, [b'history'])):  # noqa: B007
        waiting = {
            '/lcd': iter([(b'topic', info)]),
            '/lcd/_history': iter([(b'history', info)] if b'history' in expected else []),
        }
        assert list(channel.take()) == [(5, (channel, data, 3)) for data in expected]
    channel.begin()
    waiting = {'/lcd': iter([(b'topic', info)]), '/lcd/_history': iter([])}
    assert list(channel.take()) == [(5, (channel, b'topic', 3))]
    channel = channel_of(LCD)
    waiting = {'/lcd': iter([(b'topic', info)])}
    assert list(channel.take()) == [(5, (channel, b'topic', 3))]


def offer(node, type_name='std_msgs/msg/String'):
    return SimpleNamespace(
        node_namespace='/', node_name=node, topic_type=type_name, qos_profile=QoSProfile(depth=1)
    )


def discovered(graph, *, looks=2, refusals=0):
    """Return the topics that a recorder subscribes to in a graph, and its warnings."""
    subscribed, warnings, refused = [], [], iter(range(refusals))

    def subscribe(topic, qos):
        if next(refused, None) is not None:
            raise RuntimeError('incompatible type')
        subscribed.append(topic.name)
        channels._channels[topic.name] = None

    node = SimpleNamespace(
        get_topic_names_and_types=lambda: [(name, []) for name in graph],
        get_publishers_info_by_topic=lambda name: graph.get(f'/{name.lstrip("/")}', []),
        get_logger=lambda: SimpleNamespace(warning=lambda text, **_: warnings.append(text)),
    )
    channels = bare(
        RecordedChannels, _channels={'/known': None}, _sighted=set(), _ignored={'/own'},
        _subscribe=subscribe, _node=node,
    )  # fmt: skip
    for _ in range(looks):
        channels.discover()
    return subscribed, warnings


def test_other_topics_are_recorded_except_those_of_unknown_types():
    drawing, unknown = f'/{MARKERS.name}', '_NODE_NAME_UNKNOWN_'
    graph = {
        drawing: [offer('visualizer'), offer('other')],
        '/known': [offer('talker')],
        '/own': [offer('talker')],
        '/silent': [],
        '/strange': [offer('talker', 'no_msgs/msg/Such')],
        '/talk': [offer('talker')],
    }
    expected = [drawing, '/talk'], ['/strange: type no_msgs/msg/Such not found: not recorded']
    assert discovered(graph) == expected
    # A node may be discovered later than its publisher.
    graph = {'/talk': [offer(unknown)]}
    assert discovered(graph, looks=1) == ([], [])
    assert discovered(graph, looks=3) == (['/talk'], [])
    # Another node of the process may read a topic with another type until it adapts.
    subscribed, warnings = discovered({'/talk': [offer('talker')]}, refusals=1)
    assert (subscribed, len(warnings)) == (['/talk'], 1)
    assert warnings[0].startswith('/talk: not recorded yet: another node of this process reads it')


def test_the_qos_of_a_topic_without_publishers_is_the_usual_one():
    offers = []
    channels = SimpleNamespace(
        _node=SimpleNamespace(get_publishers_info_by_topic=lambda name: offers)
    )
    assert RecordedChannels.offered_qos(channels, '/talk') == [RELIABLE_LATCHED]
    offers.append(offer('talker'))
    assert RecordedChannels.offered_qos(channels, '/talk') == [
        QosProfile.from_rclpy(offers[0].qos_profile)
    ]


def stub_recorder(events, recording=None, **attributes):
    """Return a recorder with these attributes, which stores its calls in `events`."""

    def note(name):
        return lambda *given: events.append((name, *given))

    given = {
        'exit_status': 0, '_lost': 0, '_await_end': note('await'), '_fail': note('fail'),
        '_recording': SimpleNamespace(
            **{
                'outcome': {}, 'members': {}, 'write_stop': lambda: None,
                'gate': SimpleNamespace(complete_from_ns=0),
            } | (recording or {})
        ),
        'flush': note('flush'), 'warn': note('warn'),
        '_channels': SimpleNamespace(close=note('leave')),
        'get_logger': lambda: SimpleNamespace(info=note('log')),
        '_writer': SimpleNamespace(
            path='run.mcap', close=note('close'), add_metadata=note('metadata'),
            add_outcome=note('outcome'), mark_incomplete=note('incomplete'),
        ),
    }  # fmt: skip
    return bare(Recorder, **given | attributes)


def test_a_recording_is_finished_before_the_recorder_leaves():
    finished = [('await',), ('close',), ('log', 'finished run.mcap'), ('flush', PARTICIPANTS)]
    for status, outcome, written, lines in (
        (0, {}, ['stop'], finished),
        (0, {'outcome': 'failed'}, ['stop', ('outcome', {'outcome': 'failed'})], finished),
        (1, {'outcome': 'failed'}, [], [each for each in finished if each[0] != 'log']),
    ):
        events = []
        recording = {
            'outcome': outcome, 'write_stop': lambda events=events: events.append('stop')
        }  # fmt: skip
        node = stub_recorder(events, recording, exit_status=status)
        node.close()
        assert events == [lines[0], *written, *lines[1:], ('leave',)], (status, outcome)


def test_a_recording_that_can_not_be_finished_fails():
    def fail():
        raise RecordingError('full')

    events = []
    node = stub_recorder(events)
    node._writer.close = fail
    node._fail = lambda error: events.append(str(error)) or vars(node).update(exit_status=1)
    node.close()
    assert events == [('await',), 'full', ('flush', PARTICIPANTS), ('leave',)]


def test_participants_outcome_and_gaps_are_noted_in_the_file():
    for lost, gaps in ((0, None), (1, '1 gap'), (2, '2 gaps')):
        events = []
        node = stub_recorder(events, {'members': {'gyro': 'it'}, 'outcome': {'outcome': 'failed'}})
        for number in range(lost):
            node.report_loss(SimpleNamespace(name='/gyro'), number)
        assert [each for each in events if each[0] == 'warn'] == [
            ('warn', f'/gyro: messages before sequence number {number} were lost')
            for number in range(lost)
        ]
        del events[:lost]
        node._write_metadata()
        assert events == [
            ('metadata', RUN_PARTICIPANTS, {'gyro': 'it'}),
            ('outcome', {'outcome': 'failed'}),
            *([('incomplete', f'{gaps} in the sequence of messages')] if gaps else []),
        ]
        node._recording.gate.complete_from_ns = 1_196_000_000
        node._write_metadata()
        late = ('incomplete', 'complete only from 1.196 s on: recorded from mid-run')
        assert events.count(late) == 1
        node._recording.ticks = SimpleNamespace(acked_ns=1_500_000_000)
        assert node.diagnose() == {
            'file': 'run.mcap', 'acknowledged [s]': '1.500', 'lost messages': lost,
        }  # fmt: skip


def test_each_message_goes_to_the_recording_as_what_it_is():
    events = []

    def note(name, answer=None):
        return lambda *given: events.append((name, *given)) or answer

    node = stub_recorder(
        events,
        {
            'announces': lambda run: run.name == '1 abc' and not events.append(run),
            'hold_stop': note('stop'),
            'gate': SimpleNamespace(take=lambda *given: events.append(given[1::2])),
        },
        _decode_run=decoder(RUN.type_name),
        _note_status=note('status'),
    )
    run, duty, status, joy = map(channel_of, (RUN, MOTOR_DUTY, RUN_STATUS, JOY))
    for channel, data, expected in (
        (run, ANNOUNCED, [RunIdentity('1 abc', 1_000_000_000), (1_000_000_000, 7)]),
        (run, encode_header(2_000_000_000, '2 abc'), []),
        (status, b'status', [('status', b'status'), (0, 7)]),
        (duty, encode_duty(8, (1, 2)), [(8, 7)]),
        (duty, encode_stop(9), [('stop', duty.stream, 9, encode_stop(9), 7)]),
        (joy, b'of any clock', [(0, 7)]),
    ):
        node._take(channel, data, 7)
        assert events == expected, channel.topic.name
        events.clear()


def test_the_rest_of_a_run_is_not_acknowledged_to_the_plant_of_the_next():
    for how, expected in (
        ('_poll', [('write',), ('ack',)]),
        # Nothing that has arrived before is held back for the next run.
        ('_on_run', [('write', math.inf), ('begin',)]),
    ):
        events = []
        recording = {
            'run': '1 abc', 'ticks': SimpleNamespace(advance=lambda: True),
            'join': lambda run, events=events: events.append(('begin',)),
        }  # fmt: skip
        node = stub_recorder(
            events, recording,
            _order=SimpleNamespace(
                merge=lambda unread, until_ns, events=events: note_write(events, until_ns)
            ),
            _channels=Streams(), _send_ack=lambda events=events: events.append(('ack',)),
        )  # fmt: skip
        getattr(node, how)(*([RunIdentity('1 next', 1)] if how == '_on_run' else []))
        assert events == expected, how


class Streams(list):
    """No channels of a recorder."""

    def take(self):
        return {}


def note_write(events, until_ns):
    events.append(('write', until_ns) if until_ns == math.inf else ('write',))
    return []


def test_a_recorder_that_is_stopped_with_its_run_awaits_the_end(monkeypatch):
    """It waits at most a second, and only for a run that is under way."""
    now_s = [0.0]
    monkeypatch.setattr(
        recorder,
        'time',
        SimpleNamespace(
            monotonic=lambda: now_s[0],
            sleep=lambda delay_s: now_s.__setitem__(0, now_s[0] + delay_s),
        ),
    )
    for is_under_way, status, ends_s, waited_s in (
        (True, 0, 9.0, recorder.END_S),
        (True, 0, 0.2, 0.2),
        (True, 0, 0.0, 0.0),
        (False, 0, 9.0, 0.0),
        (True, 1, 9.0, 0.0),
    ):
        now_s[0], looks = 0.0, []

        def write(until, looks=looks, ends_s=ends_s):
            looks.append(until)
            if now_s[0] >= ends_s:
                node._recording.is_under_way = False  # noqa: B023

        node = stub_recorder(
            [], {'is_under_way': is_under_way}, exit_status=status, _write_until=write,
            _acknowledge=lambda: None,
        )  # fmt: skip
        Recorder._await_end(node)
        assert now_s[0] == pytest.approx(waited_s, abs=0.011), (is_under_way, status)
        assert set(looks) == {math.inf}


def test_a_topic_of_a_type_that_is_not_installed_does_not_count_as_published():
    """So its derived messages are recorded."""
    channels = bare(
        RecordedChannels, _ignored={'/tf'},
        _node=SimpleNamespace(count_publishers={'/tf': 1, '/markers': 1, '/odom': 0}.get),
    )  # fmt: skip
    assert [channels.is_published(name) for name in ('/tf', '/markers', '/odom')] == [
        False, True, False,
    ]  # fmt: skip
