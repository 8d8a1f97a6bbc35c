"""Finding the robot and its runs in a recording."""

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.analysis.extraction import extract
from ballbot_ros.analysis.recorded_runs import (
    END_OF_TIME_NS,
    RecordedRun,
    RunFinder,
    robot_namespace,
    robot_topics,
)
from ballbot_ros.analysis.replay import RunInputs, read_inputs
from ballbot_ros.errors import RecordingError
from ballbot_ros.recording.messages.conversions import fill_header
from ballbot_ros.recording.messages.topics import (
    CLOCK,
    GYRO_IMU,
    MOTOR_DUTY,
    PLANT_IMU,
    RUN,
    WALL_HIT,
)
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.schemas import encoder, new_message
from ballbot_ros.recording.writer import RecordingWriter
from ballbot_ros.robot.plant.ground_truth import Push

S = 1_000_000_000
TICK = 4_000_000


@pytest.fixture
def reader_of(tmp_path):
    readers = []

    def make(*topics, kind='std_msgs/msg/Header'):
        writer = RecordingWriter(tmp_path / 'run.mcap')
        for name in topics:
            writer.add_topic(name, kind)
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
    topics = robot_topics(reader)
    assert topics.namespace == namespace
    assert list(topics.by_name.values()) == [CLOCK, PLANT_IMU]


def test_several_robots_are_refused_in_one_line(reader_of):
    reader = reader_of('/motor_duty', '/b/motor_duty', '/a/plant/imu')
    with pytest.raises(
        RecordingError, match=r'several robots, in the namespaces /, /a, /b; only one is supported$'
    ):
        robot_namespace(reader, [MOTOR_DUTY, PLANT_IMU])
    with pytest.raises(
        RecordingError, match=r'several robots, in the namespaces /, /b; only one is supported$'
    ):
        robot_topics(reader)


def test_the_robot_is_the_one_with_duties(reader_of):
    assert robot_topics(reader_of('/a/motor_duty', '/b/plant/imu')).namespace == '/a'


def test_a_topic_of_another_type_is_known_and_not_used(reader_of):
    topics = robot_topics(reader_of('/motor_duty', '/plant/run'))
    assert topics.wrong_types == {'/motor_duty': 'std_msgs/msg/Header'}
    assert topics.mismatch('/motor_duty') == (
        '/motor_duty is std_msgs/msg/Header, not geometry_msgs/msg/Vector3Stamped'
    )


def write(path, messages):
    """Write messages: topic, log time [ns] and, of ``plant/run``, the run's name."""
    with RecordingWriter(path) as writer:
        channels = {}
        for topic, stamp_ns, *name in messages:
            if topic not in channels:
                channels[topic] = writer.add_topic(topic.resolved(), topic.type_name)
            message = new_message(topic.type_name)
            header = message if topic is RUN else getattr(message, 'header', None)
            if header:
                fill_header(header, stamp_ns, *name or [''])
            writer.write(channels[topic], stamp_ns, encoder(topic.type_name)(message), 1)
    return path


@pytest.fixture
def find(tmp_path):
    """Return the runs of a file with some messages."""

    def run(*messages):
        path = tmp_path / 'file.mcap'
        path.unlink(missing_ok=True)
        with RecordingReader(write(path, messages)) as reader:
            return extract(reader, lambda *done: None).runs

    return run


def ticks(start_ns, end_ns, *topics):
    return [(topic, stamp) for stamp in range(start_ns, end_ns, TICK) for topic in topics]


def plant(name, end_ns, *topics):
    """Return the messages of a run from 1 s on: those of the plant, and some on `topics`."""
    return [(RUN, S, name), *ticks(S, end_ns, PLANT_IMU, *topics)]


def test_runs_of_one_plant_follow_each_other(find):
    second = (RUN, 2 * S, '2 a'), *ticks(2 * S, 2 * S + 3 * TICK, PLANT_IMU)
    assert find(*plant('1 a', S + 5 * TICK), *second) == (
        RecordedRun('1 a', S, 2 * S),
        RecordedRun('2 a', 2 * S, END_OF_TIME_NS),
    )


@pytest.mark.parametrize('count', [1, 2, 500], ids=lambda count: f'{count}_ticks_before')
@pytest.mark.parametrize('names', [('1 a', '1 b'), ('1', '1')])
def test_the_runs_of_two_plants_in_one_file_are_refused(find, count, names):
    first, second = names
    if first == second and count == 1:  # its tick may have been sent again
        return
    with pytest.raises(
        RecordingError, match=r'time goes back to 1\.000 s: record the runs of each'
    ):
        find(*plant(first, S + count * TICK), *plant(second, S + 3 * TICK))


def test_a_run_that_is_announced_again_is_one(find):
    messages = plant('1 a', 2 * S)
    messages[10:10] = [(RUN, S, '1 a')]
    messages[-1:-1] = [(RUN, S, '1 a'), (WALL_HIT, 2 * S)]
    assert find(*messages, *ticks(2 * S, 3 * S, PLANT_IMU)) == (RecordedRun('1 a', S),)


def test_an_announcement_may_come_after_the_first_tick(find):
    messages = plant('1 b', 2 * S)
    messages[0], messages[1] = messages[1], messages[0]
    assert find(*messages) == (RecordedRun('1 b', S),)


def test_a_repeated_sample_is_no_step_back(find):
    again = [(GYRO_IMU, 2 * S - 9 * TICK), (PLANT_IMU, 2 * S - TICK)]
    assert len(find(*plant('1 a', 2 * S, GYRO_IMU), *again, *ticks(2 * S, 3 * S, GYRO_IMU))) == 1


def test_without_an_announcement_a_run_begins_with_the_first_sample(find):
    unknown = RecordedRun('', 5 * S, is_announced=False)
    assert find(*ticks(5 * S, 9 * S, PLANT_IMU)) == (unknown,)
    with pytest.raises(RecordingError, match=r'time goes back to 3\.000 s'):
        find(*ticks(5 * S, 9 * S, PLANT_IMU), *ticks(3 * S, 4 * S, PLANT_IMU))


@given(st.lists(st.integers(1, 9), max_size=40), st.integers(1, 9))
def test_new_samples_do_not_depend_on_how_a_file_is_cut_into_chunks(places, size):
    stamps = S + TICK * np.array([0, *places])
    finder = RunFinder(None)
    pieces = [stamps[start : start + size] for start in range(0, len(stamps), size)]
    are_new = np.concatenate([finder.are_new(PLANT_IMU, each) for each in pieces])
    assert are_new.tolist() == RunFinder(None).are_new(PLANT_IMU, stamps).tolist()
    assert (np.diff(stamps[are_new]) > 0).all()
    assert stamps[are_new][-1] == stamps.max()


def test_replay_and_report_find_the_same_runs(short):
    with RecordingReader(short[0]) as reader:
        inputs = read_inputs(reader)
        assert tuple(each.run for each in inputs.runs) == extract(reader, lambda *done: None).runs
    assert [each.ticks for each in inputs.runs] == [short[1]['ticks']]


def test_pushes_and_sticks_move_with_the_start_of_a_run():
    push = Push(4 * S, 5 * S, (1.0, 2.0))
    inputs = RunInputs(RecordedRun('run', 3 * S), 9 * S, {4 * S: (1, 2)}, {}, {}, [push], {})
    assert inputs.pushes_from(3 * S) == [push]
    assert inputs.pushes_from(1 * S) == [Push(2 * S, 3 * S, (1.0, 2.0))]
    assert inputs.sticks_at(1.0) == (1, 2)


def test_an_input_of_another_type_is_one_line(short, copy):
    path = copy(short[0], types={'/gyro': 'std_msgs/msg/String'})
    with (
        RecordingReader(path) as reader,
        pytest.raises(RecordingError, match=r'/gyro is std_msgs/msg/String, not sensor_msgs'),
    ):
        read_inputs(reader)


def test_a_recording_that_begins_in_mid_run_can_not_be_replayed(short, copy):
    path = copy(short[0], wanted=lambda name: name != '/plant/run')
    with RecordingReader(path) as reader, pytest.raises(RecordingError, match='in mid-run'):
        read_inputs(reader)
