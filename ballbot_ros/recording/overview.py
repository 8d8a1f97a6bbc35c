"""Statistics of the messages in a recording."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot_ros.process import ProgressCallback
from ballbot_ros.recording.reader import RecordingReader

_OTHER_CLOCK_MS = 3.6e6


@dataclass
class TopicStatistics:
    """Statistics of the messages of a topic, 0 without messages.

    Attributes
    ----------
    first_ns, last_ns : int
        The oldest and the newest log time [ns].
    gap_ns, gap_at_ns : int
        The longest time between two messages, and its start [ns].
    age_sum_ms, age_max_ms : float
        Sum and maximum of the messages' ages: the newest log time so far in the file, minus the
        message's stamp.
    """

    topic: str
    type_name: str
    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    gap_ns: int = 0
    gap_at_ns: int = 0
    age_sum_ms: float = 0.0
    age_max_ms: float = 0.0

    def extend(self, log_ns: NDArray[np.int64], age_ms: ArrayLike = 0.0) -> None:
        """Count messages."""
        if self.count == 0:
            self.first_ns = self.last_ns = self.gap_at_ns = int(log_ns[0])
        newest = np.maximum.accumulate(np.append(self.last_ns, log_ns))
        gaps_ns = np.diff(newest)
        longest = int(gaps_ns.argmax())
        if gaps_ns[longest] > self.gap_ns:
            self.gap_ns, self.gap_at_ns = int(gaps_ns[longest]), int(newest[longest])
        self.first_ns, self.last_ns = min(self.first_ns, int(log_ns.min())), int(newest[-1])
        self.count += len(log_ns)
        # Add one by one: the rounding of a sum over arrays would depend on how they are split.
        self.age_sum_ms = float(np.cumsum(np.append(self.age_sum_ms, age_ms))[-1])
        self.age_max_ms = max(self.age_max_ms, float(np.max(age_ms)))

    @property
    def rate_hz(self) -> float:
        """The mean rate [Hz]; NaN for fewer than two different log times."""
        span_ns = self.last_ns - self.first_ns
        return (self.count - 1) * 1e9 / span_ns if span_ns else math.nan

    @property
    def age_ms(self) -> tuple[float, float]:
        """Mean and largest age [ms]; NaN if stamps and log times come from different clocks."""
        if self.age_max_ms > _OTHER_CLOCK_MS:
            return math.nan, math.nan
        return self.age_sum_ms / self.count, self.age_max_ms


def read_topics(
    reader: RecordingReader, stamps_of: str, progress: ProgressCallback
) -> tuple[list[TopicStatistics], list[int]]:
    """Read a recording from beginning to end.

    Return the statistics of each topic but for the ages, and all log times of the topic `stamps_of`
    [ns]. `progress` is called with the number of messages read and their total.
    """
    topics = {each: TopicStatistics(each, row.type_name) for each, row in reader.topics().items()}
    stamps_ns: list[int] = []
    done = 0
    for batch in reader.batches():
        log_ns = batch.log_ns
        for name, rows in batch.rows().items():
            topics[name].extend(log_ns[rows])
            if name == stamps_of:
                stamps_ns += log_ns[rows].tolist()
        done += len(batch)
        progress(done, reader.count)
    return list(topics.values()), stamps_ns
