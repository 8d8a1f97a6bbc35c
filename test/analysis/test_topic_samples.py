"""The numbers of any recorded topic: those of `ballbot export`, in the time of the run."""

import csv

import numpy as np
import pytest
from graph import record
from own_controllers import BALANCE
from recordings import copy_recording

from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.analysis.topic_samples import TopicSamples, read_topic, topics_with_signals
from ballbot_ros.errors import RecordingError
from ballbot_ros.recording.export import Exporter
from ballbot_ros.recording.messages.column_hints import column_hints
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.schemas import encoder, new_message

STATE = '/controller/state'
JOINTS = 'sensor_msgs/msg/JointState'
FLOAT = 'std_msgs/msg/Float64'
START_NS = 10**9
END_S = 1.596


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    """A run of a user's controller, which estimates only the pitch of plane x."""
    folder = tmp_path_factory.mktemp('own')
    estimating = BALANCE.replace(
        'plane_x, plane_y = self.planes\n',
        'plane_x, plane_y = self.planes\n        self.x.psi = plane_x.pitch\n',
    )
    (folder / 'mine.py').write_text(estimating, encoding='utf-8')
    path, _ = record(
        folder,
        'stationary',
        f'--controller={folder}/mine.py:Balance',
        '--set=plant_sim.duration=1.6',
    )
    return path


def with_messages(recording, path, topic, messages):
    """Write a copy with a further topic of (log time, message); return what is read of it."""
    type_name = messages[0][1].__msgtype__
    added = [(topic, log_ns, encoder(type_name)(message)) for log_ns, message in messages]
    copy_recording(path, recording, first=added, types={topic: type_name})
    return read_topic(read_run(path), topic)


def joints(names, positions, stamp_s=0):
    message = new_message(JOINTS)
    message.name, message.position = list(names), np.array(positions, float)
    message.header.stamp.sec = stamp_s
    return message


def number(value):
    message = new_message(FLOAT)
    message.data = float(value)
    return message


def test_the_columns_are_those_of_export(recording, tmp_path):
    topics = topics_with_signals(recording)
    assert {STATE, '/plant/joint_states', '/battery_state', '/odom', '/imu/data'} <= set(topics)
    assert not {'/lcd', '/plant/run', '/tf', '/robot_description'} & set(topics)
    with RecordingReader(recording) as reader:
        exporter = Exporter(reader, tmp_path, 'csv', topics, column_hints())
        exporter.write_topics()
    run = read_run(recording)
    for topic, file in zip(topics, sorted(exporter.files), strict=True):
        samples = read_topic(run, topic)
        with file.open(newline='', encoding='utf-8') as stream:
            rows = list(csv.DictReader(stream))
        exported = {
            name: [float({'True': 1, 'False': 0}.get(row[name], row[name])) for row in rows]
            for name in ('time_s', *samples.columns)
        }
        np.testing.assert_allclose(samples.time + 1.0, exported.pop('time_s'), atol=1e-9)
        for name, values in exported.items():
            np.testing.assert_array_equal(samples.columns[name], values, err_msg=f'{topic} {name}')
        left_out = rows[0].keys() - samples.columns.keys() - {'time_s', 'stamp_s'}
        assert all(not_a_number(rows[0][name]) for name in left_out), topic


def not_a_number(text):
    return text in ('', 'map') or not text.replace('.', '').lstrip('-').isdigit()


def test_what_a_users_controller_estimates_changes_and_the_rest_does_not(recording):
    samples = read_topic(read_run(recording), STATE)
    assert samples.changing == ('position_psi_x_rad', 'estimated_pitch_x_deg')
    assert np.isnan(samples.columns['position_theta_x_rad']).all()
    assert samples.time[[0, -1]].tolist() == [0.0, pytest.approx(END_S)]


def test_the_topic_of_a_users_node_is_in_the_time_of_the_run(recording, tmp_path):
    """Its stamps come from the wall clock, or are not set."""
    log_ns = [START_NS + n * 100_000_000 for n in range(10)]
    for stamp_s in (1_700_000_000, 0):
        messages = [
            (log, joints(['error', 'integral'], [0.5 * n, 3.0], stamp_s))
            for n, log in enumerate(log_ns)
        ]
        samples = with_messages(recording, tmp_path / f'{stamp_s}.mcap', '/mine/state', messages)
        np.testing.assert_allclose(samples.time, np.arange(10) * 0.1)
        assert samples.changing == ('position_error_rad',)
        assert samples.columns['position_error_rad'].tolist() == [0.5 * n for n in range(10)]


def test_a_field_may_be_named_like_an_attribute_of_an_array(recording, tmp_path):
    messages = [(START_NS, number(1.5)), (START_NS + 1, number(-2.0))]
    samples = with_messages(recording, tmp_path / 'a.mcap', '/mine/value', messages)
    assert samples.columns['data'].tolist() == [1.5, -2.0]


def test_elements_that_change_are_an_error(recording, tmp_path):
    messages = [(START_NS, joints('a', [0.0])), (START_NS + 1, joints('b', [0.0]))]
    with pytest.raises(RecordingError, match=r'/mine/state: the names or the number of its ele'):
        with_messages(recording, tmp_path / 'a.mcap', '/mine/state', messages)


def test_only_the_messages_of_the_run_are_read(recording, tmp_path):
    twice = copy_recording(tmp_path / 'twice.mcap', recording, recording)
    once, second = read_run(recording), read_run(twice, 2)
    for topic in ('/sonar', '/clock'):
        expected, found = read_topic(once, topic), read_topic(second, topic)
        assert found.time.tolist() == expected.time.tolist(), topic
        assert found.columns.keys() == expected.columns.keys()


def test_values_at_other_times_are_the_newest():
    samples = TopicSamples(np.array([1.0, 2.0]), {'a': np.array([5.0, 6.0])})
    found = samples.newest('a', np.array([0.5, 1.0, 1.5, 2.0, 2.5]))
    np.testing.assert_array_equal(found, [np.nan, 5.0, 5.0, 6.0, np.nan])
