"""Parts of the robot with default parameters, except those that a test sets."""

import math
from functools import partial

import numpy as np

from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.plant import Plant
from ballbot_ros.engine.scenario.scenario import Segment, StickSignal
from ballbot_ros.parameters import PLANT, Dimensions, ParameterSet, ViewerParameters
from ballbot_ros.robot.brick.brick import DeviceInputs
from ballbot_ros.robot.brick.schedule import Schedule
from ballbot_ros.robot.plant.integration import (
    advance_linear,
    advance_nonlinear,
    discrete_matrices,
    equations_of,
)
from ballbot_ros.robot.plant.model import PhysicalParameters, mass_matrix

START_NS = 1_000_000_000
DIMENSIONS = Dimensions.from_parameters(ViewerParameters())
AT_REST = DeviceInputs(
    gyro=(600, 600), revolutions=(0, 0), sonar_cm=255, battery_mv=8003, sticks=(0, 0)
)


def tick(program, elapsed_ms, systick_ms, inputs):
    """Run the tasks of a program that are due `elapsed_ms` after the start."""
    return program.run(Schedule(program.tasks).due(elapsed_ms), systick_ms, inputs)


def sampled(device, parameters):
    """Return the function that measures a device's quantity of the sample at a tick."""
    age_of = device.age_of(parameters)
    if not device.longest_delay(parameters):
        return device.measured
    return lambda truth: device.measured_of(truth.steps, *age_of(truth.stamp_ns))


def values_of(node, **changes):
    parameters = ParameterSet()
    for name, value in changes.items():
        parameters.set(node, name, value)
    return parameters.of_node(node)


def physical(**changes):
    return PhysicalParameters.from_parameters(values_of(PLANT, **changes))


def mass_matrix_at(p, psi):
    """Return the mass matrix of (3.11)-(3.12) at a pitch, shape (2, 2)."""
    m = mass_matrix(p)
    m12 = p.body_mass * p.body_height * p.ball_radius * math.cos(psi) - p.drive_inertia
    return np.array([[m.m11, m12], [m12, m.m22]])


def linear_step(p, dt, advance=advance_linear):
    """Return the exact step of the linear model under inputs held for `dt` seconds."""
    return partial(advance, *discrete_matrices(p, dt))


def nonlinear_step(p, dt, advance=advance_nonlinear):
    """Return a classical fourth-order Runge-Kutta step of (3.11)-(3.12), of one plane."""
    constants = equations_of(p), p.alpha, dt

    def step(state, voltage, force_theta, force_psi):
        forces = force_theta, force_psi, 0.0, 0.0
        return advance(*constants, state, (0.0, 0.0, 0.0, 0.0), voltage, 0.0, *forces)[0]

    return step


def make_plant(**changes):
    return Plant(values_of(PLANT, **{'hold_time': 0.0, **changes}), START_NS)


def run_plant(plant, duties):
    """Return the truths at the start and after each duty pair."""
    truths = [plant.truth()]
    for duty in duties:
        plant.tick(*duty)
        truths.append(plant.truth())
    return truths


def step(time, value):
    """Return a stick signal that jumps to `value` at `time` and stays there."""
    return StickSignal([Segment('step', [(time, value), (math.inf, value)])])


def steps(*points):
    """Return a stick signal that jumps to a value at each (time, value) and keeps the last."""
    ends = [time for time, _ in points[1:]] + [math.inf]
    return StickSignal(
        [
            Segment('step', [(time, value), (end, value)])
            for (time, value), end in zip(points, ends, strict=True)
        ]
    )


def make_loop(settings, scenario=None):
    """Return the closed loop with `settings`, a dict of 'node.parameter': value."""
    parameters = ParameterSet()
    for key, value in settings.items():
        parameters.set(*key.split('.'), value)
    return ClosedLoop(parameters, scenario)


def run_loop(loop, seconds):
    """Return the ticks of the next `seconds` of sim time."""
    return [loop.tick() for _ in range(round(seconds * 250))]
