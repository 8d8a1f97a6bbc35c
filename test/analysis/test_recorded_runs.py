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
    messages_by_epoch,
    robot_namespace,
    robot_topics,
    samples_in,
)
from ballbot_ros.analysis.replay import RunInputs, read_inputs
from ballbot_ros.errors import RecordingError
from ballbot_ros.lockstep.recording_order import MAX_AHEAD_NS
from ballbot_ros.recording.messages.conversions import fill_header
from ballbot_ros.recording.messages.topics import (
    BATTERY_STATE,
    CLOCK,
    GYRO_IMU,
    LCD,
    MOTOR_DUTY,
    PLANT_IMU,
    PLANT_ODOM,
    RUN,
    SONAR_RANGE,
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
            if topic is RUN:
                fill_header(message, stamp_ns, *name)
            writer.write(channels[topic], stamp_ns, encoder(topic.type_name)(message), 1)
    return path


ALL = (CLOCK, RUN, PLANT_IMU, PLANT_ODOM, BATTERY_STATE, GYRO_IMU, SONAR_RANGE, WALL_HIT, LCD)


@pytest.fixture
def find(tmp_path):
    """Return the runs of a file with some messages, and the epochs of the messages."""

    def run(*messages):
        with RecordingReader(write(tmp_path / 'file.mcap', messages)) as reader:
            finder = RunFinder(reader)
            found = messages_by_epoch(reader, robot_topics(reader), finder, ALL)
            epochs = [each.epoch for each in found]
            return finder.runs(), epochs

    return run


def ticks(start_ns, end_ns, *topics):
    return [(topic, stamp) for stamp in range(start_ns, end_ns, TICK) for topic in topics]


def plant(name, end_ns, *topics):
    """Return the messages of a run from 1 s on: those of the plant, and some on `topics`."""
    return [(RUN, S, name), *ticks(S, end_ns, CLOCK, PLANT_IMU, *topics)]


def test_runs_of_one_plant_follow_each_other_in_one_epoch(find):
    first = plant('1 a', S + 5 * TICK)
    runs, epochs = find(*first, (RUN, 2 * S, '2 a'), *ticks(2 * S, 2 * S + 3 * TICK, CLOCK))
    assert runs == (
        RecordedRun(0, '1 a', S, 2 * S),
        RecordedRun(0, '2 a', 2 * S, END_OF_TIME_NS),
    )
    assert set(epochs) == {0}


@pytest.mark.parametrize('count', [1, 2, 500], ids=lambda count: f'{count}_ticks_before')
def test_another_plant_begins_another_epoch_however_short_the_first_run_was(find, count):
    first = plant('1 a', S + count * TICK)
    second = plant('1 b', S + 3 * TICK)
    runs, epochs = find(*first, *second)
    assert runs == (RecordedRun(0, '1 a', S), RecordedRun(1, '1 b', S))
    assert epochs == [0] * len(first) + [1] * len(second)


def test_runs_without_a_token_are_distinguished_when_time_goes_back(find):
    first, second = plant('1', 3 * S), plant('1', 2 * S)
    runs, epochs = find(*first, *second)
    assert runs == (RecordedRun(0, '1', S), RecordedRun(1, '1', S))
    assert epochs.count(1) >= len(second) - 1


def test_a_run_that_is_announced_again_is_one(find):
    messages = plant('1 a', 2 * S)
    messages[10:10] = [(RUN, S, '1 a')]
    messages[-1:-1] = [(RUN, S, '1 a'), (WALL_HIT, 2 * S)]
    runs, _ = find(*messages, *ticks(2 * S, 3 * S, CLOCK), (LCD, 3 * S), (WALL_HIT, 3 * S))
    assert runs == (RecordedRun(0, '1 a', S),)


def test_an_announcement_may_come_after_the_first_tick(find):
    messages = plant('1 b', 2 * S)
    messages[0], messages[1] = messages[1], messages[0]
    runs, _ = find(*plant('1 a', 3 * S), *messages)
    assert runs == (RecordedRun(0, '1 a', S), RecordedRun(1, '1 b', S))


def test_a_topic_only_in_the_second_epoch_belongs_to_it(find):
    second = plant('1 b', 2 * S, SONAR_RANGE)
    runs, epochs = find(*plant('1 a', 3 * S), *second)
    assert len(runs) == 2
    assert epochs[-len(second) :] == [1] * len(second)


def test_messages_of_a_plant_before_its_first_tick_belong_to_its_own_run(find):
    first = plant('1 a', 3 * S)
    between = [(RUN, S, '1 b'), (WALL_HIT, S), (LCD, 3 * S), (GYRO_IMU, 3 * S)]
    runs, epochs = find(*first, (GYRO_IMU, 3 * S - TICK), *between, *ticks(S, 2 * S, CLOCK))
    assert epochs[len(first) + 1 :][: len(between)] == [1, 1, 0, 0]
    assert [run.name for run in runs] == ['1 a', '1 b']


def test_a_leftover_sample_stays_with_the_previous_plant(find):
    first, second = plant('1 a', 9 * S, GYRO_IMU), ticks(S, 2 * S, CLOCK, PLANT_IMU, GYRO_IMU)
    late = [(GYRO_IMU, 9 * S)]
    runs, epochs = find(*first, (RUN, S, '1 b'), *second[:2], *late, *second[2:])
    assert len(runs) == 2
    assert epochs == [0] * len(first) + [1, 1, 1, 0] + [1] * (len(second) - 2)


@pytest.mark.parametrize(('ahead_ns', 'epoch'), [(MAX_AHEAD_NS, 1), (MAX_AHEAD_NS + TICK, 0)])
def test_a_sample_that_no_node_of_the_new_run_can_have_sent_belongs_to_the_previous_run(
    find, ahead_ns, epoch
):
    first = plant('1 a', S + 2 * TICK, GYRO_IMU)
    _, epochs = find(*first, *plant('1 b', S + TICK), (GYRO_IMU, S + ahead_ns))
    assert epochs[-1] == epoch


def test_a_plant_may_begin_its_second_run_before_a_tick_of_its_first(find):
    first = plant('1 a', 9 * S)
    announced = [(RUN, S, '1 b'), (RUN, 2 * S, '2 b')]
    runs, _ = find(*first, *announced, *ticks(2 * S, 3 * S, CLOCK, PLANT_IMU))
    assert runs == (
        RecordedRun(0, '1 a', S),
        RecordedRun(1, '1 b', S, 2 * S),
        RecordedRun(1, '2 b', 2 * S),
    )


def test_a_tick_of_the_previous_plant_does_not_cancel_an_announcement(find):
    first, late = plant('1 a', 3 * S), ticks(3 * S, 3 * S + TICK, CLOCK, PLANT_IMU)
    runs, _ = find(*first, (RUN, S, '1 b'), *late, *ticks(S, 2 * S, CLOCK, PLANT_IMU))
    assert runs == (RecordedRun(0, '1 a', S), RecordedRun(1, '1 b', S))


def test_a_short_unannounced_run_ends_where_time_goes_back_to_its_start(find):
    first, second = ticks(S, S + 9 * TICK, PLANT_IMU), ticks(S, S + 3 * TICK, PLANT_IMU)
    runs, epochs = find(*first, *second)
    assert [(run.epoch, run.start_ns) for run in runs] == [(0, S), (1, S)]
    assert epochs == [0] * 9 + [1] * 3


def test_a_repeated_sample_begins_no_run(find):
    again = [(GYRO_IMU, 2 * S - 9 * TICK), (PLANT_IMU, 2 * S - TICK)]
    runs, epochs = find(*plant('1 a', 2 * S, GYRO_IMU), *again, *ticks(2 * S, 3 * S, GYRO_IMU))
    assert len(runs) == 1
    assert set(epochs) == {0}


def test_without_an_announcement_a_run_begins_where_time_goes_back(find):
    runs, _ = find(*ticks(5 * S, 9 * S, PLANT_IMU), *ticks(3 * S, 4 * S, PLANT_IMU))
    assert runs == (
        RecordedRun(0, '', 5 * S, is_announced=False),
        RecordedRun(1, '', 3 * S, is_announced=False),
    )


STAMPS = st.one_of(st.integers(0, 5).map(lambda n: S + n * TICK), st.integers(1, 4).map(S.__mul__))
MESSAGES = st.one_of(
    st.tuples(st.sampled_from([CLOCK, PLANT_IMU, GYRO_IMU, BATTERY_STATE, WALL_HIT, LCD]), STAMPS),
    st.tuples(st.just(RUN), STAMPS, st.sampled_from(['1 a', '2 a', '1 b'])),
)


@given(st.lists(MESSAGES, min_size=1, max_size=40), st.integers(1, 9))
def test_the_runs_do_not_depend_on_how_a_file_is_cut_into_chunks(tmp_path_factory, messages, size):
    path = write(tmp_path_factory.mktemp('law') / 'file.mcap', [(PLANT_IMU, S), *messages])
    with RecordingReader(path) as reader:
        well_typed = robot_topics(reader).well_typed
        (whole,) = reader.batches()

        def placed(step):
            finder, epochs, are_new = RunFinder(reader), [], []
            for start in range(0, len(whole), step):
                batch = whole.select(np.arange(start, min(start + step, len(whole))))
                rows = {well_typed[name]: topic_rows for name, topic_rows in batch.rows().items()}
                assignment = finder.process(batch, rows, samples_in(batch, rows), batch.log_ns)
                epochs += assignment[0].tolist()
                are_new += assignment[1].tolist()
            return finder.runs(), epochs, are_new

        at_once, piece_by_piece = placed(len(whole)), placed(size)
    assert at_once == piece_by_piece
    runs, epochs, are_new = at_once
    starts = [(run.epoch, run.start_ns) for run in runs]
    assert starts == sorted(set(starts))
    rising = {}
    for message, epoch, is_new in zip([(PLANT_IMU, S), *messages], epochs, are_new, strict=True):
        if is_new:
            assert message[1] > rising.get((message[0], epoch), -1)
            rising[message[0], epoch] = message[1]


def test_replay_and_report_find_the_same_runs(short, driven, copy):
    path = copy(short[0], driven[0], short[0])
    with RecordingReader(path) as reader:
        inputs = read_inputs(reader)
        assert tuple(each.run for each in inputs.runs) == extract(reader, lambda *done: None).runs
    assert [each.run.epoch for each in inputs.runs] == [0, 1, 2]
    counts = [each[1]['ticks'] for each in (short, driven, short)]
    assert [each.ticks for each in inputs.runs] == counts


def test_pushes_and_sticks_move_with_the_start_of_a_run():
    push = Push(4 * S, 5 * S, (1.0, 2.0))
    inputs = RunInputs(RecordedRun(0, 'run', 3 * S), 9 * S, {4 * S: (1, 2)}, {}, {}, [push], {})
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
