"""Summary of a recording's content."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from ballbot_ros.progress import ProgressCallback
from ballbot_ros.recording.reader import AttachedFile, RecordingReader
from ballbot_ros.recording.rosbag2 import METADATA_NAME
from ballbot_ros.recording.writer import RUN_OUTCOME


@dataclass
class TopicOverview:
    """Statistics of a topic's messages.

    Attributes
    ----------
    type_name : str
    count : int
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


@dataclass
class Overview:
    """Summary of a recording.

    Attributes
    ----------
    path : Path
    size : int
        [byte]
    library : str
        Program that wrote the file.
    being_written : bool
    damage : str or None
        What is missing; None if nothing is known to be missing.
    corruption : str or None
        Where the file is cut off or corrupt.
    topics : dict of str to TopicOverview
    runs_ns : list of int
        First tick of each run that the file announces [ns].
    outcome : dict of str to str
        How the run ended, if known.
    attachments : dict of str to AttachedFile
    metadata : dict of str to dict
        The metadata records, without those that other fields contain.
    """

    path: Path
    size: int
    library: str
    being_written: bool
    damage: str | None
    corruption: str | None
    attachments: dict[str, AttachedFile]
    metadata: dict[str, dict[str, str]]
    outcome: dict[str, str]
    topics: dict[str, TopicOverview] = field(default_factory=dict)
    runs_ns: list[int] = field(default_factory=list)

    @property
    def first_ns(self) -> int | None:
        """The oldest stamp [ns]."""
        return min(
            (t.first_ns for t in self.topics.values() if t.first_ns is not None), default=None
        )

    @property
    def last_ns(self) -> int | None:
        """The newest stamp [ns]."""
        stamps = (topic.last_ns for topic in self.topics.values())
        return max((stamp for stamp in stamps if stamp is not None), default=None)

    @property
    def message_count(self) -> int:
        """The number of messages."""
        return sum(topic.count for topic in self.topics.values())


def read_overview(
    path: Path,
    run_topic: str,
    progress: ProgressCallback = lambda done, total: None,
) -> Overview:
    """Read a recording from beginning to end.

    Parameters
    ----------
    path : Path
    run_topic : str
        The topic that announces a run.
    progress : callable, optional
        Called with the number of messages read and their total.

    Raises
    ------
    RecordingError
        If the file can't be read or is not a recording of ROS 2.
    """
    with RecordingReader(path) as reader:
        topics = {name: TopicOverview(topic.type_name) for name, topic in reader.topics().items()}
        runs: list[int] = []
        for done, (topic, stamp_ns, _, _) in enumerate(reader.raw_messages(), 1):
            topics[topic].add(stamp_ns)
            if topic == run_topic:
                runs.append(stamp_ns)
            progress(done, reader.count)
        metadata = reader.metadata()
        return Overview(
            path=reader.path,
            size=reader.size,
            library=reader.library,
            being_written=reader.being_written,
            damage=reader.damage,
            corruption=reader.corruption,
            attachments=reader.attachments(),
            metadata={
                name: content
                for name, content in metadata.items()
                if name not in (METADATA_NAME, RUN_OUTCOME)
            },
            outcome=metadata.get(RUN_OUTCOME, {}),
            topics=topics,
            runs_ns=runs,
        )
