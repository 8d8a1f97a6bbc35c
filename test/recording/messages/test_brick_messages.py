"""What the data log of a brick tells is what the simulation publishes of the same moment."""

import math

import pytest

from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.scenario.reader import load_profile, load_scenario
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, LogFormat
from ballbot_ros.recording.messages import topics
from ballbot_ros.recording.messages.brick_messages import BrickMessages
from ballbot_ros.recording.messages.conversions import (
    controller_state,
    decode_battery_mv,
    decode_real_duty,
    decode_sticks,
    log_packet,
    time_ns,
)
from ballbot_ros.recording.messages.devices import decode_encoders, decode_gyro, decode_sonar
from ballbot_ros.recording.messages.raw import decoder, stamp_of
from ballbot_ros.robot.brick.bluetooth import LogPacket

NAMES = {'x': 0, 'y': 1}


def messages_of(parameters, act):
    """Return what is sent while `act` uses the messages: topic, stamp and bytes."""
    sent = []
    act(
        BrickMessages(
            lambda topic: lambda stamp_ns, data: sent.append((topic, stamp_ns, data)),
            LogFormat.from_parameters(parameters),
        )
    )
    return sent


def decoded(sent):
    return {topic: decoder(topic.type_name)(data) for topic, _, data in sent}


@pytest.mark.parametrize(
    ('lsb', 'content'), [(2.0**-10, 'pitch'), (0.01, 'duties'), (0.01, 'duties_and_gyros')]
)
def test_a_packet_says_what_the_simulation_publishes_at_the_same_tick(lsb, content):
    parameters = load_profile('hardware')
    parameters.set(CONTROLLER, 'log_content', content)
    parameters.set(CONTROLLER, 'lsb', lsb)
    parameters.set(CONTROLLER, 'wheel_radius', 0.02)
    settings = parameters.of(ControllerParameters)
    loop = ClosedLoop(parameters, load_scenario('hardware_forward_backward'))
    told = 0
    for tick in loop.ticks(6.0):
        for packet in tick.outputs.log:
            told += 1
            sent = messages_of(settings, lambda brick, packet=packet: brick.packet(5, packet))
            assert {stamp for _, stamp, _ in sent} == {5}
            raw, found = {topic: data for topic, _, data in sent}, decoded(sent)
            assert decode_encoders(raw[topics.JOINT_STATES]) == tick.inputs.revolutions
            assert decode_sonar(raw[topics.SONAR_RANGE]) == packet.sonar_cm
            assert decode_battery_mv(raw[topics.BATTERY_STATE]) == packet.battery_mv
            assert log_packet(found[topics.BLUETOOTH_TX]) == packet
            duty, gyro = raw.get(topics.MOTOR_DUTY), raw.get(topics.GYRO_IMU)
            assert (duty and decode_real_duty(duty)) == (
                None
                if content == 'pitch'
                else (loop.program.state.duty_x, loop.program.state.duty_y)
            )
            assert (gyro and decode_gyro(gyro)) == (
                tick.inputs.gyro if content == 'duties_and_gyros' else None
            )
            state, program = controller_state(found[topics.CONTROLLER_STATE]), loop.program
            for plane, at in NAMES.items():
                estimates = getattr(program, plane)
                assert math.degrees(state.psi[at]) == pytest.approx(estimates.psi, abs=0.51 * lsb)
                assert math.degrees(state.theta[at]) == pytest.approx(
                    estimates.theta, abs=0.51 * lsb + 1e-3
                )
                assert math.isnan(state.theta_ref[at])
    assert told > 40


def test_a_distance_before_the_first_request_is_not_sent():
    early = LogPacket(0, 0, 0, 8000, 0, 0, 0, 0, 0, 0, 0, -1)
    sent = messages_of(ControllerParameters(), lambda brick: brick.packet(5, early))
    assert topics.SONAR_RANGE not in decoded(sent)


def test_a_run_and_the_sticks_have_the_stamps_and_names_given():
    def act(brick):
        brick.begin(7, '1 brick')
        brick.sticks(9, (-50, 20), 'keyboard')

    (_, _, run), (topic, stamp_ns, sticks) = messages_of(ControllerParameters(), act)
    header = decoder(topics.RUN.type_name)(run)
    assert (time_ns(header.stamp), header.frame_id) == (7, '1 brick')
    assert (topic, stamp_ns, stamp_of(sticks)) == (topics.GAMEPAD_JOY, 9, 9)
    assert decode_sticks(sticks) == (-50, 20)
    assert decoder(topics.GAMEPAD_JOY.type_name)(sticks).header.frame_id == 'keyboard'
