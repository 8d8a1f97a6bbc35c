"""Statistics of a topic's stamps."""

import pytest
from text_messages import STRING, string

from ballbot_ros.recording.overview import TopicOverview, read_topics
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.writer import RecordingWriter


def test_statistics_of_stamps():
    for stamps, expected in (
        ([], (0, None, None, None, None, None)),
        ([7], (1, 7, 7, None, None, None)),
        ([7, 7], (2, 7, 7, 0, 7, None)),
        ([10, 14, 24, 34], (4, 10, 34, 10, 14, 3 / 24e-9)),
        ([10, 30, 5, 9], (4, 5, 30, 20, 10, 3 / 25e-9)),  # time goes back
        ([9, 5], (2, 5, 9, None, None, 1 / 4e-9)),
    ):
        topic = TopicOverview('std_msgs/msg/String')
        for stamp in stamps:
            topic.add(stamp)
        found = (topic.count, topic.first_ns, topic.last_ns, topic.gap_ns, topic.gap_at_ns)
        assert found == expected[:-1], stamps
        assert topic.rate_hz == pytest.approx(expected[-1]), stamps


def test_a_recording_is_read_once_from_beginning_to_end(tmp_path):
    path = tmp_path / 'run.mcap'
    with RecordingWriter(path) as writer:
        topics = [writer.add_topic(name, STRING) for name in ('/a', '/b', '/c')]
        for stamp_ns, topic in ((5, 0), (7, 1), (4, 0)):
            writer.write(topics[topic], stamp_ns, string('text'), 0)
    calls = []
    with RecordingReader(path) as reader:
        found = read_topics(reader, '/a', lambda *call: calls.append(call))
    assert found == (
        {
            '/a': TopicOverview(STRING, 2, 4, 5),
            '/b': TopicOverview(STRING, 1, 7, 7),
            '/c': TopicOverview(STRING),
        },
        [5, 4],
    )
    assert calls == [(1, 3), (2, 3), (3, 3)]
