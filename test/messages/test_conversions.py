"""Messages and plain values: exact both ways, through the encoding, for both message libraries."""

import math

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from maps import drawn

from ballbot_ros.brick.bluetooth import LogPacket
from ballbot_ros.messages import conversions as c
from ballbot_ros.messages import devices
from ballbot_ros.messages.raw import decoder, stamp_of
from ballbot_ros.messages.topics import (
    BATTERY_STATE,
    BLUETOOTH_TX,
    GAMEPAD_JOY,
    GYRO_IMU,
    JOINT_STATES,
    MAP,
    MOTOR_DUTY,
    PLANT_IMU,
    PLANT_JOINT_STATES,
    PLANT_ODOM,
    SONAR_RANGE,
)
from ballbot_ros.parameters import SonarParameters
from ballbot_ros.plant.ground_truth import GroundTruth
from ballbot_ros.recording.encoding import encoder, new_message
from ballbot_ros.world.exports import occupancy_grid

STAMP = 1_234_000_000
int32 = st.integers(-(2**31), 2**31 - 1)
finite = st.floats(-1e3, 1e3)
pairs = st.tuples(finite, finite)


def through_rosbags(topic, fill, *values):
    message = new_message(topic.type_name)
    fill(message, *values)
    data = encoder(topic.type_name)(message)
    return decoder(topic.type_name)(data), data


def through_rclpy(topic, fill, *values):
    serialization = pytest.importorskip('rclpy.serialization')
    message = topic.message_class()
    fill(message, *values)
    data = serialization.serialize_message(message)
    return serialization.deserialize_message(data, topic.message_class), data


@pytest.fixture(params=[through_rosbags, through_rclpy], scope='module')
def through(request):
    return request.param


def truth(**values):
    pair = (0.0, 0.0)
    blank = dict.fromkeys(GroundTruth._fields, pair) | {'stamp_ns': STAMP, 'battery_voltage': 8.0}
    return GroundTruth(**blank | values)


@given(counts=st.tuples(st.integers(0, 1023), st.integers(0, 1023)))
def test_gyro_readings_come_back(through, counts):
    message, data = through(GYRO_IMU, devices.fill_gyro, STAMP, counts)
    assert devices.gyro_counts(message) == counts
    assert stamp_of(data) == c.stamp_ns(message) == STAMP


@given(counts=st.tuples(int32, int32))
def test_encoder_counts_come_back(through, counts):
    message, _ = through(JOINT_STATES, devices.fill_encoders, STAMP, counts)
    assert devices.encoder_counts(message) == counts


def test_the_joints_of_another_robot_are_refused(through):
    def fill(message):
        message.name, message.position = ['left_wheel', 'right_wheel'], [0.0, 0.0]

    message, _ = through(JOINT_STATES, fill)
    with pytest.raises(ValueError, match='left_wheel'):
        devices.encoder_counts(message)


@pytest.mark.parametrize('range_m', [-0.02, 2.56, 1e38])
def test_a_distance_beyond_the_register_is_refused(range_m):
    message, _ = through_rosbags(SONAR_RANGE, devices.fill_sonar, STAMP, 0)
    message.range = range_m
    with pytest.raises(ValueError, match='not within 0 … 255'):
        devices.sonar_range_cm(message)


@pytest.mark.parametrize('sonar_cm', range(-1, 256))
def test_every_sonar_reading_comes_back(sonar_cm):
    message, _ = through_rosbags(SONAR_RANGE, devices.fill_sonar, STAMP, sonar_cm)
    assert devices.sonar_range_cm(message) == sonar_cm


@pytest.mark.parametrize('cone_angle', [0.0, 0.52])
def test_the_field_of_view_is_the_cone_of_the_driver(through, cone_angle):
    parameters = SonarParameters(cone_angle=cone_angle)
    message, _ = through(SONAR_RANGE, devices.describe_sonar, parameters)
    assert message.field_of_view == pytest.approx(cone_angle)
    assert message.max_range == pytest.approx(2.54)


def test_no_echo_is_infinite_and_no_data_is_not_a_number(through):
    assert through(SONAR_RANGE, devices.fill_sonar, STAMP, 255)[0].range == math.inf
    assert math.isnan(through(SONAR_RANGE, devices.fill_sonar, STAMP, -1)[0].range)


@pytest.mark.parametrize('value', range(-128, 128))
def test_every_stick_value_comes_back(value):
    message, _ = through_rosbags(GAMEPAD_JOY, c.fill_sticks, STAMP, (value, -value), 'joy')
    assert c.stick_values(message) == (value, -value)


@given(duty=st.tuples(st.integers(-100, 100), st.integers(-100, 100)))
def test_duties_come_back(through, duty):
    assert c.duty_values(through(MOTOR_DUTY, c.fill_duty, STAMP, duty)[0]) == duty


@given(angle=pairs, rate=pairs, torque=pairs)
def test_motor_truth_comes_back_to_the_bit(through, angle, rate, torque):
    state = truth(motor_angle=angle, motor_rate=rate, motor_torque=torque)
    message, _ = through(PLANT_JOINT_STATES, c.fill_motors, state)
    assert c.motor_angles(message) == angle
    assert tuple(message.velocity) == rate
    assert tuple(message.effort) == torque


@given(psi=st.tuples(st.floats(-1.4, 1.4), st.floats(-1.4, 1.4)), rate=pairs)
def test_body_truth_comes_back(through, psi, rate):
    message, _ = through(PLANT_IMU, c.fill_body, truth(psi=psi, psi_rate=rate))
    assert c.body_rates(message) == rate
    assert c.body_pitch(message) == pytest.approx(psi, abs=1e-12)
    q = message.orientation
    assert q.w**2 + q.x**2 + q.y**2 + q.z**2 == pytest.approx(1.0)
    roll = math.atan2(2 * (q.w * q.x + q.y * q.z), 1 - 2 * (q.x**2 + q.y**2))
    pitch = math.asin(max(-1.0, min(1.0, 2 * (q.w * q.y - q.z * q.x))))
    assert (pitch, roll) == pytest.approx(psi, abs=1e-7)


@given(position=pairs, velocity=pairs)
def test_plane_y_is_minus_y_of_the_map(through, position, velocity):
    state = truth(position=position, velocity=velocity)
    message, _ = through(PLANT_ODOM, c.fill_odometry, state, 0.026)
    assert c.ball_position(message) == position
    assert message.pose.pose.position.y == -position[1]
    assert message.twist.twist.linear.x == velocity[0]
    assert message.twist.twist.linear.y == -velocity[1]
    assert message.pose.pose.position.z == 0.026


def test_a_map_comes_back_as_its_grid(through):
    grid = occupancy_grid(drawn('.#-', '##.'))
    message, _ = through(MAP, c.fill_map, STAMP, grid)
    back = c.map_grid(message)
    assert back[:2] == grid[:2]
    assert back.resolution == pytest.approx(grid.resolution)
    assert back.origin == grid.origin
    np.testing.assert_array_equal(back.cells, grid.cells)


def test_a_rightward_push_in_the_map_is_positive_on_plane_y():
    message = new_message('geometry_msgs/msg/WrenchStamped')
    message.wrench.force.x, message.wrench.force.y = 2.0, -3.0
    message.wrench.torque.y, message.wrench.torque.x = 0.4, 0.5
    assert c.push_forces(message) == ((2.0, 3.0), (0.4, 0.5))


@given(mv=st.integers(1000, 12000))
def test_the_battery_voltage_is_exact_in_single_precision(mv):
    volts = float(np.float32(mv / 1000))
    message, _ = through_rosbags(BATTERY_STATE, c.fill_battery, truth(battery_voltage=volts))
    assert message.voltage == volts


def test_a_log_packet_travels_as_its_32_bytes(through):
    packet = LogPacket(1234, 0, 0, 8005, 0, -5, 7, -100, 100, 0, 0, 255)
    message, _ = through(BLUETOOTH_TX, c.fill_log, packet)
    assert LogPacket.decode(bytes(message.data)) == packet


@pytest.mark.parametrize('data', [b'', b'\0\1\0\0', bytes(11)])
def test_too_few_bytes_for_a_stamp_are_not_a_message(data):
    with pytest.raises(ValueError, match='buffer'):
        stamp_of(data)
