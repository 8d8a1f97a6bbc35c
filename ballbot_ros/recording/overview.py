"""Statistics of the messages in a recording."""

from __future__ import annotations

from dataclasses import dataclass

from ballbot_ros.process import ProgressCallback
from ballbot_ros.recording.reader import RecordingReader


@dataclass
class TopicOverview:
    """Statistics of messages, such as those of a topic.

    Attributes
    ----------
    first_ns, last_ns : int or None
        The oldest and the newest stamp [ns]; None if there are no messages.
    gap_ns, gap_at_ns : int or None
        The longest time between two messages, and its start [ns]; None for fewer than two messages.
    """

    type_name: str
    count: int = 0
    first_ns: int | None = None
    last_ns: int | None = None
    gap_ns: int | None = None
    gap_at_ns: int | None = None

    def add(self, stamp_ns: int) -> None:
        """Count a message."""
        self.count += 1
        if self.first_ns is None or self.last_ns is None:
            self.first_ns = self.last_ns = stamp_ns
            return
        gap = stamp_ns - self.last_ns
        if gap >= 0 and (self.gap_ns is None or gap > self.gap_ns):
            self.gap_ns, self.gap_at_ns = gap, self.last_ns
        self.first_ns = min(self.first_ns, stamp_ns)
        self.last_ns = max(self.last_ns, stamp_ns)

    @property
    def rate_hz(self) -> float | None:
        """The mean rate [Hz]; None for fewer than two different stamps."""
        if self.first_ns is None or self.last_ns is None or self.first_ns == self.last_ns:
            return None
        return (self.count - 1) / ((self.last_ns - self.first_ns) * 1e-9)


def read_topics(
    reader: RecordingReader, stamps_of: str, progress: ProgressCallback
) -> tuple[dict[str, TopicOverview], list[int]]:
    """Read a recording from beginning to end.

    Return the statistics of each topic, and all stamps of the topic `stamps_of` [ns]. `progress` is
    called with the number of messages read and their total.
    """
    topics = {name: TopicOverview(topic.type_name) for name, topic in reader.topics().items()}
    stamps_ns = []
    for done, (topic, stamp_ns, _, _) in enumerate(reader.raw_messages(), 1):
        topics[topic].add(stamp_ns)
        if topic == stamps_of:
            stamps_ns.append(stamp_ns)
        progress(done, reader.count)
    return topics, stamps_ns
