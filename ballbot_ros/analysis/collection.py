"""The data of a simulated run, collected from its messages instead of its recording."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np

from ballbot_ros.analysis.extraction import (
    EVENTS,
    STAMPED_TOPICS,
    Extraction,
    TopicStatistics,
    values_of,
)
from ballbot_ros.analysis.recorded_runs import RecordedRun
from ballbot_ros.recording.batch import BatchLayout
from ballbot_ros.recording.messages.conversions import is_stop
from ballbot_ros.recording.messages.raw import Messages, Stamps, decoder
from ballbot_ros.recording.messages.topics import MOTOR_DUTY, Topic
from ballbot_ros.recording.schemas import typestore


class MessageCollector:
    """Collects from messages what :func:`~ballbot_ros.analysis.extraction.extract` reads of them.

    Parameters
    ----------
    name : str
        Name of the run in ``plant/run``.
    start_ns : int
        Stamp of its first tick [ns].
    """

    def __init__(self, name: str, start_ns: int) -> None:
        self._extraction = Extraction(runs=(RecordedRun(0, name, start_ns),))
        self._statistics: dict[str, TopicStatistics] = {}
        self._decoder = cache(decoder)

    def add(self, topic: Topic, stamps_ns: Stamps, messages: Messages) -> None:
        """Collect messages of a topic; those of a stamped topic differ only in their numbers."""
        name, count = topic.resolved(), len(stamps_ns)
        statistics = self._statistics.setdefault(name, TopicStatistics(name, topic.type_name))
        statistics.extend(stamps_ns, np.zeros(count))
        if topic in EVENTS:
            decode = self._decoder(topic.type_name)
            for stamp_ns, message in zip(stamps_ns.tolist(), messages, strict=True):
                self._extraction.take(topic, 0, stamp_ns, decode(message.tobytes()))
        elif topic in STAMPED_TOPICS:
            first = messages[0].tobytes()
            if topic is MOTOR_DUTY and is_stop(first):
                return
            records: Any = messages.view(_layout(topic, first)).view(np.recarray)
            values = values_of(topic, records)
            self._extraction.buffers[topic].extend(stamps_ns, values, np.zeros(count, np.intp))

    def extraction(self, names: Iterable[str]) -> Extraction:
        """Return what was collected; `names` are those of the topics in the order of the file."""
        for topic in STAMPED_TOPICS:
            if topic.resolved() not in self._statistics:
                self._extraction.note_missing(topic.resolved())
        self._extraction.topic_statistics = {name: self._statistics[name] for name in names}
        return self._extraction


@cache
def _layout(topic: Topic, first: bytes) -> np.dtype[Any]:
    return BatchLayout.of(first, typestore(), topic.type_name).dtype
