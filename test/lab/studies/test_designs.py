"""Studies that vary what the gains of a controller are designed from."""

import numpy as np
import pytest
from laws import refusal
from simulated_runs import assert_same, compiled_simulator, spec_of
from study_reruns import rerun_of

from ballbot_ros.controllers.lqg import LQG
from ballbot_ros.engine.rows import RobotRows
from ballbot_ros.engine.scenario.metrics import METRICS
from ballbot_ros.engine.scenario.scenario import Measure
from ballbot_ros.errors import StudyError
from ballbot_ros.lab.studies.programs import programs_of
from ballbot_ros.lab.studies.reader import read_study
from ballbot_ros.lab.studies.runs import OrdinarySimulator, Samples
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.files import read_parameter_file
from ballbot_ros.run.execution import execute

MEASURES = [Measure(next(iter(METRICS)))]

LAW = """\
from dataclasses import dataclass, replace
from typing import NamedTuple

from ballbot_ros.controllers import LawController, quantity


@dataclass(frozen=True)
class Gains:
    noise: float = quantity(0.0, '1', (0.0, 1.0), 'share of the seed')


class Numbers(NamedTuple):
    value: float


class Own(LawController[Gains]):
    law = lambda p, state, readings: (state, (0, 0))
    initial_state = classmethod(lambda cls, constants: Numbers(0.0))

    @classmethod
    def constants(cls, parameters, model, settings):
        return Numbers({value})
"""


def constants_of(spec, values):
    """Return the constants of the runs with these values."""
    count = len(next(iter(values.values())))
    programs = programs_of(spec)
    rows = RobotRows(spec.parameters, programs.of_robots(values), count)
    made = programs.rows(rows, values, count, 0)
    constants = [row.tobytes() for each in made for row in each.constants]
    assert len(constants) == count
    return constants


def test_gains_are_those_of_a_run_with_these_values():
    spec = spec_of('hardware_standing', controller='lqg')
    values = {'controller.user.psi_scale': [0.7, 1.4], 'controller.model.body_mass': [0.6, 0.7]}
    samples = Samples(2, {name: np.array(each) for name, each in values.items()})
    results = compiled_simulator(spec, MEASURES).simulate(samples)
    assert len({each.tobytes() for each in results.duty_sha256}) == 2
    for run in range(2):
        own = [f'{name}={each[run]}' for name, each in values.items()]
        alone = OrdinarySimulator(spec_of('hardware_standing', *own, controller='lqg'), MEASURES)
        expected = alone.simulate(Samples(1, {}))
        np.testing.assert_array_equal(results.duty_sha256[run], expected.duty_sha256[0])


def test_runs_with_other_numbers_of_states_are_compiled_too(monkeypatch):
    spec = spec_of('hardware_standing', controller='lqg')
    # The filter keeps one voltage more for each tick.
    values = {'controller.user.actuator_delay': np.array([3.0, 3.0, 0.0, 4.0, 0.0])}
    samples = Samples(5, values)
    expected = OrdinarySimulator(spec, MEASURES).simulate(samples)
    assert len({each.tobytes() for each in expected.duty_sha256}) == 3
    simulator = compiled_simulator(spec, MEASURES)
    interpreted = []
    monkeypatch.setattr(
        simulator._ordinary,
        'simulate',
        lambda samples, advance: interpreted.append(samples.count) or expected,
    )
    assert_same(simulator.simulate(samples), expected)
    assert not interpreted

    monkeypatch.setattr('ballbot_ros.lab.studies.programs.MOST_CODES', 1)
    simulator._programs = programs_of(spec)
    assert simulator.simulate(samples) is expected
    assert interpreted == [5]


def test_equal_values_are_designed_once(monkeypatch):
    spec, designed = spec_of('stationary', controller='lqg'), []
    of_class = LQG.design

    def design(parameters, model):
        designed.append(parameters.psi_scale)
        return of_class(parameters, model)

    monkeypatch.setattr(LQG, 'design', design)
    values = {
        'controller.user.psi_scale': np.array([0.7, 0.9, 1.1, 1.3] * 50),
        'controller.time_auto': np.repeat([1000, 1200], 100),
        'plant_sim.seed': np.arange(200),
    }
    constants = constants_of(spec, values)
    assert designed == [0.7, 0.9, 1.1, 1.3]
    assert len(set(constants)) == 8
    for run in (0, 5, 110, 199):
        (alone,) = constants_of(spec, {name: each[[run]] for name, each in values.items()})
        assert constants[run] == alone, run


@pytest.mark.parametrize(
    ('value', 'kinds'),
    [
        ('settings.time_auto', 1),
        ('settings.seed', 6),
        ('parameters.noise and parameters.noise * settings.seed', 4),
        ('replace(settings, mode="remote").seed', 6),
        ('vars(settings)["seed"]', 6),
    ],
)
def test_constants_differ_if_the_settings_do_that_they_depend_on(tmp_path, value, kinds):
    path = tmp_path / 'own.py'
    path.write_text(LAW.format(value=f'float({value})'))
    values = {
        'plant_sim.seed': np.arange(1, 7),
        'controller.user.noise': np.array([0.0, 0.0, 0.0, 0.5, 0.5, 0.5]),
    }
    assert len(set(constants_of(spec_of('stationary', controller=f'{path}:Own'), values))) == kinds


def test_a_design_that_fails_names_its_run():
    spec = spec_of('stationary', controller='lqg')
    samples = Samples(2, {'controller.model.torque_constant': np.array([0.3, 0.0])}, first=40)
    for simulator in (compiled_simulator(spec, MEASURES), OrdinarySimulator(spec, MEASURES)):
        message = refusal(StudyError, simulator.simulate, samples)
        assert 'Failed to find a finite solution' in message
        assert message.endswith('(LQG.design) (run 41)')


def test_a_run_once_more_has_the_gains_of_its_values(tmp_path):
    path = tmp_path / 'case.yaml'
    path.write_text(
        'purpose: x\nscenario: stationary\ncontroller: lqg\nruns: 2\n'
        'parameters: {plant_sim: {duration: 2.0}}\n'
        'vary: {controller.user.psi_scale: {list: [0.7, 1.4]}}\n'
    )
    study = read_study(str(path))
    samples = Samples(2, {'controller.user.psi_scale': np.array([0.7, 1.4])})
    results = compiled_simulator(study.spec, MEASURES).simulate(samples)
    for run in range(2):
        spec = rerun_of(study, samples, run, tmp_path / str(run))
        assert execute(spec).duty_sha256 == results.duty_sha256[run].tobytes().hex()
        written = dict(spec.parameters.of(ControllerParameters).own)
        file = read_parameter_file(tmp_path / str(run) / 'again/parameters.yaml')
        assert tuple(file.undeclared['user.feedback']) == written['user.feedback']
