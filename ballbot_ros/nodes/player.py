"""Publishes the messages of a recording, with its /clock."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from typing import Any

from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from std_msgs.msg import Float64
from std_srvs.srv import SetBool

from ballbot_ros.nodes.base import BallbotNode
from ballbot_ros.nodes.endpoints import TopicPublisher, flush, reliable_qos
from ballbot_ros.nodes.middleware import DomainLock
from ballbot_ros.parameters import PLANT, PlayerParameters
from ballbot_ros.recording.messages.conversions import encode_clock
from ballbot_ros.recording.messages.recording_files import open_recording
from ballbot_ros.recording.messages.topics import CLOCK, HISTORY, TOPICS, find_message_class
from ballbot_ros.recording.playback import Playback
from ballbot_ros.recording.rosbag2 import QosProfile

POLL_S = 2e-3
SETTLE_S = 1.0
"""Time to discover a plant on another machine, and to be discovered by readers."""

WATCH_S = 0.5


class Player(BallbotNode[PlayerParameters]):
    """Plays a recording."""

    def __init__(self, parameters: PlayerParameters | None = None) -> None:
        super().__init__(PlayerParameters, parameters)
        self._recording = open_recording(self.parameters.file)
        chosen = [name.strip() for name in self.parameters.topics.split(',') if name.strip()]
        self.playback = Playback(
            self._recording,
            chosen or None,
            rate=self.parameters.rate,
            is_looping=self.parameters.loop,
        )
        recorded = self._recording.topics()
        topics = {name: recorded[name].type_name for name in chosen or recorded}
        self._derived = self._recording.derived()
        # Own the domain like a plant when playing any topic of a plant, or all topics: then the
        # player publishes /clock, even if the recording has none.
        owns_domain = not chosen or any(map(_is_truth, topics))
        if owns_domain:
            self.on_destroy.callback(DomainLock(self.context.get_domain_id()).release)
        self._outputs = {
            name: publisher
            for name, type_name in topics.items()
            if (publisher := self._publisher(name, type_name)) is not None
        }
        self._made_clock: TopicPublisher | None = None
        if not chosen and CLOCK.name not in topics:
            self._made_clock = self.output(CLOCK)
        self._owned_clocks = int(CLOCK.name in self._outputs or self._made_clock is not None)
        if self._recording.damage:
            self.warn(f'{self._recording.path}: {self._recording.damage}; the rest is played')
        self._begins_at = time.monotonic() + SETTLE_S
        self.playback.begin(self.parameters.start, self._begins_at)
        self._clock_ns = self.playback.now_ns
        name = self.get_name()
        self.create_service(SetBool, f'{name}/pause', self._pause)
        self.create_subscription(Float64, f'{name}/seek', self._seek, 10)
        self.create_wall_timer(POLL_S, self._play)
        if owns_domain:
            self.create_wall_timer(WATCH_S, self._watch)

    def _publisher(self, name: str, type_name: str) -> Publisher:
        kind = find_message_class(type_name)
        if kind is None:
            if name in self._derived:
                return None  # as where tf2_msgs is not installed
            problem = f'type {type_name} not found' if type_name else 'its type is unknown'
            self.get_logger().warning(f'{name}: {problem}: not played')
            return None
        return self.create_publisher(kind, name, _qos(self._recording.offered_qos()[name]))

    def _play(self) -> None:
        """Publish the messages that are due."""
        now = time.monotonic()
        if self.finished or now < self._begins_at:
            return
        self.playback.rate = self.parameters.rate
        for topic, stamp_ns, _, data in self.playback.due(now):
            # Another node may publish what is derived in the recording.
            is_elsewhere = topic in self._derived and self.count_publishers(topic) > 1
            if topic in self._outputs and not is_elsewhere:
                self._outputs[topic].publish(data)
            self.count_sample(stamp_ns)
        if self._made_clock and self.playback.now_ns != self._clock_ns:
            self._clock_ns = self.playback.now_ns
            self._made_clock.publish(encode_clock(self._clock_ns))
        if self.playback.finished:
            self.finish()

    def _watch(self) -> None:
        """End if a plant or another player appears in the domain."""
        if self.count_publishers(CLOCK.name) > self._owned_clocks and not self.finished:
            self.finish()
            self.fail('a plant publishes /clock in this ROS domain: set ROS_DOMAIN_ID to another')
            self.exit_status = 2

    def _pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.playback.is_playing = not request.data
        response.success = True
        response.message = 'paused' if request.data else 'playing'
        return response

    def _seek(self, message: Any) -> None:
        if math.isnan(message.data):
            self.warn(f'{self.get_name()}/seek: nan is not a position')
            return
        self.playback.seek(message.data)

    def diagnose(self) -> Mapping[str, object]:
        """Return the playback position."""
        return {
            'file': self._recording.path,
            'position [s]': f'{self.playback.time:.3f}',
            'duration [s]': f'{self.playback.end:.3f}',
            'paused': not self.playback.is_playing,
        }

    def close(self) -> None:
        """Wait until the last messages have reached their readers."""
        flush(self._outputs.values())
        self._recording.close()


def _is_truth(name: str) -> bool:
    """Return whether only a plant, or a player in its place, may publish this topic."""
    own = {f'/{topic.name.lstrip("/")}' for topic in TOPICS if topic.publisher == PLANT}
    return name in own or '/plant/' in name


def _qos(offers: Sequence[QosProfile]) -> QoSProfile:
    """Return the strongest of the recorded offers, latched if any is, for all their readers."""
    if not offers:
        return reliable_qos(HISTORY, latched=True)
    by_durability = sorted(offers, key=lambda each: each.durability != 'transient_local')
    offer = min(by_durability, key=lambda each: each.reliability != 'reliable')
    # Discovery does not report history and depth, so most recordings lack them.
    return QoSProfile(
        history=HistoryPolicy.KEEP_ALL if offer.history == 'keep_all' else HistoryPolicy.KEEP_LAST,
        depth=offer.depth or HISTORY,
        reliability=ReliabilityPolicy[offer.reliability.upper()],
        durability=DurabilityPolicy[by_durability[0].durability.upper()],
        deadline=Duration(nanoseconds=offer.deadline),
        lifespan=Duration(nanoseconds=offer.lifespan),
        liveliness=LivelinessPolicy[offer.liveliness.upper()],
        liveliness_lease_duration=Duration(nanoseconds=offer.liveliness_lease_duration),
    )
