"""The channels of a recording for messages that no node publishes."""

from __future__ import annotations

from collections.abc import Callable

from ballbot_ros.messages.outputs import Send
from ballbot_ros.messages.topics import HISTORY, Topic
from ballbot_ros.recording.qos import QosProfile
from ballbot_ros.recording.rosbag2 import RecordedTopic
from ballbot_ros.recording.writer import RecordingWriter
from ballbot_ros.viewer.derived_messages import DerivedMessages, Shape

PERIOD_NS = 40_000_000
"""Period of the derived messages: a rate for tools, of which some interpolate poses."""


class DerivedChannels:
    """Writes derived messages to a recording, marked as such, while nobody publishes their topic.

    Parameters
    ----------
    writer : RecordingWriter
    shape : PlantParameters or VisualizerParameters
        As in `DerivedMessages`.
    name_of : callable
        Returns the full name of a topic.
    is_published : callable
        Returns whether a node publishes the topic of a full name.
    """

    def __init__(
        self,
        writer: RecordingWriter,
        shape: Shape,
        *,
        name_of: Callable[[Topic], str] = Topic.resolved,
        is_published: Callable[[str], bool] = lambda name: False,
    ) -> None:
        self._writer, self._name_of, self._is_published = writer, name_of, is_published
        self._messages = DerivedMessages(self._make_send, shape)
        self._due_ns = 0

    def add(self, topic: Topic, stamp_ns: int, data: bytes) -> None:
        """Process a message that was recorded on one of `DerivedMessages.INPUTS`."""
        messages = self._messages
        messages.add(topic, stamp_ns, data)
        if stamp_ns >= self._due_ns or not messages.sent_ns:
            messages.send(self._due_ns if messages.sent_ns else 0)
            self._due_ns = messages.sent_ns - messages.sent_ns % PERIOD_NS + PERIOD_NS

    def _make_send(self, topic: Topic) -> Send:
        name = self._name_of(topic)
        recorded: RecordedTopic | None = None

        def send(stamp_ns: int, data: bytes) -> None:
            nonlocal recorded
            if self._is_published(name):
                return
            if recorded is None:
                qos = (_offered_qos(topic),)
                recorded = self._writer.add_topic(name, topic.type_name, qos=qos, derived=True)
            self._writer.write(recorded, stamp_ns, data, recorded.count + 1)

        return send


def _offered_qos(topic: Topic) -> QosProfile:
    """Return the QoS with which a node of this package would publish the topic."""
    durability = 'transient_local' if topic.latched_depth else 'volatile'
    return QosProfile('keep_last', topic.latched_depth or HISTORY, 'reliable', durability)
