"""The model of a segment, against the plant itself."""

import math
from dataclasses import replace

import numpy as np
import pytest

import ballbot_ros.analysis.identification.segments as segments_module
from ballbot_ros.analysis.identification.experiment import (
    ENCODER,
    GYRO,
    TRUE_PITCH,
    TRUE_POSITION,
    Experiment,
)
from ballbot_ros.analysis.identification.segment_model import SegmentModel
from ballbot_ros.analysis.identification.segments import cut
from ballbot_ros.engine.plant import Plant
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.parameters.timing import STEPS_PER_TICK, TICK_S
from ballbot_ros.robot.plant.ground_truth import state_before

START_NS = 1_000_000_000
TICKS = round(0.8 / TICK_S)
EARLIEST = 40
"""First tick at which a segment may start."""

OFFSETS = 603.0, 597.0
CHANNELS = GYRO, ENCODER, TRUE_PITCH, TRUE_POSITION
DRAINING = {'battery_model': 'draining', 'battery_resistance': 0.6}
HEAVY = {
    'body_mass': 0.8, 'body_height': 0.15, 'torque_constant': 0.33, 'wheel_radius': 0.02,
    'ball_radius': 0.027, 'motor_friction': 0.003, 'motor_resistance': 6.0, 'ball_friction': 0.001,
    'back_emf_constant': 0.44, 'motor_inertia': 2e-5, 'dead_zone': 3.5,
}  # fmt: skip

VARIANTS = {
    'ideal': {},
    'nonlinear': {'plant_model': 'nonlinear'},
    'gear play': {'backlash': 0.07},
    'dead zone': {'dead_zone': 4.0},
    'battery voltage': {'battery_voltage': 9.1},
    'sag': DRAINING,
    'dead time': {'actuator_delay': 3},
    'long dead time': {'actuator_delay': 9},
    'all': {
        'plant_model': 'nonlinear', 'backlash': 0.07, 'dead_zone': 4.0, 'actuator_delay': 6,
        **DRAINING,
    },
    'link': {'link': True},
    'link and all': {
        'plant_model': 'nonlinear', 'backlash': 0.07, 'dead_zone': 4.0, 'actuator_delay': 2,
        'link': True, **DRAINING,
    },
}  # fmt: skip


@pytest.fixture(autouse=True)
def _short_segments(monkeypatch):
    """Half a second: in a longer time, the robot would fall under random duties."""
    monkeypatch.setattr(segments_module, 'SEGMENT_TICKS', 125)


def random_duties(seed=5):
    """Return duties, shape (n, 2), that hold for some ticks and are 0 before the segment.

    A segment starts with a rough battery current. It is exact only if there is no duty.
    """
    random = np.random.default_rng(seed)
    duties = np.repeat(random.integers(-40, 41, (TICKS // 5, 2)), 5, axis=0)
    duties[:10] = (20, -20)
    duties[20 : EARLIEST + 5] = 0
    return duties


def parameters(**changes):
    # The charge drawn in half a second is left out of the model.
    return PlantParameters(hold_time=0.0, battery_capacity=math.inf, **changes)


def between_steps(steps, name, age):
    """Return what was measured `age` steps before the newest step, interpolated."""
    around = [
        getattr(state_before(steps, each), name) for each in (math.floor(age), math.ceil(age))
    ]
    return np.transpose(around) @ [1.0 - age % 1.0, age % 1.0]


def run(plant_parameters, duties, ages):
    """Return the state of a plant at each tick, and the experiment with its exact readings."""
    plant = Plant(plant_parameters, START_NS)
    plant.keep_steps(max(20, *map(math.ceil, ages.values())))
    states, readings = [], {channel: [] for channel in CHANNELS}
    delays_us = np.zeros(len(duties), np.int64)
    if plant_parameters.link:
        delays_us[:] = np.random.default_rng(1).choice([1235, 1236, 2235, 4000, 700], len(duties))
    for duty, delay_us in zip(duties.tolist(), delays_us.tolist(), strict=True):
        truth = plant.truth()
        rates, angles = (
            between_steps(truth.steps, name, ages[channel])
            for name, channel in (('psi_rate', GYRO), ('motor_angle', ENCODER))
        )
        readings[GYRO].append(np.degrees(rates) + OFFSETS)
        readings[ENCODER].append(np.degrees(angles))
        readings[TRUE_PITCH].append(np.degrees(truth.psi))
        readings[TRUE_POSITION].append(truth.position)
        states.append(plant.state)
        plant.tick(*duty, 1000 * delay_us)
    assert not plant.fallen
    lead = math.ceil((plant_parameters.actuator_delay + delays_us.max() / 1000) / 4) + 1
    usable = np.arange(len(duties)) >= EARLIEST - lead
    return states, Experiment(
        name='test',
        plant=plant_parameters,
        duty=duties.astype(float),
        readings={channel: np.array(values) for channel, values in readings.items()},
        battery=np.array([state.volts for state in states]),
        battery_count=0.0,
        usable=usable,
        ages=ages,
        delays_us=delays_us,
    )


def unknowns(state, plant_parameters):
    """Return the unknowns of a segment that starts with a state of the plant."""
    planes = [[*state.x, OFFSETS[0]], [*state.y, OFFSETS[1]]]
    return np.array([*planes[0], *planes[1], plant_parameters.battery_voltage])


def assert_equal_to_plants(variants, ages):
    """Check predictions for several robots under the same duties, each against its own plant."""
    runs = [run(each, random_duties(), ages) for each in variants]
    segments = cut(runs[0][1])
    start, end = segments.starts[0], segments.starts[0] + segments.length
    assert EARLIEST <= start <= EARLIEST + 5
    own = [
        [unknowns(states[start], each)] for each, (states, _) in zip(variants, runs, strict=True)
    ]
    predicted = SegmentModel(segments.without(np.arange(segments.count) > 0)).predict(
        variants, np.array(own)
    )
    for number, (_, experiment) in enumerate(runs):
        for channel in CHANNELS:
            first = math.ceil(ages.get(channel, 0) / STEPS_PER_TICK)
            np.testing.assert_allclose(
                predicted.readings[channel][number, 0, first:],
                experiment.readings[channel][start + first : end],
                rtol=0.0, atol=1e-9, err_msg=f'{channel.name} of robot {number}',
            )  # fmt: skip
        np.testing.assert_allclose(
            predicted.battery[number, 0], experiment.battery[start:end], rtol=0.0, atol=1e-9
        )


@pytest.mark.parametrize('changes', VARIANTS.values(), ids=VARIANTS)
def test_a_segment_moves_as_the_plant_does(changes):
    assert_equal_to_plants([parameters(**changes)], {GYRO: 0, ENCODER: 0})


@pytest.mark.parametrize('ages', [(1, 3), (4, 2), (7, 0), (3, 9), (2.3, 1.75)])
def test_delayed_readings_show_the_plant_at_their_age(ages):
    assert_equal_to_plants(
        [parameters(**VARIANTS['nonlinear'])], dict(zip((GYRO, ENCODER), ages, strict=True))
    )


@pytest.mark.parametrize('changes', VARIANTS.values(), ids=VARIANTS)
def test_each_of_several_robots_moves_as_its_own_plant(changes):
    first = parameters(**changes)
    assert_equal_to_plants([first, replace(first, **HEAVY)], {GYRO: 2, ENCODER: 1})


@pytest.mark.parametrize('changes', VARIANTS.values(), ids=VARIANTS)
def test_the_first_guess_is_close_to_the_plant(changes):
    states, experiment = run(parameters(**changes), random_duties(), {GYRO: 0, ENCODER: 0})
    segments = cut(experiment)
    model = SegmentModel(segments)
    true = unknowns(states[segments.starts[0]], experiment.plant)
    assert (np.abs(model.first_guess()[0] - true) < model.deviations).all()
