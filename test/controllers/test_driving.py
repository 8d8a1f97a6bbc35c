"""What the controllers that ship share: driving, data log, display."""

from itertools import pairwise
from typing import NamedTuple

import parts
import pytest
from parts import AT_REST

from ballbot_ros.controllers import OperatingState, Readings
from ballbot_ros.controllers.codegen.implementation import compose_controller, implementation_for
from ballbot_ros.controllers.driving import (
    NO_MOTION,
    NO_REFERENCE,
    OPERATING_STATES,
    STANDING_BY,
    DrivingConstants,
    Motion,
    PlaneInputs,
    State,
    driving_constants,
    driving_law,
    low_pass_share,
    next_reference,
)
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, ParameterSet
from ballbot_ros.parameters.timing import TICK_S


def readings(elapsed_ms, **changes):
    values = {'gyro': (601, 599), 'revolutions': (0, 0), 'battery_mv': 8000, **changes}
    return Readings(elapsed_ms, **values)


class Constants(NamedTuple):
    driving: DrivingConstants


class Plane(NamedTuple):
    motion: Motion
    inputs: PlaneInputs | None = None


class Driven:
    """A robot whose planes have no law: they report the given motion, and their inputs."""

    def __init__(self, **settings):
        self.constants = Constants(driving_constants(ControllerParameters(**settings)))
        self.state = State(STANDING_BY, Plane(NO_MOTION), Plane(NO_MOTION))
        self.motions = [NO_MOTION, NO_MOTION]

    def tick(self, readings):
        def balance(constants, plane, inputs):
            return Plane(self.motions[inputs.axis], inputs), 7 + inputs.axis

        self.state, self.duty = driving_law(balance)(self.constants, self.state, readings)
        return OPERATING_STATES[self.state.driving.operating]


def test_the_offsets_are_the_means_of_the_calibration():
    robot = Driven(time_start=12)
    for elapsed_ms, gyro in ((0, (600, 500)), (4, (601, 503)), (8, (602, 503))):
        assert robot.tick(readings(elapsed_ms, gyro=gyro)) is OperatingState.CALIBRATION
        assert (robot.duty, robot.state.driving.balanced) == ((0, 0), 0)
    assert robot.tick(readings(12, gyro=(700, 700))) is OperatingState.REMOTE
    assert (robot.duty, robot.state.driving.balanced) == ((7, 8), 1)
    assert (robot.state.x.inputs.rate, robot.state.y.inputs.rate) == (99.0, 198.0)


@pytest.mark.parametrize(
    ('settings', 'elapsed_ms', 'distance_cm', 'state', 'sticks'),
    [
        ({}, 2000, 255, OperatingState.REMOTE, (50, 20)),
        ({}, 2000, 30, OperatingState.BACKWARD, (-100, 20)),
        ({}, 2000, 31, OperatingState.REMOTE, (50, 20)),
        ({'mode': 'autonomous'}, 4996, 10, OperatingState.BALANCE, (0, 0)),
        ({'mode': 'autonomous'}, 5000, 255, OperatingState.FORWARD, (100, 0)),
        ({'mode': 'autonomous'}, 5000, 30, OperatingState.RIGHTWARD, (0, 100)),
        ({'gp_max': 40}, 2000, 255, OperatingState.REMOTE, (40, 20)),
    ],
)
def test_each_state_has_its_command(settings, elapsed_ms, distance_cm, state, sticks):
    robot = Driven(time_stop=10_000, **settings)
    robot.tick(readings(0))
    assert robot.tick(readings(elapsed_ms, distance_cm=distance_cm, sticks=(-50, 20))) is state
    planes = [each.inputs for each in robot.state[1:]]
    assert tuple(each.stick for each in planes) == sticks
    full = settings.get('gp_max', 100)
    assert [each.speed for each in planes] == [each / full * 380.0 for each in sticks]


def test_the_last_echo_holds_for_a_while():
    robot = Driven(sonar_hold=100, time_stop=10_000)
    robot.tick(readings(0))
    states = [
        robot.tick(readings(elapsed_ms, distance_cm=distance_cm))
        for elapsed_ms, distance_cm in ((1000, 20), (1004, 255), (1100, 255), (1104, 255))
    ]
    near, far = OperatingState.BACKWARD, OperatingState.REMOTE
    assert states == [near, near, near, far]


@pytest.mark.parametrize('lost', [{'psi': 16.0}, {'theta': -700.0}])
@pytest.mark.parametrize('axis', [0, 1])
def test_a_lost_robot_stops_for_good(lost, axis):
    robot = Driven(time_start=0, time_stop=20)
    robot.tick(readings(0))
    for elapsed_ms in range(4, 40, 4):
        if elapsed_ms > 8:
            robot.motions[axis] = NO_MOTION._replace(**lost)
        state = robot.tick(readings(elapsed_ms))
        # In control until 8 ms, and 20 ms later it has been lost for too long.
        assert (state is OperatingState.OUT_OF_CONTROL) == (elapsed_ms >= 28), elapsed_ms
    robot.motions[axis] = NO_MOTION
    assert robot.tick(readings(40)) is OperatingState.OUT_OF_CONTROL
    assert robot.duty == (0, 0)


def test_the_reference_reaches_the_speed_without_a_jump_of_acceleration():
    share, reference = low_pass_share(0.3), NO_REFERENCE
    references = []
    for _ in range(1000):
        reference = next_reference(share, reference, 100.0)
        references.append(reference)
    speeds = [each.theta_dot for each in references]
    accelerations = [each.theta_ddot for each in references]
    assert speeds[-1] == pytest.approx(100.0, abs=0.1)
    assert sum(speeds[:-1]) * TICK_S == pytest.approx(reference.theta)
    assert max(map(abs, map(float.__sub__, accelerations[1:], accelerations))) < 10.0


def test_they_log_and_show_as_the_documents_program_does():
    for name in ('pid', 'drift_filter', 'python'):
        parameters = ParameterSet()
        parameters.set(CONTROLLER, 'implementation', name)
        compose_controller(parameters)
        program = implementation_for(parameters.of(ControllerParameters)).make()
        outputs = [parts.tick(program, 4 * n, 4 * n, AT_REST) for n in range(500)]
        assert [n for n, each in enumerate(outputs) if each.pages] == [0, 125, 250, 375], name
        logged = [n for n, each in enumerate(outputs) if each.log]
        assert {after - before for before, after in pairwise(logged)} == {25}, name
        assert len(logged) == 10, name
        tones = [(n, *tone) for n, each in enumerate(outputs) for tone in each.tones]
        assert tones == [(250, 440, 500, 70)], name
