"""The closed loop: balance, drive, and stop when out of control."""

import math

import numpy as np
import pytest
from parts import make_loop, run_loop, step, steps
from pushes import pushes

from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.scenario.reader import load_profile
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.engine.trajectory import TrajectoryLog
from ballbot_ros.parameters import PLANT

MODELS = ['linear', 'nonlinear']
PLANES = pytest.mark.parametrize('plane', [0, 1], ids='xy')
NOISY = {'gyro_driver.noise': 0.7}
LIMIT = math.pi / 3


def leaning(degrees, plane=0, **settings):
    """Return the loop of a robot that is released at a pitch, and its ticks of five seconds."""
    start = {f'plant_sim.start_pitch_{"xy"[plane]}': math.radians(degrees)}
    loop = make_loop({**start, **settings})
    return loop, run_loop(loop, 5.0)


def pitches(ticks):
    return np.degrees([tick.truth.psi for tick in ticks])


def duty_hash(loop, seconds=3.0):
    log = TrajectoryLog()
    for tick in run_loop(loop, seconds):
        log.add(tick.truth, *tick.outputs.duty)
    return log.duty_sha256


@pytest.mark.parametrize('model', MODELS)
@pytest.mark.parametrize('degrees', [4.0, -4.0, 5.0, 6.0, 7.0])
def test_it_recovers_from(degrees, model):
    loop, ticks = leaning(degrees, **{'plant_sim.plant_model': model})
    assert not loop.plant.fallen
    assert np.abs(pitches(ticks[-250:])).max() < 0.6
    assert loop.program.operating_state == 'remote'


@PLANES
def test_it_recovers_in_either_plane_alone(plane):
    _, ticks = leaning(6.0, plane)
    assert np.abs(pitches(ticks[-250:])).max() < 0.6
    assert (pitches(ticks)[:, 1 - plane] == 0.0).all()


@pytest.mark.parametrize('model', MODELS)
@PLANES
def test_it_does_not_recover_from_eight_degrees_and_stops_within_a_second_of_the_fall(plane, model):
    loop, ticks = leaning(8.0, plane, **{'plant_sim.plant_model': model})
    assert loop.plant.fallen
    assert max(abs(duty) for tick in ticks for duty in tick.outputs.duty) == 100
    assert_stops_after_the_fall(loop, ticks)


@pytest.mark.parametrize('model', MODELS)
@pytest.mark.parametrize('force', [(3.0, 0.0), (0.0, -3.0), (-2.0, 2.5)])
def test_it_stops_within_a_second_of_being_pushed_over(force, model):
    scenario = Scenario(pushes=pushes(2.0, 0.1, *force))
    loop = make_loop({'plant_sim.plant_model': model, **NOISY}, scenario)
    assert_stops_after_the_fall(loop, run_loop(loop, 5.0))


def assert_stops_after_the_fall(loop, ticks):
    fallen = [max(map(abs, tick.truth.psi)) >= LIMIT for tick in ticks].index(True)
    assert all(tick.outputs.duty == (0, 0) for tick in ticks[fallen + 250 :])
    assert len(ticks) > fallen + 500
    assert loop.program.operating_state == 'out_of_control'


@pytest.mark.parametrize('settings', [{}, NOISY, {**NOISY, 'plant_sim.plant_model': 'nonlinear'}])
def test_standing_for_a_minute_never_trips(settings):
    loop = make_loop({'plant_sim.start_pitch_x': math.radians(4.0), **settings})
    states = {(loop.tick(), loop.program.operating_state)[1] for _ in range(250 * 60)}
    assert states == {'calibration', 'remote'}
    assert np.hypot(*loop.plant.truth().position) < 0.05


def test_a_robot_with_all_the_faults_of_the_hardware_recovers_and_stands():
    parameters = load_profile('hardware')
    parameters.set(PLANT, 'start_pitch_x', math.radians(4.0))
    loop = ClosedLoop(parameters)
    states = {(loop.tick(), loop.program.operating_state)[1] for _ in range(250 * 60)}
    assert states == {'calibration', 'remote'}
    assert np.hypot(*loop.plant.truth().position) < 0.2


@pytest.mark.parametrize('model', MODELS)
@pytest.mark.parametrize(
    ('sticks', 'direction'),
    [
        ({'vertical': -100}, (1, 0)),
        ({'vertical': 100}, (-1, 0)),
        ({'horizontal': 100}, (0, 1)),
        ({'horizontal': -100}, (0, -1)),
    ],
    ids=['up', 'down', 'right', 'left'],
)
def test_a_full_stick_drives_in_its_direction_at_17_cm_per_second(sticks, direction, model):
    signals = {name: step(2.0, value) for name, value in sticks.items()}
    loop = make_loop({'plant_sim.plant_model': model}, Scenario(**signals))
    before, after = run_loop(loop, 7.0)[-1].truth, run_loop(loop, 3.0)[-1].truth
    speed = np.subtract(after.position, before.position) / 3.0
    np.testing.assert_allclose(speed, 0.17 * np.array(direction), atol=0.02)
    assert loop.program.operating_state == 'remote'


@pytest.mark.parametrize('model', MODELS)
@pytest.mark.parametrize('volts', [8.0, 7.0])
def test_full_stick_reversals_in_any_order_do_not_trip(volts, model):
    times = np.cumsum([2.0, 1.0, 0.6, 2.0, 0.4, 1.5, 3.0, 0.8]).tolist()
    points = list(zip(times, [-100, 100, -100, 100, 0, 100, -100, 0], strict=True))
    scenario = Scenario(
        vertical=steps(*points), horizontal=steps(*[(t + 0.3, -v) for t, v in points])
    )
    settings = {'plant_sim.battery_voltage': volts, 'plant_sim.plant_model': model, **NOISY}
    loop = make_loop(settings, scenario)
    ticks = run_loop(loop, 14.0)
    assert not loop.plant.fallen
    assert loop.program.operating_state == 'remote'
    assert np.abs(pitches(ticks)).max() < 15.0


def test_the_robot_answers_a_forward_lean_by_driving_forward():
    _, ticks = leaning(4.0)
    first = next(tick for tick in ticks if tick.outputs.duty != (0, 0))
    assert first.outputs.duty[0] > 0
    assert max(tick.truth.position[0] for tick in ticks) > 0.02


def test_with_noise_another_seed_gives_other_duties():
    hashes = {duty_hash(make_loop({**NOISY, 'gyro_driver.seed': seed})) for seed in range(4)}
    assert len(hashes) == 4
