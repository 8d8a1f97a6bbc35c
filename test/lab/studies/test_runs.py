"""Many runs by the compiled and by the ordinary loop."""

import numpy as np
import pytest
from laws import refusal
from simulated_runs import EVERYTHING, assert_same, compiled_simulator, spec_of

from ballbot_ros.engine.scenario.scenario import Measure
from ballbot_ros.errors import StudyError
from ballbot_ros.lab.studies.programs import with_values
from ballbot_ros.lab.studies.runs import (
    CompiledSimulator,
    OrdinarySimulator,
    Samples,
    simulator_for,
)
from ballbot_ros.parameters import ControllerParameters, ParameterError
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.spec import RunOptions, RunSpec

VARIED = {
    'stationary': {
        'plant_sim.body_mass': np.linspace(0.5, 0.9, 6),
        'plant_sim.plant_model': np.array(['linear', 'nonlinear'] * 3),
        'plant_sim.start_pitch_rate_x': np.linspace(-3.0, 3.0, 6),
        'controller.k_f': np.linspace(0.9, 1.1, 6)[:, np.newaxis]
        * np.array([-0.01504899, -1.56981134, -0.02700482, -0.23249821]),
        'plant_sim.ball_radius': np.linspace(0.025, 0.027, 6),
    },
    'hardware_autonomous': {
        'plant_sim.seed': np.arange(6) * 2**60,
        'gyro_driver.delay': np.arange(6),
        'sonar_driver.distance_model': np.array(['exact', 'stepped'] * 3),
        'controller.time_auto': np.array([1000, 1200] * 3),
        'plant_sim.start_position_x': np.linspace(-0.72, -0.6, 6),
        'plant_sim.body_width': np.array([0.1, 0.12] * 3),
        'plant_sim.duration': np.array([3.0, 2.0, 1.0, 0.5, 2.5, 3.0]),
    },
    'hardware_standing': {
        'plant_sim.kernel': np.array([True, False, True] * 2),
        'plant_sim.link': np.array([True, False, False] * 2),
        'controller.control_instructions': np.linspace(5e3, 70e3, 6).astype(int),
        'controller.time_variation': np.linspace(0.0, 0.4, 6),
        'controller.bus_cycles': np.linspace(0.0, 60.0, 6),
    },
    'forward_backward': {
        'controller.k_f.2': np.linspace(-1.7, -1.4, 6),
        'controller.k_f.4': np.array([-0.23, -0.25] * 3),
    },
}  # fmt: skip


@pytest.mark.parametrize('name', VARIED)
def test_both_simulators_give_the_same_results(name):
    spec, samples = spec_of(name), Samples(6, VARIED[name])
    compiled = compiled_simulator(spec, EVERYTHING).simulate(samples)
    assert_same(compiled, OrdinarySimulator(spec, EVERYTHING).simulate(samples))
    assert len({each.tobytes() for each in compiled.duty_sha256}) > 1
    assert np.isfinite(compiled.measured[0, 1:4]).all()


VARIED_LAWS = {
    'pid': {
        'controller.user.pitch_p': np.linspace(1.4, 1.8, 4),
        'controller.model.ball_radius': np.linspace(0.025, 0.027, 4),
        'plant_sim.seed': np.arange(4),
    },
    'drift_filter': {
        'controller.user.drift_time': np.linspace(5.0, 9.0, 4),
        'controller.k_f.2': np.linspace(-1.7, -1.4, 4),
        'controller.time_auto': np.array([1000, 1200] * 2),
    },
    'lqg': {
        'controller.user.psi_scale': np.linspace(0.8, 1.2, 4),
        'controller.user.gyro_error': np.array([0.5, 0.7] * 2),
        'controller.model.body_mass': np.linspace(0.6, 0.8, 4),
        'plant_sim.body_mass': np.linspace(0.6, 0.8, 4),
    },
    'commissioning': {
        'controller.user.pause_time': np.array([0.1, 0.2] * 2),
        'controller.user.rest_time': np.linspace(0.1, 0.4, 4),
        'controller.user.port_duty': np.array([20, 30] * 2),
    },
}


@pytest.mark.parametrize('controller', VARIED_LAWS)
def test_laws_give_the_same_results_compiled(controller):
    spec = spec_of('hardware_autonomous', controller=controller)
    samples, simulator = Samples(4, VARIED_LAWS[controller]), compiled_simulator(spec, EVERYTHING)
    simulator._ordinary = None  # no run may need it
    compiled = simulator.simulate(samples)
    assert_same(compiled, OrdinarySimulator(spec, EVERYTHING).simulate(samples))
    assert len({each.tobytes() for each in compiled.duty_sha256}) == 4


def test_the_clearance_is_that_of_each_body():
    sizes = np.array([0.1, 0.1, 0.135, 0.17])
    samples = Samples(4, {'plant_sim.body_width': sizes, 'plant_sim.body_depth': sizes})
    options = RunOptions(processes=Processes.NONE, assignments=('plant_sim.duration=8',))
    spec, measures = RunSpec.of_scenario('autonomous', options), [Measure('wall_clearance_m')]
    compiled = compiled_simulator(spec, measures).simulate(samples)
    assert_same(compiled, OrdinarySimulator(spec, measures).simulate(samples))
    assert len(set(compiled.measured[:, 0].tolist())) == 3


def test_each_run_can_have_pushes_and_sticks_of_its_own():
    events = {
        'push.1.force': np.array([0.5, 1.0, 1.5, 2.0]),
        'push.1.time': np.array([1.1, 1.2, 1.3, 1.4]),
    }
    spec, samples = spec_of('push'), Samples(4, {}, events)
    compiled = compiled_simulator(spec, EVERYTHING).simulate(samples)
    assert_same(compiled, OrdinarySimulator(spec, EVERYTHING).simulate(samples))
    assert len({each.tobytes() for each in compiled.duty_sha256}) == 4


def test_a_part_has_the_results_of_the_whole():
    simulator = compiled_simulator(spec_of('hardware_standing'), EVERYTHING)
    samples = Samples(50, {'plant_sim.seed': np.arange(50)})
    whole = simulator.simulate(samples)
    for first, last in ((0, 1), (7, 31), (49, 50)):
        assert_same(simulator.simulate(samples.part(first, last)), whole.part(slice(first, last)))


def test_a_wall_hit_ends_a_run_as_failed():
    spec = spec_of('autonomous', 'controller.time_auto=1000', 'controller.dst_thr=-1',
                   'plant_sim.duration=10')  # fmt: skip
    compiled = compiled_simulator(spec, EVERYTHING).simulate(Samples(1, {}))
    assert compiled.failed.tolist() == [True]
    assert 0 < compiled.ticks[0] < 2500
    assert_same(compiled, OrdinarySimulator(spec, EVERYTHING).simulate(Samples(1, {})))


def test_only_laws_are_compiled():
    for controller in (None, 'pid'):
        spec = spec_of('stationary', controller=controller)
        assert isinstance(simulator_for(spec, []), CompiledSimulator)
    pytest.importorskip('osqp')
    other = simulator_for(spec_of('stationary', controller='mpc'), [Measure('peak_pitch_deg')])
    assert isinstance(other, OrdinarySimulator)
    samples = Samples(2, {'controller.user.pitch_limit': np.array([0.5, 3.0])})
    assert len({each.tobytes() for each in other.simulate(samples).duty_sha256}) == 2


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'plant_sim.mass': [1.0]}, "plant_sim has no parameter 'mass'"),
        ({'controller.user.gain': [1.0]}, "controller has no parameter 'user.gain'"),
        ({'viewer.port': [1]}, 'viewer.port: not a parameter of one of plant_sim, gyro_driver'),
        ({'body_mass': [1]}, 'body_mass: not a parameter of one of plant_sim, gyro_driver'),
        ({'plant_sim.map': ['track']}, 'plant_sim.map: must be the same for all runs of a study'),
        (
            {'plant_sim.body_mass': [0.7, -1.0]},
            'plant_sim.body_mass: -1.0 is not within 1e-06 … 100 kg (run 1)',
        ),
        ({'plant_sim.body_mass': [0.7, np.nan]}, 'plant_sim.body_mass: nan is not within'),
        ({'gyro_driver.delay': [1.0, 2.5]}, 'gyro_driver.delay: 2.5 is not a whole number (run 1)'),
        ({'plant_sim.plant_model': ['linear', 'flat']}, "'flat' is not one of linear, nonlinear"),
        ({'controller.ts2_period': [20, 30]}, 'controller.ts2_period: 30 is not one of 4, 20, 100'),
        ({'controller.k_f.2': [-1.5, 1e10]}, 'controller.k_f.2: 10000000000.0 is not within'),
        ({'controller.k_f.5': [1.0]}, "controller.k_f has no element '5': its elements are 1 … 4"),
        ({'controller.k_f': [[1.0, 2.0]]}, 'is not a list of 4 numbers (run 0)'),
    ],
)  # fmt: skip
def test_values_that_are_refused(values, message):
    simulator = compiled_simulator(spec_of('stationary'), [])
    samples = Samples(2, {name: np.array(column) for name, column in values.items()})
    assert message in refusal(ParameterError, simulator.simulate, samples)


@pytest.mark.parametrize('place', [{'start_position_x': 0.9}, {'body_depth': 1.0}])
def test_a_start_in_a_wall_is_refused(place):
    spec = spec_of('autonomous')
    values = {f'plant_sim.{name}': np.array([value]) for name, value in place.items()}
    with pytest.raises(StudyError, match=r'puts the body in a wall: .* \(run 0\)'):
        compiled_simulator(spec, []).simulate(Samples(1, values))


def test_values_change_no_parameters_but_their_own():
    spec = spec_of('stationary')
    changed = with_values(spec.parameters, {'plant_sim.body_mass': np.float64(0.5)})
    assert {name for _, name, _ in set(changed) - set(spec.parameters)} == {'body_mass'}


def test_an_element_leaves_the_others_unchanged():
    parameters = spec_of('stationary').parameters
    before = parameters.of(ControllerParameters).k_f
    values = {'controller.k_f.2': np.float64(-1.0), 'controller.k_f.4': np.float64(-2.0)}
    changed = with_values(parameters, values).of(ControllerParameters).k_f
    assert changed == (before[0], -1.0, before[2], -2.0)
