"""The controller's law, the steps of the plant and the readings, compiled without changes."""

import math
import random
import struct

import numpy as np
import pytest
from generated import random_values
from parts import linear_step, nonlinear_step, physical, values_of

from ballbot_ros.controllers.document.axis import (
    ProgramConstants,
    Single,
    calibrated_offset,
    constants_of,
    control,
    in_control,
)
from ballbot_ros.engine.compilation import compiled
from ballbot_ros.engine.devices import SonarConstants, echo, sample_age
from ballbot_ros.parameters import CONTROLLER
from ballbot_ros.parameters.timing import TICK_NS
from ballbot_ros.robot.brick.sensors import (
    battery_mv,
    drawn_delay,
    gyro_reading,
    radians_to_degrees,
)
from ballbot_ros.robot.plant.integration import advance_linear, advance_nonlinear
from ballbot_ros.robot.plant.laws import (
    discharge,
    motor_current,
    motor_voltage,
    shaft_angle,
    state_after_fall,
    state_after_impact,
)
from ballbot_ros.robot.plant.model import mass_matrix
from ballbot_ros.robot.random_numbers import device_number, noise_key

COUNT = 5000
DT = 1e-3
NAN, INF = math.nan, math.inf


def bits(value):
    """Return the bits of a number, or of the numbers of a tuple; every NaN has the same."""
    if isinstance(value, tuple):
        return b''.join(bits(each) for each in value)
    if isinstance(value, float | np.floating):
        return struct.pack('<d', NAN if value != value else value)
    return struct.pack('<q', value)


def assert_same_bits(function, arguments):
    fast = compiled(function)
    for each in arguments:
        assert bits(fast(*each)) == bits(function(*each)), each


def draws(*makers):
    """Return random arguments; each maker takes a generator and returns one argument."""
    generator = random.Random(1)
    return [tuple(make(generator) for make in makers) for _ in range(COUNT)]


def uniform(low, high):
    return lambda generator: generator.uniform(low, high)


def integer(low, high):
    return lambda generator: generator.randint(low, high)


def choice(*values):
    return lambda generator: generator.choice(values)


def plane(generator):
    return tuple(generator.gauss(0.0, 10.0 ** generator.randint(-6, 1)) for _ in range(4))


CONSTANTS = [
    constants_of(ProgramConstants.of(values))
    for values in (values_of(CONTROLLER), *(random_values(seed) for seed in range(5)))
]


@pytest.fixture(scope='module')
def fast_control():
    return compiled(control)


def assert_the_law_is_compiled(fast_control, constants, volts):
    generator = random.Random(1)
    slow = fast = (Single(600), *5 * [Single(0)])
    # Small motions first, then ones that saturate the duty.
    for tick in range(COUNT // 2):
        spread = 1 if tick < 1000 else 400
        gyro = Single(600 + generator.randint(-spread, spread))
        revolution = Single(generator.randint(-spread, spread) * tick)
        stick = Single(generator.randint(-128, 127))
        voltage = Single(generator.uniform(0.5, 9.0) if volts == 'drawn' else volts)
        with np.errstate(all='ignore'):
            slow, *answer = control(constants, slow, gyro, revolution, stick, voltage)
        fast, *fast_answer = fast_control(constants, fast, gyro, revolution, stick, voltage)
        # A compiled function returns singles as Python floats of the same value.
        fast = tuple(map(Single, fast))
        assert bits((fast, *fast_answer)) == bits((slow, *answer)), (tick, constants)


@pytest.mark.parametrize('volts', ['drawn', 0.0, -0.5, INF, NAN])
def test_the_law_of_the_controller(fast_control, volts):
    for constants in CONSTANTS:
        assert_the_law_is_compiled(fast_control, constants, volts)


@pytest.mark.parametrize('value', [0.0, -0.0, 1e-45, 3e38, -3e38, INF, -INF, NAN])
def test_the_law_with_each_variable_at_its_edge(fast_control, value):
    for constants in CONSTANTS:
        for index in range(6):
            state = tuple(Single(value if each == index else 0) for each in range(6))
            for voltage in (Single(8), Single(0)):
                arguments = (constants, state, Single(600), Single(-3), Single(0), voltage)
                with np.errstate(all='ignore'):
                    expected = control(*arguments)
                assert bits(fast_control(*arguments)) == bits(expected)


def test_calibration_and_the_thresholds():
    single = [Single(value) for value in (0, -0.0, 0.01, 0.9, 4.9999995, 5, 596.5, INF, NAN)]
    with np.errstate(all='ignore'):
        assert_same_bits(
            calibrated_offset, draws(choice(*single), integer(0, 1023), choice(*single))
        )
    assert_same_bits(in_control, draws(*4 * [choice(*single)]))


@pytest.mark.parametrize('model', ['linear', 'nonlinear'])
@pytest.mark.parametrize('changes', [{}, {'ball_friction': 0.01, 'body_height': 0.25}])
def test_the_steps_of_the_plant(model, changes):
    p = physical(**changes)
    make_step, advance = {
        'linear': (linear_step, advance_linear),
        'nonlinear': (nonlinear_step, advance_nonlinear),
    }[model]
    step, fast_step = make_step(p, DT), make_step(p, DT, compiled(advance))
    generator = random.Random(1)
    state = fast_state = (0.0, 0.05, 0.0, 0.0)
    edges = [(0.0, -0.0, 0.0, -0.0), (0.0, 4e6, -1e9, 1e9), (1e300, 1e-300, 1e-310, 0.0)]
    edges += [(0.0, NAN, 0.0, 0.0), (0.0, INF, 0.0, 0.0), (INF, 0.1, -INF, 1.0)]
    for tick in range(COUNT):
        if tick % 1000 == 999:
            state = fast_state = edges[tick // 1000]
        inputs = generator.uniform(-9.0, 9.0), 0.0, 0.0
        if tick % 3 == 0:
            inputs = inputs[0], generator.gauss(0.0, 0.1), generator.gauss(0.0, 0.1)
        state = step(state, *inputs)
        fast_state = fast_step(fast_state, *inputs)
        assert bits(fast_state) == bits(state), tick
    for edge in edges:
        assert bits(fast_step(edge, 0.0, 0.0, 0.0)) == bits(step(edge, 0.0, 0.0, 0.0))


@pytest.mark.parametrize('linear', [True, False])
def test_walls(linear):
    matrix = mass_matrix(physical())
    assert_same_bits(state_after_impact, draws(plane, plane, choice(matrix), choice(linear)))


duties, volts = integer(-100, 100), uniform(0.0, 10.0)


@pytest.mark.parametrize(
    ('function', 'makers'),
    [
        (motor_voltage, [duties, volts, uniform(0, 20), choice(1.089e-3), choice(-0.625)]),
        (motor_voltage, [duties, choice(0.0), choice(0.0), choice(1.089e-3), choice(-0.625)]),
        (motor_current, [uniform(-9, 9), uniform(-50, 50), uniform(-50, 50), volts, uniform(1, 9)]),
        (discharge, [uniform(0, 1e4), uniform(-1, 5), *2 * [choice(0.1)], *3 * [uniform(0, 1)]]),
        (state_after_fall, [plane, choice(0.6, 1.5)]),
        (shaft_angle, [uniform(-1, 1), uniform(-1, 1), choice(0.0, 0.1)]),
        (shaft_angle, [choice(0.0, -0.0), choice(0.0, -0.0), choice(0.0)]),
        (radians_to_degrees, [uniform(-1e4, 1e4)]),
        (battery_mv, [uniform(-1.0, 20.0)]),
    ],
)  # fmt: skip
def test_motor_battery_pushes_and_readings(function, makers):
    assert_same_bits(function, draws(*makers))


def test_dead_time():
    steps, stamps = integer(0, 100), integer(250, 10**9)
    assert_same_bits(drawn_delay, draws(steps, steps, uniform(0, 1)))
    constants = choice(noise_key(3)), choice(device_number('gyro delay')), choice(TICK_NS)
    drawn = draws(steps, steps, *constants, stamps)
    assert_same_bits(sample_age, [(*each[:-1], each[-1] * TICK_NS) for each in drawn])


def test_the_gyros():
    def constants(generator):
        return (
            generator.uniform(590, 610), generator.choice([0.0, 360.0]),
            generator.choice([0.0, 0.7]), generator.choice([0.0, 5.0]),
            generator.randint(1, 10**13), generator.random(),
        )  # fmt: skip

    rates = choice(0.0, -0.0, 1e-9, -0.3, 6.2, 7.0, -1e300, INF, -INF)
    assert_same_bits(gyro_reading, draws(constants, rates, uniform(-5, 5), integer(0, 10**15)))


def test_the_sonar():
    def constants(generator):
        return SonarConstants(
            0.07, 0.0, 1, True, generator.choice([0.0, 3.0]), generator.choice([0.0, 0.15, 1.0]),
            generator.choice([0.0, 7.0]), generator.choice([160.0, 255.0]), 0, 0,
            noise_key(generator.randrange(2**32)),
        )  # fmt: skip

    distances = choice(0.0, 0.0649, 0.07, 0.785, 2.54999, 2.55, 3.0, INF)
    assert_same_bits(echo, draws(constants, distances, integer(0, 10**15)))
