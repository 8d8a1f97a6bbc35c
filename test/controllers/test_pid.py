"""The PID controller that ships."""

import pytest
from shipped_controllers import duties, exchanged, run_shipped

PID = 'pid'


@pytest.mark.parametrize(
    'scenario', ['stationary', 'forward_backward', 'push', 'hardware_standing']
)
def test_it_passes_shipped_scenarios(scenario):
    result = run_shipped(PID, scenario)
    assert result.passed, result.reason


def test_it_needs_less_duty_than_the_document():
    document, pid = (run_shipped(each).metrics['duty_rms_percent'] for each in ('python', PID))
    assert pid < 0.8 * document


def test_its_planes_are_alike():
    assert exchanged(PID)


def test_the_same_run_has_the_same_duties():
    first, again = (duties(PID, profile='hardware', seed=3)[0] for _ in range(2))
    assert (first == again).all()
    assert first.any()


def test_it_drives_by_itself():
    result = run_shipped(PID, 'autonomous')
    assert result.passed, result.reason


def test_a_fallen_robot_stops_its_motors():
    duty, loop = duties(PID, 'plant_sim.start_pitch_x=0.2')
    assert loop.plant.fallen
    assert not duty[-50:].any()
    assert loop.program.operating_state == 'out_of_control'
