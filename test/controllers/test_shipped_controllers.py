"""What holds for each controller that ships."""

import pytest
from shipped_controllers import duties, exchanged, run_shipped

SCENARIOS = {
    'pid': ('stationary', 'forward_backward', 'push', 'hardware_standing', 'autonomous'),
    'drift_filter': ('stationary', 'forward_backward', 'push', 'hardware_standing', 'autonomous'),
    'lqg': (
        'push',
        'remote_wall',
        'hardware_standing',
        'hardware_forward_backward',
        'autonomous',
    ),
    'mpc': ('stationary', 'push', 'hardware_standing', 'autonomous'),
}


@pytest.fixture(params=SCENARIOS)
def controller(request):
    if request.param == 'mpc':
        pytest.importorskip('osqp')
    return request.param


def test_it_passes_shipped_scenarios(controller):
    for scenario in SCENARIOS[controller]:
        result = run_shipped(controller, scenario)
        assert result.passed, (scenario, result.reason)


def test_its_planes_are_alike(controller):
    assert exchanged(controller)


def test_the_same_run_has_the_same_duties(controller):
    first, again = (duties(controller, profile='hardware', seed=3)[0] for _ in range(2))
    assert (first == again).all()
    assert first.any()


def test_a_fallen_robot_stops_its_motors(controller):
    duty, loop = duties(controller, 'plant_sim.start_pitch_x=0.2')
    assert loop.plant.fallen
    assert not duty[-50:].any()
    assert loop.program.operating_state == 'out_of_control'


def test_the_pid_needs_less_duty_than_the_document():
    document, pid = (run_shipped(each).metrics['duty_rms_percent'] for each in ('python', 'pid'))
    assert pid < 0.8 * document
