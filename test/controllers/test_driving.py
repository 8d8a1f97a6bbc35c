"""What the controllers that ship share: driving, data log, display."""

from itertools import pairwise

import pytest
from parts import AT_REST

from ballbot_ros.controllers import OperatingState, Readings
from ballbot_ros.controllers.codegen.implementation import compose_controller, implementation_for
from ballbot_ros.controllers.driving import Driving, SpeedReference
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, ParameterSet
from ballbot_ros.parameters.timing import TICK_S


def driving(**settings):
    tones = []
    made = Driving(ControllerParameters(**settings), lambda *tone: tones.append(tone))
    return made, tones


def readings(elapsed_ms, **changes):
    values = {'gyro': (601, 599), 'revolutions': (0, 0), 'battery_mv': 8000, **changes}
    return Readings(elapsed_ms, **values)


def test_the_offsets_are_the_means_of_the_calibration():
    made, tones = driving(time_start=12)
    for elapsed_ms, gyro in ((0, (600, 500)), (4, (601, 503)), (8, (602, 503))):
        assert made.update(readings(elapsed_ms, gyro=gyro)) is OperatingState.CALIBRATION
        assert not made.balances
    assert made.update(readings(12, gyro=(700, 700))) is OperatingState.REMOTE
    assert made.balances
    assert made.gyro_offsets == (601.0, 502.0)
    assert tones == [(440, 500, 70)]
    assert made.inputs(readings(12), 0).rate == 0.0


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
    made, _ = driving(time_stop=10_000, **settings)
    made.update(readings(0))
    now = readings(elapsed_ms, distance_cm=distance_cm, sticks=(-50, 20))
    assert made.update(now) is state
    assert made.sticks == sticks
    speed = made.inputs(now, 0).speed
    assert speed == sticks[0] / settings.get('gp_max', 100) * 380.0


def test_the_last_echo_holds_for_a_while():
    made, _ = driving(sonar_hold=100, time_stop=10_000)
    made.update(readings(0))
    states = [
        made.update(readings(elapsed_ms, distance_cm=distance_cm))
        for elapsed_ms, distance_cm in ((1000, 20), (1004, 255), (1100, 255), (1104, 255))
    ]
    near, far = OperatingState.BACKWARD, OperatingState.REMOTE
    assert states == [near, near, near, far]


@pytest.mark.parametrize('lost', ['psi', 'theta'])
def test_a_lost_robot_stops_for_good(lost):
    made, _ = driving(time_start=0, time_stop=20)
    controller = SimplePlanes()
    made.update(readings(0))
    for elapsed_ms in range(4, 40, 4):
        made.update(readings(elapsed_ms))
        if elapsed_ms > 8:
            setattr(controller.x, lost, -700.0 if lost == 'theta' else 16.0)
        if made.balances:
            made.watch(readings(elapsed_ms), controller.x, controller.y)
        # In control until 8 ms, and 20 ms later it has been lost for too long.
        assert (made.state is OperatingState.OUT_OF_CONTROL) == (elapsed_ms >= 28), elapsed_ms
    setattr(controller.x, lost, 0.0)
    assert made.update(readings(40)) is OperatingState.OUT_OF_CONTROL


class SimplePlanes:
    def __init__(self):
        from ballbot_ros.controllers import Estimates

        self.x, self.y = (Estimates(0.0, 0.0, 0.0, 0.0, 0.0, 0.0) for _ in 'xy')


def test_the_reference_reaches_the_speed_without_a_jump_of_acceleration():
    reference = SpeedReference(0.3)
    speeds, accelerations = [], []
    for _ in range(1000):
        reference.update(100.0)
        speeds.append(reference.theta_dot)
        accelerations.append(reference.theta_ddot)
    assert speeds[-1] == pytest.approx(100.0, abs=0.1)
    assert sum(speeds[:-1]) * TICK_S == pytest.approx(reference.theta)
    assert max(map(abs, map(float.__sub__, accelerations[1:], accelerations))) < 10.0


def test_they_log_and_show_as_the_documents_program_does():
    for name in ('pid', 'drift_filter', 'python'):
        parameters = ParameterSet()
        parameters.set(CONTROLLER, 'implementation', name)
        compose_controller(parameters)
        program = implementation_for(parameters.of(ControllerParameters)).make()
        outputs = [program.tick(4 * n, 4 * n, AT_REST) for n in range(500)]
        assert [n for n, each in enumerate(outputs) if each.pages] == [0, 125, 250, 375], name
        logged = [n for n, each in enumerate(outputs) if each.log]
        assert {after - before for before, after in pairwise(logged)} == {25}, name
        assert len(logged) == 10, name
