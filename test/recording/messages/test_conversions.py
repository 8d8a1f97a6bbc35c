"""Messages and plain values: exact both ways, as rosbags and rclpy read them."""

import math

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from maps import drawn

from ballbot_ros.recording.messages import conversions as c
from ballbot_ros.recording.messages import devices
from ballbot_ros.recording.messages.raw import decoder, stamp_of
from ballbot_ros.recording.messages.topics import (
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
    PUSH,
    SONAR_RANGE,
)
from ballbot_ros.recording.schemas import encoder, new_message
from ballbot_ros.robot.brick.bluetooth import LogPacket
from ballbot_ros.robot.brick.sensors import battery_mv
from ballbot_ros.robot.plant.ground_truth import GroundTruth
from ballbot_ros.robot.world.floor_map import occupancy_grid

STAMP = 1_234_000_000
int32 = st.integers(-(2**31), 2**31 - 1)
finite = st.floats(-1e3, 1e3)
pairs = st.tuples(finite, finite)


def by_rosbags(topic, data):
    return decoder(topic.type_name)(data)


def by_rclpy(topic, data):
    serialization = pytest.importorskip('rclpy.serialization')
    return serialization.deserialize_message(data, topic.message_class)


@pytest.fixture(params=[by_rosbags, by_rclpy], scope='module')
def read(request):
    return request.param


def truth(**values):
    pair = (0.0, 0.0)
    blank = dict.fromkeys(GroundTruth._fields, pair) | {
        'stamp_ns': STAMP,
        'battery_voltage': 8.0,
        'steps': (),
    }
    return GroundTruth(**blank | values)


@given(counts=st.tuples(st.integers(0, 1023), st.integers(0, 1023)))
def test_gyro_readings_come_back(read, counts):
    data = devices.encode_gyro(STAMP, counts)
    assert devices.decode_gyro(data) == counts
    message = read(GYRO_IMU, data)
    assert stamp_of(data) == c.stamp_ns(message) == STAMP
    assert message.angular_velocity.y == pytest.approx(math.radians(counts[0]))
    assert message.orientation_covariance[0] == message.linear_acceleration_covariance[0] == -1.0


@given(counts=st.tuples(int32, int32))
def test_encoder_counts_come_back(read, counts):
    data = devices.encode_encoders(STAMP, counts)
    assert devices.decode_encoders(data) == counts
    assert list(read(JOINT_STATES, data).name) == c.MOTOR_NAMES


@pytest.mark.parametrize('names', [['left_wheel', 'right_wheel'], ['motor_y', 'motor_x'], []])
def test_the_joints_of_another_robot_are_refused(names):
    message = new_message(JOINT_STATES.type_name)
    message.name, message.position = names, [0.0, 0.0]
    with pytest.raises(ValueError, match=r'not .*motor_x'):
        devices.decode_encoders(encoder(JOINT_STATES.type_name)(message))


def test_every_sonar_reading_comes_back():
    readings = range(-1, 256)
    assert [
        devices.decode_sonar(devices.encode_sonar(STAMP, sonar_cm, 0.5)) for sonar_cm in readings
    ] == list(readings)


def test_the_field_of_view_is_the_cone_of_the_driver(read):
    for cone_angle in (0.0, 0.52):
        message = read(SONAR_RANGE, devices.encode_sonar(STAMP, 10, cone_angle))
        assert message.field_of_view == pytest.approx(cone_angle)
        assert message.max_range == pytest.approx(2.54)


def test_what_no_sensor_can_have_sent_is_refused():
    for data, decode, told in (
        (devices.encode_sonar(STAMP, 256), devices.decode_sonar, '256 cm is not within'),
        (_with_range(-0.02), devices.decode_sonar, 'not within 0 … 255'),
        (_with_range(2.56), devices.decode_sonar, 'not within 0 … 255'),
        (_with_range(1e38), devices.decode_sonar, 'not within 0 … 255'),
        (_with_range(-math.inf), devices.decode_sonar, '-inf m is no distance'),
        (devices.encode_encoders(STAMP, (2**31, 0)), devices.decode_encoders, '32 bits'),
        (devices.encode_encoders(STAMP, (0, 10**300)), devices.decode_encoders, '32 bits'),
    ):
        with pytest.raises(ValueError, match=told):
            decode(data)


def _with_range(distance):
    message = decoder(SONAR_RANGE.type_name)(devices.encode_sonar(STAMP, 20))
    message.range = distance
    return encoder(SONAR_RANGE.type_name)(message)


def test_no_echo_is_infinite_and_no_data_is_not_a_number(read):
    assert read(SONAR_RANGE, devices.encode_sonar(STAMP, 255)).range == math.inf
    assert math.isnan(read(SONAR_RANGE, devices.encode_sonar(STAMP, -1)).range)


@pytest.mark.parametrize('source', ['', 'scenario', 'joy', 'somebody else'])
def test_every_stick_value_comes_back(source):
    for value in range(-128, 128):
        data = c.encode_sticks(STAMP, (value, -value), source)
        assert c.decode_sticks(data) == (value, -value)
    assert by_rclpy(GAMEPAD_JOY, data).header.frame_id == source


@given(
    duty=st.tuples(st.integers(-100, 100), st.integers(-100, 100)),
    delay_us=st.integers(0, 20_000),
)
def test_duties_come_back(read, duty, delay_us):
    data = c.encode_duty(STAMP, duty, 1000 * delay_us)
    assert c.decode_duty(data) == (*duty, 1000 * delay_us)
    vector = read(MOTOR_DUTY, data).vector
    assert (vector.x, vector.y, vector.z) == (*duty, pytest.approx(1e-6 * delay_us))


@pytest.mark.parametrize('delay_ns', [-1, 20_000_001, math.nan, math.inf])
def test_a_duty_that_is_later_than_any_is_not_a_duty(delay_ns):
    assert c.decode_duty(c.encode_duty(STAMP, (1, 2), delay_ns)) is None


@pytest.mark.parametrize('duty', [(0.5, 0.0), (0.0, 101.0), (math.nan, 0.0), (-101.0, 0.0)])
def test_a_duty_that_no_motor_has_is_not_a_duty(duty):
    assert c.decode_duty(c.encode_duty(STAMP, duty)) is None


@given(angle=pairs, rate=pairs, torque=pairs)
def test_motor_truth_comes_back_to_the_bit(read, angle, rate, torque):
    data = c.encode_motors(truth(motor_angle=angle, motor_rate=rate, motor_torque=torque))
    assert c.decode_motor_angles(data) == angle
    message = read(PLANT_JOINT_STATES, data)
    assert tuple(message.velocity) == rate
    assert tuple(message.effort) == torque


@given(psi=st.tuples(st.floats(-1.4, 1.4), st.floats(-1.4, 1.4)), rate=pairs)
def test_body_truth_comes_back(read, psi, rate):
    data = c.encode_body(truth(psi=psi, psi_rate=rate))
    message = read(PLANT_IMU, data)
    assert c.decode_body_rates(data) == c.body_rates(message) == rate
    assert c.body_pitch(message) == pytest.approx(psi, abs=1e-12)
    q = message.orientation
    assert q.w**2 + q.x**2 + q.y**2 + q.z**2 == pytest.approx(1.0)
    roll = math.atan2(2 * (q.w * q.x + q.y * q.z), 1 - 2 * (q.x**2 + q.y**2))
    pitch = math.asin(max(-1.0, min(1.0, 2 * (q.w * q.y - q.z * q.x))))
    assert (pitch, roll) == pytest.approx(psi, abs=1e-7)


@given(position=pairs, velocity=pairs)
def test_plane_y_is_minus_y_of_the_map(read, position, velocity):
    data = c.encode_odometry(truth(position=position, velocity=velocity), 0.026)
    message = read(PLANT_ODOM, data)
    assert c.decode_ball_position(data) == c.odometry_position(message) == position
    assert message.pose.pose.position.y == -position[1]
    assert message.twist.twist.linear.x == velocity[0]
    assert message.twist.twist.linear.y == -velocity[1]
    assert message.pose.pose.position.z == 0.026


def test_a_map_comes_back_as_its_grid(read):
    grid = occupancy_grid(drawn('.#-', '##.'))
    back = c.map_grid(read(MAP, c.encode_map(STAMP, grid)))
    assert back[:2] == grid[:2]
    assert back.resolution == pytest.approx(grid.resolution)
    assert back.origin == grid.origin
    np.testing.assert_array_equal(back.cells, grid.cells)


def test_a_rightward_push_in_the_map_is_positive_on_plane_y(read):
    message = new_message('geometry_msgs/msg/WrenchStamped')
    message.wrench.force.x, message.wrench.force.y = 2.0, -3.0
    message.wrench.torque.y, message.wrench.torque.x = 0.4, 0.5
    assert c.push_forces(message) == ((2.0, 3.0), (0.4, 0.5))
    assert c.push_forces(read(PUSH, c.encode_push(STAMP, (2.0, 3.0)))) == ((2.0, 3.0), (0, 0))


@given(mv=st.integers(1000, 12000))
def test_the_battery_voltage_is_exact_in_single_precision(read, mv):
    volts = float(np.float32(mv / 1000))
    data = c.encode_battery(STAMP, volts)
    message = read(BATTERY_STATE, data)
    assert message.voltage == volts
    assert c.decode_battery_mv(data) == battery_mv(volts)
    assert math.isnan(message.charge)
    assert message.present


def test_a_log_packet_travels_as_its_32_bytes(read):
    packet = LogPacket(1234, 0, 0, 8005, 0, -5, 7, -100, 100, 0, 0, 255)
    assert c.log_packet(read(BLUETOOTH_TX, c.encode_log(packet))) == packet


@pytest.mark.parametrize('data', [b'', b'\0\1\0\0', bytes(11)])
def test_too_few_bytes_for_a_stamp_are_not_a_message(data):
    with pytest.raises(ValueError, match='buffer'):
        stamp_of(data)
