"""The messages due in a playback: rate, pause, seek and loop."""

import pytest

from ballbot_ros.errors import RecordingError
from ballbot_ros.recording.playback import Playback, PlaybackAction
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.schemas import encoder, new_message
from ballbot_ros.recording.writer import RecordingWriter

HEADER = 'std_msgs/msg/Header'
PERIOD_NS = 100_000_000


@pytest.fixture
def reader(tmp_path):
    data = encoder(HEADER)(new_message(HEADER))
    with RecordingWriter(tmp_path / 'run.mcap', chunk_size=200) as writer:
        topics = [writer.add_topic(name, HEADER) for name in ('/even', '/odd')]
        for number in range(11):
            writer.write(topics[number % 2], 10**9 + number * PERIOD_NS, data, number)
    with RecordingReader(tmp_path / 'run.mcap') as reader:
        yield reader


def due(playback, now):
    return [message.sequence for message in playback.due(now)]


def test_messages_are_due_at_the_set_rate(reader):
    playback = Playback(reader, None, rate=2.0, is_looping=False)
    assert due(playback, 0.0) == [0]
    playback.begin(0.0, 50.0)
    assert due(playback, 49.9) == []
    assert due(playback, 50.0) == [0]
    assert due(playback, 50.21) == [1, 2, 3, 4]
    assert playback.time == pytest.approx(0.42)
    assert due(playback, 50.22) == []
    playback.rate = 1.0
    assert due(playback, 50.36) == [5]
    assert not playback.finished
    assert due(playback, 60.0) == [6, 7, 8, 9, 10]
    assert playback.finished


def test_pause_holds_and_seek_jumps(reader):
    playback = Playback(reader, ['/odd'], rate=1.0, is_looping=False)
    playback.begin(0.25, 0.0)
    assert due(playback, 0.1) == [3]
    playback.is_playing = False
    assert due(playback, 9.0) == []
    assert playback.time == pytest.approx(0.35)
    playback.seek(0.05)
    assert due(playback, 9.5) == []
    playback.is_playing = True
    assert due(playback, 9.6) == [1]
    playback.seek(99.0)
    assert playback.time == playback.end
    playback.is_playing = False
    assert due(playback, 10.1) == []
    assert not playback.finished
    playback.is_playing = True
    assert due(playback, 10.1) == []
    assert playback.finished
    playback.seek(-5.0)
    playback.is_playing = True
    assert not playback.finished
    assert due(playback, 10.3) == [1]


def test_a_loop_restarts(reader):
    playback = Playback(reader, None, rate=1.0, is_looping=True)
    playback.begin(0.95, 0.0)
    assert due(playback, 0.06) == [10]
    assert not playback.finished
    assert due(playback, 0.17) == [0, 1]


def test_a_step_plays_the_next_messages_and_pauses(reader):
    playback = Playback(reader, None, rate=1.0, is_looping=False)
    playback.begin(0.0, 0.0)
    assert due(playback, 0.05) == [0]
    playback.step(0.1)
    assert due(playback, 9.0) == [1]
    assert not playback.is_playing
    playback.step(99.0)
    assert due(playback, 9.0) == [2, 3, 4, 5, 6, 7, 8, 9, 10]
    assert playback.time == playback.end
    assert not playback.finished


def test_keys_move_the_playback_from_message_to_message(reader):
    playback = Playback(reader, None, rate=1.0, is_looping=False)
    assert due(playback, 0.55) == [0, 1, 2, 3, 4, 5]
    for action, expected in (
        (PlaybackAction.START, [0]),
        (PlaybackAction.FORWARD, [10]),
        (PlaybackAction.BACK, [0]),
        (PlaybackAction.END, [10]),
        (PlaybackAction.STEP, []),
        (PlaybackAction.PAUSE, [0]),
    ):
        playback.apply(action)
        assert due(playback, 0.55) == expected, action


def test_a_single_message_is_played_once(tmp_path):
    with RecordingWriter(tmp_path / 'one.mcap') as writer:
        topic = writer.add_topic('/one', HEADER)
        writer.write(topic, 10**9, encoder(HEADER)(new_message(HEADER)), 7)
    with RecordingReader(tmp_path / 'one.mcap') as reader:
        playback = Playback(reader, None, rate=1.0, is_looping=True)
        playback.begin(0.0, 0.0)
        assert due(playback, 1.0) == [7]
        assert playback.finished


def test_mistakes_are_one_line(reader, tmp_path):
    playback = Playback(reader, None, rate=1.0, is_looping=False)
    playback.begin(1.0, 0.0)
    with pytest.raises(RecordingError, match=r'run\.mcap: start 2 s is after the end, 1 s$'):
        playback.begin(2.0, 0.0)
    with pytest.raises(RecordingError, match="topic '/x' not found"):
        Playback(reader, ['/x'], rate=1.0, is_looping=False)
    RecordingWriter(tmp_path / 'empty.mcap').close()
    with (
        RecordingReader(tmp_path / 'empty.mcap') as empty,
        pytest.raises(RecordingError, match='no messages to play'),
    ):
        Playback(empty, None, rate=1.0, is_looping=False)
