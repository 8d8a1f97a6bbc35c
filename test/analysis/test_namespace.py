"""Finding the robot in a recording."""

import pytest

from ballbot_ros.analysis.namespace import robot_namespace
from ballbot_ros.messages.topics import CLOCK, MOTOR_DUTY, PLANT_IMU
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.writer import RecordingWriter


@pytest.fixture
def reader_of(tmp_path):
    readers = []

    def make(*topics):
        writer = RecordingWriter(tmp_path / 'run.mcap')
        for name in topics:
            writer.add_topic(name, 'std_msgs/msg/Header')
        writer.close()
        readers.append(RecordingReader(tmp_path / 'run.mcap'))
        return readers[-1]

    yield make
    for reader in readers:
        reader.close()


@pytest.mark.parametrize('namespace', ['', '/robot', '/lab/robot'])
def test_a_namespace_is_found_by_any_of_the_topics(reader_of, namespace):
    reader = reader_of(CLOCK.resolved(namespace), PLANT_IMU.resolved(namespace))
    assert set(reader.topics()) == {'/clock', f'{namespace}/plant/imu'}
    assert robot_namespace(reader, [MOTOR_DUTY, PLANT_IMU]) == namespace
    assert robot_namespace(reader, [MOTOR_DUTY]) is None


def test_several_robots_are_refused_in_one_line(reader_of):
    reader = reader_of('/motor_duty', '/b/motor_duty', '/a/plant/imu')
    with pytest.raises(RecordingError, match=r'several robots: /, /a, /b; take one of them out$'):
        robot_namespace(reader, [MOTOR_DUTY, PLANT_IMU])
