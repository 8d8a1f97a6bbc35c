"""Statistics of a topic's stamps."""

import math

import numpy as np
import pytest
from text_messages import STRING, string

from ballbot_ros.recording.overview import TopicStatistics, read_topics
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.writer import RecordingWriter


def test_statistics_of_stamps():
    for stamps, expected in (
        ([7], (1, 7, 7, 0, 7, math.nan)),
        ([7, 7], (2, 7, 7, 0, 7, math.nan)),
        ([10, 14, 24, 34], (4, 10, 34, 10, 14, 3 / 24e-9)),
        ([10, 30, 5, 9], (4, 5, 30, 20, 10, 3 / 25e-9)),  # time goes back
        ([9, 5], (2, 5, 9, 0, 9, 1 / 4e-9)),
    ):
        for size in (1, 2, 4):  # however they are split
            topic = TopicStatistics('/a', STRING)
            for first in range(0, len(stamps), size):
                topic.extend(np.array(stamps[first : first + size]))
            found = (topic.count, topic.first_ns, topic.last_ns, topic.gap_ns, topic.gap_at_ns)
            assert found == expected[:-1], (stamps, size)
            assert topic.rate_hz == pytest.approx(expected[-1], nan_ok=True), (stamps, size)


def test_a_recording_is_read_once_from_beginning_to_end(tmp_path):
    path = tmp_path / 'run.mcap'
    with RecordingWriter(path) as writer:
        topics = [writer.add_topic(name, STRING) for name in ('/a', '/b', '/c')]
        for stamp_ns, topic in ((5, 0), (7, 1), (4, 0)):
            writer.write(topics[topic], stamp_ns, string('text'), 0)
            writer.flush()  # a chunk each
    calls = []
    with RecordingReader(path) as reader:
        found, stamps = read_topics(reader, '/a', lambda *call: calls.append(call))
    assert {each.topic: each for each in found} == {
        '/a': TopicStatistics('/a', STRING, 2, 4, 5, 0, 5),
        '/b': TopicStatistics('/b', STRING, 1, 7, 7, 0, 7),
        '/c': TopicStatistics('/c', STRING),
    }
    assert stamps == [5, 4]
    assert calls == [(1, 3), (2, 3), (3, 3)]
