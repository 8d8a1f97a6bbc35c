"""Recordings of runs without nodes, and changed copies of them."""

import pytest
from graph import record

from ballbot_ros.analysis.assessment import assess
from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.recording.encoding import encoder
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.writer import RecordingWriter


@pytest.fixture(scope='session')
def make_run(tmp_path_factory):
    """Run a scenario; return the recording and the result that the run printed."""

    def make(scenario, *arguments):
        return record(tmp_path_factory.mktemp('run'), scenario, *arguments)

    return make


@pytest.fixture(scope='session')
def driven(make_run):
    """The scenario forward_backward, with noise in plane y."""
    return make_run('forward_backward', '--set=gyro_driver.noise=0.7')


@pytest.fixture(scope='session')
def short(make_run):
    """Three seconds of the scenario stationary."""
    return make_run('stationary', '--set=plant_sim.duration=3')


@pytest.fixture(scope='session')
def driven_assessment(driven):
    return assess(read_run(driven[0]))


@pytest.fixture(scope='session')
def short_assessment(short):
    return assess(read_run(short[0]))


@pytest.fixture
def copy(tmp_path):
    """Write a copy of recordings, one after the other, with the wanted topics only."""

    def write(
        *paths, wanted=lambda topic: True, attachments=True, types=None, edit=None, extra=None
    ):
        path = tmp_path / 'copy.mcap'
        writer = RecordingWriter(path)
        topics = {}
        for source in paths:
            with RecordingReader(source) as reader:
                if attachments:
                    for name, file in reader.attachments().items():
                        writer.add_attachment(name, file.media_type, file.data)
                names = {name: topic.type_name for name, topic in reader.topics().items()}
                for raw in reader.raw_messages():
                    if not wanted(raw.topic):
                        continue
                    if raw.topic not in topics:
                        kind = (types or {}).get(raw.topic, names[raw.topic])
                        topics[raw.topic] = writer.add_topic(raw.topic, kind)
                    data = edit(raw) if edit else raw.data
                    if data is not None:
                        writer.write(topics[raw.topic], raw.stamp_ns, data, raw.sequence)
        for name, (message, stamp_ns) in (extra or {}).items():
            topic = writer.add_topic(name, message.__msgtype__)
            writer.write(topic, stamp_ns, encoder(message.__msgtype__)(message), 1)
        writer.close()
        return path

    return write
