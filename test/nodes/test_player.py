"""Playback: every message as recorded, at the requested rate, and never next to a plant."""

import contextlib
import math
import subprocess
import threading
import time
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import pytest
from graph import BALLBOT, LAST_RESORT_S, environment, record, wait_for

rclpy = pytest.importorskip('rclpy')

from rclpy.context import Context  # noqa: E402
from rclpy.experimental import EventsExecutor  # noqa: E402
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy  # noqa: E402
from std_msgs.msg import Float64  # noqa: E402
from std_srvs.srv import SetBool  # noqa: E402
from stubs import bare  # noqa: E402

from ballbot_ros.errors import BallbotError  # noqa: E402
from ballbot_ros.nodes import player  # noqa: E402
from ballbot_ros.nodes.endpoints import reliable_qos  # noqa: E402
from ballbot_ros.nodes.middleware import DomainLock  # noqa: E402
from ballbot_ros.nodes.player import Player, _is_truth, _qos  # noqa: E402
from ballbot_ros.parameters import PlayerParameters  # noqa: E402
from ballbot_ros.recording.messages.topics import CLOCK, HISTORY, LCD, message_class  # noqa: E402
from ballbot_ros.recording.reader import RecordingReader  # noqa: E402
from ballbot_ros.recording.rosbag2 import QosProfile  # noqa: E402
from ballbot_ros.recording.schemas import encoder, new_message  # noqa: E402
from ballbot_ros.recording.writer import RecordingWriter  # noqa: E402

pytestmark = pytest.mark.graph


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp('run')
    return record(folder, 'stationary', '--set=plant_sim.duration=6.0')[0]


class Listener:
    """Stores the messages on some topics, byte for byte."""

    def __init__(self, domain, topics):
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node('listener', context=self.context)
        self._executor = EventsExecutor(context=self.context)
        self._executor.add_node(self.node)
        self.found = {name: [] for name in topics}
        for name, type_name in topics.items():
            self.node.create_subscription(
                message_class(type_name),
                name,
                self.found[name].append,
                reliable_qos(1000, latched=True),
                raw=True,
            )

        self._done = rclpy.Future()
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self):
        while not self._done.done():
            self._executor.spin_until_future_complete(self._done, 0.2)

    def close(self):
        self._done.set_result(None)
        self._thread.join()
        self._executor.shutdown()  # the executor would keep subscriptions and participant alive
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def listen(domain):
    listeners = []

    def start(topics):
        listeners.append(Listener(domain, topics))
        return listeners[-1]

    yield start
    for listener in listeners:
        listener.close()


def recorded(path, start_ns):
    with RecordingReader(path) as reader:
        # Without derived ones, whose types may not be installed.
        messages = {topic: [] for topic in reader.topics().keys() - reader.derived()}
        for message in reader.raw_messages(messages, start_ns):
            messages[message.topic].append(message.data)
        return messages, {name: reader.topics()[name].type_name for name in messages}


def test_messages_are_published_as_recorded(recording, domain, listen):
    # Play slowly: a publisher keeps 128 messages for a listener delayed by a busy machine, which at
    # this rate is 2 s.
    expected, types = recorded(recording, 6_500_000_000)
    listener = listen(types)
    begun = time.monotonic()
    player = subprocess.Popen(
        [*BALLBOT, 'play', recording, '--start', '5.5', '--rate', '0.25'],
        env=environment(domain), stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        wait_for(lambda: listener.found['/clock'])
        (offer,) = listener.node.get_publishers_info_by_topic('/plant/imu')
        assert offer.qos_profile.reliability == ReliabilityPolicy.RELIABLE
        assert offer.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        wait_for(lambda: player.poll() is not None)
        assert time.monotonic() - begun > 0.8 * 0.5 / 0.25
        wait_for(lambda: len(listener.found['/clock']) == len(expected['/clock']))
    finally:
        player.kill()
        _, errors = player.communicate()
    assert (player.returncode, errors) == (0, '')
    for name, messages in expected.items():
        # The middleware pads a message to full words.
        padded = [data + bytes(-len(data) % 4) for data in messages]
        assert listener.found[name] == padded, name


def stands_still(messages):
    before = len(messages)
    time.sleep(0.3)
    return len(messages) == before


def test_pause_and_seek(recording, start_node, listen):
    listener = listen({'/clock': 'rosgraph_msgs/msg/Clock'})
    clock = listener.found['/clock']
    player = start_node('player', file=recording, loop=True)
    wait_for(lambda: len(clock) > 100)
    pause = listener.node.create_client(SetBool, '/player/pause')
    assert pause.wait_for_service(LAST_RESORT_S)
    answer = pause.call_async(SetBool.Request(data=True))
    wait_for(answer.done)
    assert answer.result().message == 'paused'
    wait_for(lambda: stands_still(clock), what='the standstill')
    seek = listener.node.create_publisher(Float64, '/player/seek', 10)
    wait_for(lambda: seek.get_subscription_count() > 0)
    seek.publish(Float64(data=math.nan))  # not a position, and changes nothing
    seek.publish(Float64(data=5.0))
    wait_for(pause.call_async(SetBool.Request(data=False)).done)
    before = len(clock)
    # At 6 s the loop begins again at 1 s: time jumps back.
    seconds = []

    def jumped_back():
        seconds[:] = [int.from_bytes(data[4:8], 'little') for data in clock[before + 1 :]]
        return any(later < earlier for earlier, later in pairwise(seconds))

    wait_for(jumped_back)
    assert {6, 1} <= set(seconds)
    assert player.interrupt() == 0


def test_a_live_plant_is_left_alone(recording, domain, start_node, listen):
    listener = listen({})
    start_node('plant_sim')
    wait_for(lambda: listener.node.count_publishers('/clock') > 0)

    def play(*options):
        return subprocess.run(
            [*BALLBOT, 'play', recording, *options],
            env=environment(domain), check=False, capture_output=True, text=True,
            stdin=subprocess.DEVNULL,
        )  # fmt: skip

    for options in ((), ('--topics', '/plant/odom'), ('--topics', '/clock')):
        result = play(*options)
        assert result.returncode == 2, options
        assert result.stderr.startswith('error: another plant, player or brick_link is running')
        assert result.stderr.count('\n') == 1
    # Topics that no plant publishes may be played next to one.
    assert play('--topics', '/lcd', '--rate', '10').returncode == 0


def test_a_foreign_clock_ends_it(recording, domain, start_node, listen):
    listener = listen({})
    player = start_node('player', file=recording, loop=True)
    wait_for(lambda: listener.node.count_publishers('/clock') > 0)
    listener.node.create_publisher(
        message_class('rosgraph_msgs/msg/Clock'), '/clock', reliable_qos(1, latched=True)
    )
    assert player.finish() == 2
    assert 'a plant publishes /clock' in player.output


@pytest.fixture
def make_player(domain, monkeypatch, tmp_path):
    """Create a player in this process, of a recording that has nothing of a plant."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    path = tmp_path / 'display.mcap'
    with RecordingWriter(path) as writer:
        topic = writer.add_topic(f'/{LCD.name}', LCD.type_name)
        for stamp_ns in (10**9, 2 * 10**9):
            writer.write(topic, stamp_ns, encoder(LCD.type_name)(new_message(LCD.type_name)), 0)
    with contextlib.ExitStack() as stack:

        def make(**values):
            rclpy.init()
            stack.callback(rclpy.try_shutdown)
            player = Player(PlayerParameters(file=str(path), **values))
            stack.callback(player.destroy_node)
            stack.callback(player.close)
            return player

        yield make


def test_a_recording_without_clock_gets_one_and_owns_the_domain(make_player, domain):
    player = make_player()
    with pytest.raises(BallbotError, match='another plant, player or brick_link'):
        DomainLock(domain)
    assert player.count_publishers(CLOCK.name) == 1
    player._watch()
    assert not player.finished, 'its own clock is not a foreign one'


def test_topics_that_no_plant_publishes_leave_clock_and_domain_alone(make_player, domain):
    player = make_player(topics=f' /{LCD.name}, ')
    DomainLock(domain).release()
    assert player.count_publishers(CLOCK.name) == 0


def test_the_clock_stands_still_during_a_pause(make_player):
    player = make_player()
    sent = []
    player._begins_at, player._made_clock = -math.inf, SimpleNamespace(publish=sent.append)
    player.playback.begin(0.0, 0.0)
    for is_paused in (True, False):
        player._pause(SetBool.Request(data=is_paused), SetBool.Response())
        player._play()
        assert bool(sent) is not is_paused


def test_played_messages_count_in_the_diagnostics(make_player):
    player = make_player()
    player._begins_at = -math.inf
    player.playback.begin(0.0, -math.inf)
    player._play()
    assert (player._samples, player.now_ns) == (2, 2 * 10**9)


def test_another_rate_takes_effect_at_once(make_player):
    player = make_player()
    player._begins_at = -math.inf
    player.parameters = replace(player.parameters, rate=2.0)
    player._play()
    assert player.playback.rate == 2.0


def test_a_position_must_be_a_number():
    sought, warned = [], []
    node = bare(
        Player,
        playback=SimpleNamespace(seek=sought.append),
        get_name=lambda: 'player',
        warn=warned.append,
    )
    for position_s in (1.5, math.nan):
        node._seek(SimpleNamespace(data=position_s))
    assert sought == [1.5]
    assert warned == ['player/seek: nan is not a position']


def test_messages_are_played_once_their_time_has_come(monkeypatch):
    """Those of a type that is not installed are skipped. Each row is a moment, and what happens."""
    done, now_s = [], [0.0]
    monkeypatch.setattr(player, 'time', SimpleNamespace(monotonic=lambda: now_s[0]))
    playback = SimpleNamespace(
        rate=1.0,
        finished=False,
        due=lambda now_s: [('/talk', 5, 0, b'a'), ('/strange', 6, 0, b'b')],
    )
    node = bare(
        Player,
        _begins_at=1.0, _made_clock=None, playback=playback, parameters=PlayerParameters(rate=2.0),
        _outputs={'/talk': SimpleNamespace(publish=done.append)}, count_sample=done.append,
        _derived=set(),
        done=SimpleNamespace(done=lambda: False), finish=lambda: done.append('finished'),
    )  # fmt: skip
    played = [b'a', 5, 6]
    for now_s[0], playback.finished, expected in (
        (0.9, True, []), (1.0, False, played), (1.1, True, [*played, 'finished'])
    ):  # fmt: skip
        node._play()
        assert done == expected, now_s
        done.clear()
    node.done = SimpleNamespace(done=lambda: True)
    node._play()
    assert done == []


def test_a_derived_topic_is_played_unless_a_node_publishes_it():
    for others in (0, 1):
        done = []
        node = bare(
            Player,
            _begins_at=-math.inf, _made_clock=None, parameters=PlayerParameters(rate=1.0),
            playback=SimpleNamespace(
                rate=1.0, finished=False,
                due=lambda now_s: [('/tf', 5, 0, b'tf'), ('/talk', 5, 0, b'talk')],
            ),
            _outputs=dict.fromkeys(('/tf', '/talk'), SimpleNamespace(publish=done.append)),
            _derived={'/tf'}, count_publishers=lambda name, others=others: 1 + others,
            count_sample=lambda stamp_ns: None, done=SimpleNamespace(done=lambda: False),
        )  # fmt: skip
        node._play()
        assert done == ([b'talk'] if others else [b'tf', b'talk'])


def test_a_player_flushes_and_closes_what_it_holds():
    done = []
    node = bare(
        Player,
        _outputs={'/talk': SimpleNamespace(wait_for_all_acked=lambda _: done.append(1))},
        _recording=SimpleNamespace(close=lambda: done.append('closed')),
    )
    node.close()
    assert done == [1, 'closed']


def test_a_topic_is_published_with_the_strongest_of_its_recorded_offers():
    weak = QosProfile('unknown', 0, 'best_effort', 'volatile')
    reliable = QosProfile('keep_all', 5, 'reliable', 'volatile')
    latched = QosProfile('keep_last', 7, 'reliable', 'transient_local')
    kept = QosProfile('keep_last', 3, 'best_effort', 'transient_local')
    strongest = reliable_qos(5, latched=True)
    strongest.history = HistoryPolicy.KEEP_ALL
    for offers, expected in (
        ([], reliable_qos(HISTORY, latched=True)),
        ([weak], QoSProfile(depth=HISTORY, reliability=ReliabilityPolicy.BEST_EFFORT)),
        ([weak, reliable], QoSProfile(depth=5, history=HistoryPolicy.KEEP_ALL)),
        ([latched, reliable, weak], reliable_qos(7, latched=True)),
        ([reliable, kept], strongest),
        ([kept, reliable], strongest),
    ):
        found = _qos(offers)
        for name in ('history', 'depth', 'reliability', 'durability'):
            assert getattr(found, name) == getattr(expected, name), (offers, name)


def test_topics_of_a_plant_need_its_domain_in_any_namespace():
    for name, expected in (
        ('/clock', True),
        ('/plant/imu', True),
        ('/robot/plant/imu', True),
        ('/lcd', False),
        ('/joy', False),
    ):
        assert _is_truth(name) == expected, name
