"""Gains and thresholds that change during a run."""

import math
from functools import cache
from pathlib import Path

import parts
import pytest
from own_controllers import BALANCE
from pushes import pushes
from shipped_controllers import duties

from ballbot_ros.controllers import interface as glide
from ballbot_ros.controllers.codegen.implementation import compose_controller, implementation_for
from ballbot_ros.controllers.interface import GLIDE_TICKS, OperatingState
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.errors import ControllerError
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, ParameterError, ParameterSet
from ballbot_ros.robot.brick.brick import DeviceInputs

SHIPPED = ('python', 'pid', 'lqg', 'drift_filter', 'mpc')
GAINS = {
    'python': {'k_f': (-0.02, -1.2, -0.03, -0.2), 'k_i': -0.01, 'pwm_gain': 0.9},
    'drift_filter': {'k_f': (-0.02, -1.2, -0.03, -0.2), 'k_i': -0.01, 'pwm_gain': 0.9},
    'pid': {
        'user.pitch_p': 1.3, 'user.pitch_d': 0.25, 'user.position_p': 0.015,
        'user.position_i': 0.006, 'user.position_d': 0.012, 'user.back_emf': 0.013,
    },
}  # fmt: skip


def composed(controller, **values):
    """Return the parameters of a controller, as a run is composed."""
    parameters = ParameterSet()
    parameters.set(CONTROLLER, 'implementation', controller)
    for name, value in values.items():
        parameters.set(CONTROLLER, name, value)
    compose_controller(parameters)
    return parameters.of(ControllerParameters)


def other_gains(controller, parameters):
    """Return the parameters with other gains; all of the LQG's and the MPC's."""
    if controller in GAINS:
        return parameters.with_values(GAINS[controller])
    changed = {'user.feedback': 1.3, 'user.feedforward': 0.7}
    values = parameters.values()
    return parameters.with_values(
        {name: tuple(each * share for each in values[name]) for name, share in changed.items()}
    )


def devices(gyro=(600, 600), revolutions=(0, 0), sonar_cm=255, sticks=(0, 0)):
    return DeviceInputs(gyro, revolutions, sonar_cm, 8000, sticks)


class Robot:
    """A program that reads steady devices, after the calibration."""

    def __init__(self, controller, inputs, parameters=None):
        self.parameters = parameters or composed(controller)
        self.program = implementation_for(self.parameters).make()
        self.now_ms = 0
        at_rest = devices()
        while self.now_ms < 1100:
            self.tick(at_rest)
        for _ in range(25):
            self.duty = self.tick(inputs)

    def tick(self, inputs):
        inputs = inputs._replace(
            **dict.fromkeys(('battery_mv', 'sonar_cm', 'sticks')) if self.now_ms % 20 else {}
        )
        outputs = parts.tick(self.program, self.now_ms, 1000 + self.now_ms, inputs)
        self.now_ms += 4
        return outputs.duty


LEANING = Scenario(pushes=pushes(2.0, 60.0, 0.3, -0.2))
"""A robot that leans against a force: its gains act on steady errors, and cancel each other."""


def one_gain(controller, parameters):
    """Return the parameters with another gain of the pitch, or of the integral that balances it."""
    name, index, share = {
        'python': ('k_f', 1, 0.5),
        'drift_filter': ('k_f', 1, 0.5),
        'pid': ('user.position_i', None, 2.0),
    }.get(controller, ('user.feedback', 1, 0.7))
    value = parameters.values()[name]
    if index is None:
        return parameters.with_values({name: value * share})
    numbers = [each * (share if i == index else 1.0) for i, each in enumerate(value)]
    return parameters.with_values({name: tuple(numbers)})


def next_duty(controller, change=lambda program, parameters: None):
    """Return the duty of a leaning robot after a change."""
    _, loop = duties(controller, ticks=1500, sticks=LEANING)
    change(loop.program, composed(controller))
    assert abs(loop.plant.truth().psi[0]) > math.radians(2.0)
    return loop.tick().outputs.duty


@cache
def kept_duty(controller):
    return next_duty(controller)


def retune(program, parameters):
    program.retune(one_gain(parameters.implementation, parameters))


@pytest.mark.parametrize('controller', SHIPPED)
def test_the_duty_does_not_jump(controller, monkeypatch):
    kept, tuned = kept_duty(controller), next_duty(controller, retune)
    monkeypatch.setattr(glide, 'GLIDE_TICKS', 1)
    jumps = next_duty(controller, retune)
    assert max(abs(a - b) for a, b in zip(kept, jumps, strict=True)) >= 3
    assert max(abs(a - b) for a, b in zip(kept, tuned, strict=True)) <= 1


@pytest.mark.parametrize('controller', SHIPPED)
def test_nothing_of_the_old_gains_remains(controller):
    """From then on the same state gives the same duties as a program that had the new gains."""
    inputs = devices(revolutions=(20, -30))
    before = composed(controller)
    tuned = implementation_for(before).make()
    fresh = implementation_for(other_gains(controller, before)).make()
    tuned.retune(other_gains(controller, before))
    for tick in range(GLIDE_TICKS):
        at_rest = inputs._replace(revolutions=(0, 0))
        for program in (tuned, fresh):
            parts.tick(program, 4 * tick, 1000 + 4 * tick, at_rest)
    for tick in range(GLIDE_TICKS, 2 * GLIDE_TICKS + 100):
        found, expected = (
            parts.tick(program, 4 * tick, 1000 + 4 * tick, inputs) for program in (tuned, fresh)
        )
        assert found == expected
    assert found.duty != (0, 0)


@pytest.mark.parametrize('controller', SHIPPED)
def test_a_change_during_a_push_and_back_does_no_harm(controller):
    _, loop = duties(controller, ticks=1000, sticks=Scenario(pushes=pushes(3.9, 0.2, 0.8)))
    before = composed(controller)
    for parameters in (one_gain(controller, before), before) * 3:
        loop.program.retune(parameters)
        for _ in range(20):
            loop.tick()
    after = [loop.tick() for _ in range(1250)]
    assert not loop.plant.fallen
    assert abs(after[-1].truth.position[0]) < 0.1


@pytest.mark.parametrize('controller', SHIPPED)
def test_the_same_values_change_nothing(controller):
    inputs = devices(gyro=(603, 598), revolutions=(20, -30), sticks=(30, 0))
    kept, tuned = (Robot(controller, inputs) for _ in range(2))
    for _ in range(50):
        tuned.program.retune(tuned.parameters)
        assert tuned.tick(inputs) == kept.tick(inputs)
        for plane in ('x', 'y'):
            assert getattr(tuned.program, plane).psi == getattr(kept.program, plane).psi


@pytest.mark.parametrize('controller', SHIPPED)
def test_the_new_gains_balance(controller):
    _, loop = duties(controller, ticks=500)
    loop.program.retune(other_gains(controller, composed(controller)))
    after = [loop.tick() for _ in range(1000)]
    assert not loop.plant.fallen
    assert all(abs(each.truth.psi[0]) < 0.1 for each in after)
    unchanged, _ = duties(controller, ticks=510)
    assert [each.outputs.duty for each in after[:10]] != [tuple(each) for each in unchanged[500:]]


def test_a_restart_of_the_program_keeps_the_gains():
    inputs = devices(revolutions=(20, -30))
    tuned = Robot('python', inputs)
    tuned.program.retune(other_gains('python', tuned.parameters))
    for _ in range(GLIDE_TICKS):
        tuned.tick(inputs)
    tuned.program.run(['task_init'], 5000, inputs)
    fresh = implementation_for(other_gains('python', tuned.parameters)).make()
    fresh.run(['task_init'], 5000, inputs)
    assert tuned.program.x == fresh.x


def test_thresholds_apply_at_once():
    near = devices(sonar_cm=50)
    for controller in ('python', 'lqg'):
        robot = Robot(controller, near)
        assert robot.program.operating_state is OperatingState.REMOTE
        robot.program.retune(robot.parameters.with_values({'dst_thr': 60}))
        for _ in range(5):
            robot.tick(near)
        assert robot.program.operating_state is OperatingState.BACKWARD, controller


def test_the_pitch_limit_of_the_mpc_applies():
    def limit(program, parameters):
        program.retune(parameters.with_values({'user.pitch_limit': 0.3}))
        program._glide._ticks = GLIDE_TICKS - 1

    assert next_duty('mpc', limit) != kept_duty('mpc')


TUNABLE = """
from dataclasses import dataclass
from ballbot_ros.controllers import Controller, TakesEffect, designed, quantity

@dataclass(frozen=True)
class Gains:
    gain: float = quantity(1.0, '1', (0.0, 50.0), 'a gain', takes_effect=TakesEffect.IMMEDIATELY)
    time: float = quantity(1.0, 's', (0.0, 9.0), 'a time')
    row: tuple = designed('1', None, 'a row', takes_effect=TakesEffect.IMMEDIATELY)

    def __post_init__(self):
        if self.gain == 13.0:
            raise ValueError('not this one')

class Own(Controller[Gains]):
    tunable_settings = ('dst_thr',)

    @classmethod
    def design(cls, parameters, model):
        return Gains(row=(1.0, 2.0))

    def retune(self, parameters, settings):
        if parameters.gain > 40.0:
            raise RuntimeError('too much for me')
        super().retune(parameters, settings)

    def tick(self, readings):
        return round(self.parameters.gain), self.settings.dst_thr
"""


@pytest.fixture
def own(tmp_path):
    file = tmp_path / 'own.py'
    file.write_text(TUNABLE)
    return f'{file}:Own'


def test_a_controller_of_ones_own_reads_the_new_values(own):
    inputs = devices()
    robot = Robot(own, inputs)
    assert robot.tick(inputs) == (1, 30)
    robot.program.retune(robot.parameters.with_values({'user.gain': 26.0, 'dst_thr': 40}))
    # Numbers glide to their new values; whole ones change at once.
    assert [robot.tick(inputs) for _ in range(5)] == [(1, 40), (1, 40), (2, 40), (2, 40), (2, 40)]
    found = [robot.tick(inputs)[0] for _ in range(GLIDE_TICKS)]
    assert found == sorted(found)
    assert found[-6:] == [26] * 6


def test_its_tunable_parameters_are_those_that_it_declares(own):
    implementation = implementation_for(composed(own))
    assert [row.name for row in implementation.tunable] == ['dst_thr', 'user.gain', 'user.row']
    document = implementation_for(composed('python'))
    assert {row.name for row in document.tunable} == {
        'k_f', 'k_i', 'pwm_gain', 'pwm_offset', 'k_thetadot', 'dst_thr', 'theta_diff_thr',
        'psi_diff_thr', 'tone_gain',
    }  # fmt: skip
    speed = {'k_thetadot', 'dst_thr', 'theta_diff_thr', 'psi_diff_thr'}
    for name, own_names in {
        'drift_filter': {'k_f', 'k_i', 'pwm_gain', 'pwm_offset'},
        'lqg': {'user.feedback', 'user.feedforward'},
        'mpc': {'user.feedback', 'user.feedforward', 'user.pitch_limit'},
    }.items():
        found = implementation_for(composed(name)).tunable
        assert {row.name for row in found} == speed | own_names


@pytest.mark.parametrize(
    ('values', 'problem'),
    [
        ({'user.row': (1.0, 2.0, 3.0)}, 'controller.user.row: (1.0, 2.0, 3.0) is not a list of 2'),
        ({'user.gain': 13.0}, 'ValueError: not this one'),
    ],
)
def test_values_that_a_program_could_not_take_over_are_refused(own, values, problem):
    parameters = composed(own)
    implementation = implementation_for(parameters)
    implementation.check(parameters.with_values({'user.gain': 2.0}))
    with pytest.raises((ParameterError, ControllerError), match=r'own\.py|row') as caught:
        implementation.check(parameters.with_values(values))
    assert problem in str(caught.value)
    assert '\n' not in str(caught.value)


def test_an_error_while_it_takes_them_over_names_the_line(own):
    robot = Robot(own, devices())
    robot.program.retune(robot.parameters.with_values({'user.gain': 45.0}))
    while robot.program.controller.parameters.gain < 39.7:
        robot.tick(devices())
    with pytest.raises(ControllerError) as caught:
        robot.tick(devices())
    line = TUNABLE.splitlines().index("            raise RuntimeError('too much for me')") + 1
    assert str(caught.value).startswith(f'own.py:{line}: RuntimeError: too much for me (Own.retune')


def test_a_class_without_tunable_parameters_has_none(tmp_path):
    file = tmp_path / 'balance.py'
    file.write_text(BALANCE)
    name = next(line.split('(')[0].split()[1] for line in BALANCE.splitlines()
                if line.startswith('class ') and 'Controller' in line)  # fmt: skip
    assert implementation_for(composed(f'{file}:{name}')).tunable == ()


def test_values_on_the_way_that_its_class_refuses_are_skipped(own):
    """Both ends are allowed, and 13.0, which it refuses, is one of the values between them."""
    robot = Robot(own, devices())
    robot.program.retune(robot.parameters.with_values({'user.gain': 26.0}))
    for _ in range(GLIDE_TICKS):
        robot.tick(devices())
    robot.program.retune(robot.parameters.with_values({'user.gain': 0.0}))
    middle = [robot.tick(devices())[0] for _ in range(GLIDE_TICKS)]
    assert middle[-1] == 0


@pytest.mark.parametrize('name', ['nothing', 'a_d', 3])
def test_settings_that_can_not_be_tuned_are_refused(own, name):
    Path(own.partition(':')[0]).write_text(TUNABLE.replace("('dst_thr',)", f'({name!r},)'))
    with pytest.raises(ControllerError, match=f'tunable_settings: {name!r} is not one of k_theta'):
        composed(own)
