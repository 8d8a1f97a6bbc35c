"""The studies of docs/examples/defects."""

from pathlib import Path

import numpy as np
import pytest

from ballbot_ros.lab.studies.programs import why_not_compiled
from ballbot_ros.lab.studies.reader import read_study
from ballbot_ros.lab.studies.runs import OrdinarySimulator

DEFECTS = Path(__file__).parents[3] / 'docs' / 'examples' / 'defects'

COUNTEREXAMPLES = {
    'sign_error': {
        'plant_sim.body_mass': 0.69,
        'plant_sim.body_height': 0.165,
        'plant_sim.battery_voltage': 8.0,
        'push.1.force': 26.9,
        'push.2.force': 36.8,
        'push.2.time': 2.071,
    },
    'unlimited_integrator': {
        'plant_sim.hold_time': 5.55,
        'stick.vertical.forward.value': 19.0,
        'stick.vertical.forward.from': 1.05,
        'stick.vertical.forward.to': 8.6,
        'plant_sim.body_mass': 0.7,
        'plant_sim.battery_voltage': 7.2,
    },
    'stale_sonar': {
        'plant_sim.start_position_x': 0.31,
        'stick.vertical.forward.value': -100.0,
        'controller.k_thetadot': 397.0,
        'fault.1.time': 6.36,
        'fault.1.duration': 0.3,
    },
    'full_stick': {
        'controller.k_thetadot': 340.0,
        'stick.vertical.forward.value': -98.0,
        'stick.vertical.forward.from': 2.0,
        'plant_sim.body_mass': 0.65,
        'plant_sim.battery_voltage': 8.0,
    },
}


def robustness(study, values):
    columns = {name: np.array([values.get(name, 1)]) for name in study.columns}
    results = OrdinarySimulator(study.spec, study.properties).simulate(study.samples(columns))
    return results.measured.min()


def test_each_defect_has_a_counterexample():
    assert COUNTEREXAMPLES.keys() == {
        each.stem for each in DEFECTS.glob('*.yaml') if 'vary:' in each.read_text(encoding='utf-8')
    }


@pytest.mark.parametrize('name', COUNTEREXAMPLES)
def test_a_defect_violates_what_the_same_controller_without_it_satisfies(name):
    values = COUNTEREXAMPLES[name]
    study = read_study(str(DEFECTS / f'{name}.yaml'))
    assert not why_not_compiled(study.spec)
    for each in study.variables:
        low, high = each.distribution.ends
        assert low <= values[each.name] <= high
    assert robustness(study, values) < 0.0
    without = read_study(str(DEFECTS / f'{name}.yaml'), controller='pid')
    assert robustness(without, values) > 0.0
