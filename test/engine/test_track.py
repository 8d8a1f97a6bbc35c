"""Autonomous drive on the map `track`, as section 7.5 describes it."""

import numpy as np
import pytest
from parts import make_loop, run_loop

from ballbot_ros.robot.world.clearance import clearance

STARTS = [(-0.7, 0.55), (-0.75, 0.5), (-0.6, 0.6)]
DURATION_S = 20.0


def drive(start, **settings):
    """Return the loop, its ticks up to a wall hit, and the words of operating_state."""
    loop = make_loop(
        {
            'plant_sim.map': 'track',
            'plant_sim.start_position_x': start[0],
            'plant_sim.start_position_y': -start[1],
            'controller.mode': 'autonomous',
            **{key.replace('__', '.'): value for key, value in settings.items()},
        }
    )
    ticks, states = [], ['calibration']
    while len(ticks) < DURATION_S * 250 and not loop.plant.stopped:
        ticks += run_loop(loop, 0.004)
        if loop.program.operating_state != states[-1]:
            states.append(loop.program.operating_state)
    return loop, ticks, states


@pytest.mark.parametrize('start', STARTS)
def test_with_a_cone_and_a_far_threshold_it_drives_around_the_inner_wall(start):
    loop, ticks, states = drive(start, sonar_driver__cone_angle=0.52, controller__dst_thr=50)
    assert not loop.plant.stopped
    assert states == ['calibration', 'balance', 'forward', 'rightward', 'forward', 'rightward']
    positions = np.array([tick.truth.position for tick in ticks])
    assert clearance(loop.world.walls, positions).min() > 0.04
    # The robot has passed the inner wall, and has room in front of it and on its right.
    assert positions[-1, 0] > 0.3
    assert clearance(loop.world.walls, positions[-1:])[0] > 0.1


@pytest.mark.parametrize('start', STARTS)
def test_with_a_single_ray_it_hits_the_end_of_the_inner_wall(start):
    """When the ray has passed the wall's end, half of the body has not (docs/deviations.md)."""
    loop, _, states = drive(start)
    assert states[-2:] == ['rightward', 'forward']
    assert loop.plant.newest_hit.parts == ('front left',)
