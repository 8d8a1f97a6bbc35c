"""Dead time in the closed loop: whole ticks shift duties and samples, and it is reproducible."""

from collections import deque
from dataclasses import replace

import pytest
from parts import make_loop, run_loop, steps
from pushes import pushes

from ballbot_ros.controllers.codegen.implementation import implementation_for
from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.devices import ENCODER_DEVICE, GYRO_DEVICE, SONAR_DEVICE
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.parameters import PLANT, ControllerParameters, ParameterSet
from ballbot_ros.robot.plant.ground_truth import STEP_VALUES, state_before

ROBOT = {'plant_sim.start_pitch_x': 0.03, 'plant_sim.hold_time': 0.2, 'controller.time_start': 200}
SCENARIO = Scenario(
    vertical=steps((0.0, 0), (0.3, -60), (0.5, 100)), pushes=pushes(0.35, 0.05, 0.5, -0.3)
)
PLANTS = {
    'linear': {},
    'nonlinear': {'plant_sim.plant_model': 'nonlinear', 'plant_sim.backlash': 0.02},
    'draining': {'plant_sim.battery_model': 'draining', 'plant_sim.battery_capacity': 5.0},
    'walls': {
        'plant_sim.map': 'track',
        'plant_sim.start_position_x': 0.82,
        'plant_sim.start_pitch_x': 0.08,
        'plant_sim.on_wall_hit': 'report',
    },
    'fall': {'plant_sim.start_pitch_y': 0.5},
}
EVERYTHING = {
    'plant_sim.actuator_delay': 2,
    'plant_sim.actuator_delay_jitter': 7,
    'gyro_driver.delay': 1,
    'gyro_driver.delay_jitter': 6,
    'encoder_driver.delay': 3,
    'encoder_driver.delay_jitter': 2,
    'sonar_driver.delay': 30,
    'sonar_driver.delay_jitter': 45,
    'gyro_driver.noise': 0.7,
}


class ShiftedDuties:
    """A program whose duties come some ticks late."""

    def __init__(self, program, ticks):
        self.program, self.late = program, deque([(0, 0)] * ticks)
        self.tasks = program.tasks

    def run(self, tasks, systick_ms, inputs):
        outputs = self.program.run(tasks, systick_ms, inputs)
        self.late.append(outputs.duty)
        return replace(outputs, duty=self.late.popleft())


class ShiftedSamples:
    """A program that gets the samples of gyro and encoder some ticks late."""

    def __init__(self, program, ticks):
        self.program, self.late = program, deque([((600, 600), (0, 0))] * ticks)
        self.tasks = program.tasks

    def run(self, tasks, systick_ms, inputs):
        self.late.append((inputs.gyro, inputs.revolutions))
        gyro, revolutions = self.late.popleft()
        inputs = inputs._replace(gyro=gyro, revolutions=revolutions)
        return self.program.run(tasks, systick_ms, inputs)


def shifted_loop(settings, shifted, ticks):
    parameters = ParameterSet()
    for key, value in settings.items():
        parameters.set(*key.split('.'), value)
    program = implementation_for(parameters.of(ControllerParameters)).make()
    return ClosedLoop(parameters, SCENARIO, program=shifted(program, ticks))


def motion(loop, seconds=1.6):
    """Return the true states of a loop, without the steps that it keeps."""
    return [tick.truth._replace(steps=()) for tick in run_loop(loop, seconds)]


@pytest.mark.parametrize('plant', PLANTS)
@pytest.mark.parametrize('ticks', [1, 2, 4])
def test_a_dead_time_of_whole_ticks_shifts_the_duties(plant, ticks):
    settings = ROBOT | PLANTS[plant]
    delayed = make_loop({**settings, 'plant_sim.actuator_delay': 4 * ticks}, SCENARIO)
    found = motion(delayed)
    assert delayed.plant.fallen == (plant == 'fall')
    assert (delayed.plant.newest_hit is not None) == (plant == 'walls')
    assert found == motion(shifted_loop(settings, ShiftedDuties, ticks))
    assert found != motion(make_loop(settings, SCENARIO))


@pytest.mark.parametrize('ticks', [1, 3])
def test_a_dead_time_of_whole_ticks_shifts_the_samples(ticks):
    delays = {f'{driver}_driver.delay': 4 * ticks for driver in ('gyro', 'encoder')}
    found = motion(make_loop({**ROBOT, **delays}, SCENARIO))
    assert found == motion(shifted_loop(ROBOT, ShiftedSamples, ticks))
    assert found != motion(make_loop(ROBOT, SCENARIO))


def test_a_sample_is_the_reading_of_the_step_that_is_as_old():
    settings = {
        **ROBOT,
        'plant_sim.map': 'track',
        'encoder_driver.delay': 3,
        'gyro_driver.delay': 6,
        'sonar_driver.delay': 25,
    }
    parameters = ParameterSet()
    parameters.set(PLANT, 'map', 'track')
    ages = {ENCODER_DEVICE: 3, GYRO_DEVICE: 6, SONAR_DEVICE: 25}
    readers = {each: each.make(parameters.of(each.parameters)) for each in ages}
    for truth, _, inputs, _ in run_loop(make_loop(settings, SCENARIO), 1.2):
        assert len(truth.steps) == 26 * STEP_VALUES
        for device, age in ages.items():
            if truth.stamp_ns % device.period_ns == 0:
                measured = device.measured(state_before(truth.steps, age))
                expected = readers[device](measured, truth.stamp_ns)
                assert getattr(inputs, device.field) == expected


@pytest.mark.parametrize('model', ['linear', 'nonlinear'])
def test_jitter_is_reproduced_by_its_seed_and_changes_with_it(model):
    settings = ROBOT | EVERYTHING | {'plant_sim.plant_model': model, 'gyro_driver.noise': 0.0}
    found = motion(make_loop(settings, SCENARIO))
    assert found == motion(make_loop(settings, SCENARIO))
    assert found != motion(make_loop({**settings, 'gyro_driver.seed': 2}, SCENARIO))


def test_a_loop_without_dead_time_keeps_no_steps():
    assert all(tick.truth.steps == () for tick in run_loop(make_loop(ROBOT), 0.1))
