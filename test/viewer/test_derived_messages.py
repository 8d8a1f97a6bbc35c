"""Messages derived from those of a run: complete ticks, runs and jumps, and their channels."""

import math
from collections import defaultdict
from dataclasses import asdict, replace
from itertools import permutations
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from maps import with_walls

from ballbot_ros.lockstep.participants import Announcement, Participant
from ballbot_ros.parameters import GYRO, PLANT, PlantParameters
from ballbot_ros.parameters.timing import SECOND_NS, TICK_NS
from ballbot_ros.recording.messages.conversions import (
    body_pitch,
    body_rates,
    encode_body,
    encode_header,
    encode_map,
    encode_odometry,
)
from ballbot_ros.recording.messages.devices import encode_encoders, encode_gyro
from ballbot_ros.recording.messages.raw import decoder
from ballbot_ros.recording.messages.run_reports import encode_announcement
from ballbot_ros.recording.messages.tool_messages import (
    DELETE_ALL,
    EXACT,
    encode_imu_data,
    encode_odom,
)
from ballbot_ros.recording.messages.topics import (
    GYRO_IMU,
    HISTORY,
    IMU_DATA,
    JOINT_STATES,
    MAP,
    MARKERS,
    ODOM,
    PARTICIPANTS,
    PLANT_IMU,
    PLANT_ODOM,
    ROBOT_DESCRIPTION,
    RUN,
    TF,
    TF_STATIC,
)
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.writer import RecordingWriter
from ballbot_ros.robot.brick.odometry import Estimate, OdometryState
from ballbot_ros.robot.plant.ground_truth import GroundTruth
from ballbot_ros.robot.world.floor_map import occupancy_grid
from ballbot_ros.viewer.derived_messages import JUMP_NS, PERIOD_NS, DerivedChannels, DerivedMessages
from ballbot_ros.viewer.robot import SONAR

SHAPE = PlantParameters()
FLOOR = with_walls(20, 30, (0, 2, 0, 30), (5, 9, 7, 8))


class Outputs:
    """The messages that were sent, by topic: stamps and decoded messages."""

    def __init__(self):
        self.sent = defaultdict(list)
        self.messages = DerivedMessages(self._make_send, SHAPE)

    def _make_send(self, topic):
        decode = decoder(topic.type_name)
        return lambda stamp_ns, data: self.sent[topic].append((stamp_ns, decode(data)))

    def stamps(self, topic):
        return [stamp_ns for stamp_ns, _ in self.sent[topic]]

    def newest(self, topic):
        return self.sent[topic][-1][1]


@pytest.fixture
def outputs():
    return Outputs()


def samples(stamp_ns, position=(0.0, 0.0), psi=(0.0, 0.0), motors=(0, 0), gyro=(600, 600)):
    """Return the messages of a tick, by topic."""
    pair = (0.0, 0.0)
    truth = GroundTruth(stamp_ns, pair, pair, pair, psi, pair, position, pair, 8.0)
    return {
        PLANT_ODOM: encode_odometry(truth, SHAPE.ball_radius),
        PLANT_IMU: encode_body(truth),
        GYRO_IMU: encode_gyro(stamp_ns, gyro),
        JOINT_STATES: encode_encoders(stamp_ns, motors),
    }


def add_tick(messages, stamp_ns, *, order=None, **state):
    """Add the messages of a tick, in an order of the topics."""
    found = samples(stamp_ns, **state)
    for topic in order or found:
        messages.add(topic, stamp_ns, found[topic])


def announcement(role, parameters):
    participant = Participant(role, f'/{role}', 'here', 1, 'a', 'x', '0', parameters=parameters)
    return encode_announcement(Announcement(participant, '1', 0))


def pose(message, frame):
    (found,) = (each for each in message.transforms if each.child_frame_id == frame)
    return found.header.frame_id, found.transform


def test_a_tick_is_complete_when_its_last_message_has_come():
    for order in permutations(samples(SECOND_NS)):
        outputs = Outputs()
        for number, topic in enumerate(order):
            assert outputs.messages.sent_ns == 0, order[:number]
            outputs.messages.add(topic, SECOND_NS, samples(SECOND_NS)[topic])
            outputs.messages.send()
        assert outputs.messages.sent_ns == SECOND_NS, order


def test_topics_may_lag_behind_one_another(outputs):
    stamps = [SECOND_NS + number * TICK_NS for number in range(5)]
    first, *others = samples(SECOND_NS)
    for stamp_ns in stamps:
        outputs.messages.add(first, stamp_ns, samples(stamp_ns)[first])
    for stamp_ns in stamps:
        for topic in others:
            outputs.messages.add(topic, stamp_ns, samples(stamp_ns)[topic])
        outputs.messages.send()
        assert outputs.messages.sent_ns == stamp_ns


def test_each_tick_is_sent_once_and_the_description_once_in_a_run(outputs):
    outputs.messages.send()
    assert not outputs.sent
    for stamp_ns in (SECOND_NS, SECOND_NS, SECOND_NS + TICK_NS):
        add_tick(outputs.messages, stamp_ns)
        outputs.messages.send()
    assert outputs.stamps(TF) == [SECOND_NS, SECOND_NS + TICK_NS]
    for topic in (ROBOT_DESCRIPTION, TF_STATIC, MARKERS):
        assert outputs.stamps(topic) == [SECOND_NS], topic.name
    assert pose(outputs.newest(TF_STATIC), SONAR)[0] == 'base_link'


def test_the_body_is_where_the_truth_is(outputs):
    add_tick(outputs.messages, SECOND_NS, position=(0.3, 0.2), psi=(0.1, 0.0))
    outputs.messages.send()
    parent, transform = pose(outputs.newest(TF), 'base_link')
    assert (parent, transform.translation.z) == ('base_footprint', SHAPE.ball_radius)
    assert transform.rotation.y == pytest.approx(0.05, abs=1e-4)
    parent, footprint = pose(outputs.newest(TF), 'base_footprint')
    assert parent == 'odom'
    parent, odom = pose(outputs.newest(TF), 'odom')
    assert parent == 'map'
    x, y = (getattr(odom.translation, axis) + getattr(footprint.translation, axis) for axis in 'xy')
    assert (x, y) == pytest.approx((0.3, -0.2))


def test_the_odometry_is_that_of_the_sensors(outputs):
    """The robot stands, and both motors turn by 90 degrees after the calibration."""
    stamps = range(SECOND_NS, 3 * SECOND_NS, TICK_NS)
    for stamp_ns in stamps:
        motors = (90, 90) if stamp_ns > 2 * SECOND_NS + SECOND_NS // 2 else (0, 0)
        add_tick(outputs.messages, stamp_ns, position=(0.5, 0.5), motors=motors)
        if stamp_ns % PERIOD_NS == 0:
            outputs.messages.send()
    way = SHAPE.wheel_radius * math.pi / 2
    odometry = outputs.newest(ODOM)
    assert (odometry.header.frame_id, odometry.child_frame_id) == ('odom', 'base_footprint')
    position = odometry.pose.pose.position
    assert (position.x, position.y, position.z) == pytest.approx((way, -way, 0.0))
    _, transform = pose(outputs.newest(TF), 'odom')
    assert (transform.translation.x, transform.translation.y) == pytest.approx(
        (0.5 - way, way - 0.5)
    )
    assert min(outputs.stamps(ODOM)) == 2 * SECOND_NS, 'the gyros are calibrated before'
    assert outputs.stamps(IMU_DATA) == outputs.stamps(ODOM)
    rate = outputs.newest(IMU_DATA).angular_velocity
    assert (rate.x, rate.y) == (0.0, 0.0)


def test_ticks_in_columns_give_the_same_messages_as_those_of_the_nodes():
    numbers, count = np.random.default_rng(1), 700
    stamps = SECOND_NS + TICK_NS * np.arange(count)
    position, psi = numbers.normal(0.0, 0.1, (2, count, 2))
    gyro, encoders = numbers.integers(-90, 90, (2, count, 2))
    one_by_one, in_columns = Outputs(), Outputs()
    columns = (each.tolist() for each in (stamps, position, psi, encoders, gyro))
    for stamp_ns, *state in zip(*columns, strict=True):
        for topic, data in samples(stamp_ns, *state).items():
            one_by_one.messages.add(topic, stamp_ns, data)
        if stamp_ns % PERIOD_NS == 0:
            one_by_one.messages.send()
    for rows in np.split(np.arange(count), [1, 18, 303, 304]):
        in_columns.messages.send_ticks(
            *(each[rows] for each in (stamps, position, psi, gyro, encoders))
        )
    assert one_by_one.sent.keys() == set(DerivedMessages.OUTPUTS)
    for topic, sent in one_by_one.sent.items():
        assert list(map(repr, in_columns.sent[topic])) == list(map(repr, sent)), topic.name


def test_without_sensors_there_are_transforms_but_no_odometry(outputs):
    for number in range(2 * HISTORY):
        stamp_ns = SECOND_NS + number * TICK_NS
        for topic in (PLANT_ODOM, PLANT_IMU):
            outputs.messages.add(topic, stamp_ns, samples(stamp_ns, (0.4, 0.0))[topic])
        outputs.messages.send()
    assert outputs.stamps(TF)[-1] == stamp_ns
    assert not outputs.sent[ODOM]
    _, footprint = pose(outputs.newest(TF), 'base_footprint')
    assert footprint.translation.x == 0.4


def test_every_run_begins_again_but_not_a_repeated_announcement(outputs):
    for start_ns, name in ((SECOND_NS, '1 a'), (SECOND_NS, '1 a'), (3 * SECOND_NS, '2 a')):
        outputs.messages.add(RUN, start_ns, encode_header(start_ns, name))
        add_tick(outputs.messages, start_ns)
        outputs.messages.send()
    assert outputs.stamps(ROBOT_DESCRIPTION) == [SECOND_NS, 3 * SECOND_NS]


def test_a_jump_back_begins_again_and_a_late_message_does_not(outputs):
    for stamp_ns in (3 * SECOND_NS, 3 * SECOND_NS - JUMP_NS + TICK_NS, 3 * SECOND_NS - JUMP_NS):
        add_tick(outputs.messages, stamp_ns)
        outputs.messages.send()
    assert outputs.stamps(TF) == [3 * SECOND_NS, 3 * SECOND_NS - JUMP_NS]
    assert outputs.stamps(ROBOT_DESCRIPTION) == outputs.stamps(TF)


@pytest.mark.parametrize('order', list(permutations(['run', 'map', 'tick'])))
def test_the_walls_of_a_run_are_its_map_in_every_order(outputs, order):
    old = encode_map(SECOND_NS, occupancy_grid(with_walls(20, 30, (1, 2, 3, 4))))
    outputs.messages.add(MAP, SECOND_NS, old)
    add_tick(outputs.messages, SECOND_NS)
    outputs.messages.send()
    begin_ns = 2 * SECOND_NS
    steps = {
        'run': lambda: outputs.messages.add(RUN, begin_ns, encode_header(begin_ns, '2 a')),
        'map': lambda: outputs.messages.add(
            MAP, begin_ns, encode_map(begin_ns, occupancy_grid(FLOOR))
        ),
        'tick': lambda: add_tick(outputs.messages, begin_ns),
    }
    for step in order:
        steps[step]()
    add_tick(outputs.messages, begin_ns + TICK_NS)
    outputs.messages.send()
    erase, *walls = outputs.newest(MARKERS).markers
    assert erase.action == DELETE_ALL
    assert {(wall.ns, wall.header.frame_id) for wall in walls} == {('walls', 'map')}
    area = sum(wall.scale.x * wall.scale.y for wall in walls)
    assert area == pytest.approx(FLOOR.walls.sum() * 1e-4)


def test_a_run_without_a_map_has_no_walls(outputs):
    outputs.messages.add(MAP, SECOND_NS, encode_map(SECOND_NS, occupancy_grid(FLOOR)))
    outputs.messages.add(RUN, 2 * SECOND_NS, encode_header(2 * SECOND_NS, '2 a'))
    add_tick(outputs.messages, 2 * SECOND_NS)
    outputs.messages.send()
    assert [each.action for each in outputs.newest(MARKERS).markers] == [DELETE_ALL]


def test_the_shape_is_that_of_the_announced_plant(outputs):
    taller = asdict(replace(SHAPE, body_height=0.25)) | {'of_another_version': 1}
    outputs.messages.add(PARTICIPANTS, 0, announcement(PLANT, taller))
    outputs.messages.add(PARTICIPANTS, 0, announcement(GYRO, {'body_height': 0.3}))
    add_tick(outputs.messages, SECOND_NS)
    outputs.messages.send()
    robot = ElementTree.fromstring(outputs.newest(ROBOT_DESCRIPTION).data)
    assert robot.find("link[@name='base_link']/inertial/origin").get('xyz') == '0 0 0.25'


def test_the_odometry_has_the_radii_of_a_plant_that_announces_itself_after_the_run(outputs):
    outputs.messages.add(RUN, SECOND_NS, encode_header(SECOND_NS, '1 a'))
    wider = asdict(replace(SHAPE, wheel_radius=0.03))
    outputs.messages.add(PARTICIPANTS, 0, announcement(PLANT, wider))
    for stamp_ns in range(SECOND_NS, 2 * SECOND_NS + TICK_NS, TICK_NS):
        add_tick(outputs.messages, stamp_ns, motors=(180, 0))
        outputs.messages.add(PARTICIPANTS, 0, announcement(PLANT, wider))  # to a roll call
        outputs.messages.send()
    assert outputs.newest(ODOM).pose.pose.position.x == pytest.approx(0.03 * math.pi)


def test_malformed_messages_are_ignored(outputs):
    for topic in DerivedMessages.INPUTS:
        outputs.messages.add(topic, SECOND_NS, b'\x00\x01\x00\x00')
    outputs.messages.send()
    assert not outputs.sent
    add_tick(outputs.messages, SECOND_NS + TICK_NS)
    outputs.messages.send()
    assert outputs.stamps(TF) == [SECOND_NS + TICK_NS]


def test_a_recording_has_derived_messages_at_a_rate_for_tools(tmp_path):
    """Topics that a node publishes are left out, from its first message on."""
    published = set()
    path = tmp_path / 'derived.mcap'
    with RecordingWriter(path) as writer:
        channels = DerivedChannels(
            writer,
            SHAPE,
            name_of=lambda topic: topic.resolved('/robot'),
            is_published=published.__contains__,
        )
        for number in range(100):
            if number == 50:
                published.add('/tf')
                own = writer.add_topic('/tf', TF.type_name)
                writer.write(own, SECOND_NS + number * TICK_NS, b'\0\1\0\0\0\0\0\0', 1)
            add_tick_to(channels, SECOND_NS + number * TICK_NS)
    with RecordingReader(path) as reader:
        drawn = {'/tf_static', '/robot/markers', '/robot/robot_description'}
        assert reader.derived() == drawn
        stamps = [raw.stamp_ns for raw in reader.raw_messages(['/tf'])]
        assert reader.topics()['/tf'].message_count == len(stamps)
        qos = {
            name: [(each.depth, each.durability) for each in offers]
            for name, offers in reader.offered_qos().items()
        }
    assert stamps == [*range(SECOND_NS, SECOND_NS + 50 * TICK_NS, PERIOD_NS), 1_200_000_000]
    assert qos['/tf'][0] == (128, 'volatile')
    assert qos['/tf_static'] == [(1, 'transient_local')]


def add_tick_to(channels, stamp_ns):
    for topic, data in samples(stamp_ns).items():
        channels.add(topic, stamp_ns, data)


def test_a_recording_goes_on_after_time_has_gone_back(tmp_path):
    path = tmp_path / 'looped.mcap'
    with RecordingWriter(path) as writer:
        channels = DerivedChannels(writer, SHAPE)
        for stamp_ns in (9 * SECOND_NS, SECOND_NS, SECOND_NS + PERIOD_NS):
            add_tick_to(channels, stamp_ns)
    with RecordingReader(path) as reader:
        stamps = [raw.stamp_ns for raw in reader.raw_messages(['/tf'])]
    assert stamps == [9 * SECOND_NS, SECOND_NS, SECOND_NS + PERIOD_NS]


numbers = st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0))
pitches = st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
variances = st.tuples(st.floats(1e-6, 9.0), st.floats(1e-6, 9.0))


@given(numbers, numbers, pitches, numbers, variances)
def test_measured_motion_survives_its_messages(position, velocity, pitch, rate, variance):
    columns = (np.array(each)[:, np.newaxis] for each in (position, velocity, pitch, rate))
    variances = np.array(variance)[:, np.newaxis]
    state = OdometryState(*(Estimate(each, variances) for each in columns))
    stamps = np.array([SECOND_NS])
    odometry = decoder(ODOM.type_name)(encode_odom(stamps, state).tobytes())
    point, speed = odometry.pose.pose.position, odometry.twist.twist.linear
    assert (point.x, -point.y, speed.x, -speed.y) == (*position, *velocity)
    for covariance in (odometry.pose.covariance, odometry.twist.covariance):
        assert covariance.reshape(6, 6).diagonal().tolist() == [*variance, *[EXACT] * 4]
        assert not (covariance.reshape(6, 6) - np.diag(covariance.reshape(6, 6).diagonal())).any()
    imu = decoder(IMU_DATA.type_name)(encode_imu_data(stamps, state).tobytes())
    assert body_pitch(imu) == pytest.approx(pitch, abs=1e-9)
    assert body_rates(imu) == rate
    for covariance in (imu.orientation_covariance, imu.angular_velocity_covariance):
        assert covariance.reshape(3, 3).diagonal().tolist() == [*reversed(variance), EXACT]
    assert imu.linear_acceleration_covariance[0] == -1.0
