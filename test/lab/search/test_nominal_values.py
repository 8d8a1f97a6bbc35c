"""The value of what varies in the run that all are like."""

import numpy as np
import pytest
from tried_searches import SHORT_PUSH, STUDY, write

from ballbot_ros.engine.compiled_loop import events_of
from ballbot_ros.engine.scenario.scenario import PUSH_DIRECTIONS
from ballbot_ros.lab.studies.events import scenarios_of
from ballbot_ros.lab.studies.reader import read_study
from ballbot_ros.lab.studies.variables import nominal_value

VARY = {
    'push.1.direction': {'uniform': [-180.0, 360.0]},
    'push.1.force': {'uniform': [0.0, 9.0]},
    'stick.vertical.ahead.from': {'uniform': [0.1, 1.0]},
    'stick.vertical.ahead.to': {'uniform': [1.5, 2.0]},
    'stick.vertical.ahead.value': {'uniform': [-100.0, 100.0]},
    'fault.1.kind': {'list': ['gyro_x stuck', 'gyro_y stuck']},
    'fault.1.time': {'uniform': [0.1, 2.0]},
}
PARAMETERS = {
    'plant_sim.body_mass': {'uniform': [0.6, 0.8]},
    'controller.k_f.2': {'uniform': [-3.0, -1.0]},
}


@pytest.mark.parametrize('direction', [*PUSH_DIRECTIONS, 30.0, 270.0])
def test_the_nominal_values_are_the_scenario(tmp_path, direction):
    scenario = {
        **SHORT_PUSH,
        'pushes': [{**SHORT_PUSH['pushes'][0], 'direction': direction}],
        'sticks': {
            stick: [{'name': 'ahead', 'from': 0.5, 'to': 1.6, 'value': -40}]
            for stick in ('vertical', 'horizontal')
        },
        'faults': [{'component': 'gyro_x', 'type': 'stuck', 'time': 1.5}],
    }
    study = read_study(str(write(tmp_path, STUDY, scenario, vary={**VARY, **PARAMETERS})))
    nominal = {each.name: nominal_value(study.spec, each) for each in study.variables}
    assert nominal['plant_sim.body_mass'] == study.spec.plant.body_mass
    assert nominal['controller.k_f.2'] == pytest.approx(-1.56981, abs=1e-5)
    events = {name: np.array([nominal[name]]) for name in VARY}
    (same,) = scenarios_of(study.spec.scenario, events, np.array([2.4]))
    assert same.faults == study.spec.scenario.faults
    for one, other in zip(events_of([same]), events_of([study.spec.scenario]), strict=True):
        assert one.size
        np.testing.assert_allclose(one, other, atol=1e-12)
