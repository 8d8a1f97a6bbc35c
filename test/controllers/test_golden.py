"""The control program against the outputs of the document's generated C for the same inputs."""

import json
from pathlib import Path

import numpy as np
import parts
import pytest

from ballbot_ros.controllers.document.program import ControlProgram
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.robot.brick.brick import DeviceInputs

GOLDEN = sorted((Path(__file__).parent / 'golden').glob('*.npz'))

RENAMED = {'Rw': 'wheel_radius', 'Rs': 'ball_radius'}
NOT_OURS = {'ts1', 'start_systick', 'autonomous_free_axis'}


def bits(*values):
    return np.array([np.float32(value) for value in values]).view(np.uint32).tolist()


@pytest.mark.parametrize('path', GOLDEN, ids=lambda path: path.stem)
@pytest.mark.filterwarnings('ignore:overflow encountered', 'ignore:divide by zero')
def test_every_tick_equals_the_generated_c(path):
    with np.load(path, allow_pickle=False) as file:
        data = {name: file[name].tolist() for name in file.files}
    given = {
        RENAMED.get(name, name): value
        for name, value in json.loads(str(data['parameters'])).items()
        if name not in NOT_OURS
    }
    program = ControlProgram(ControllerParameters(**given))
    for n in range(len(data['in_systick_ms'])):
        # The brick answers a request with the sample of the previous request, the golden data with
        # that of the same tick.
        program.state = program.state._replace(sonar_reply=data['in_sonar_cm'][n])
        outputs = parts.tick(
            program,
            4 * n,
            data['in_systick_ms'][n],
            DeviceInputs(
                gyro=(data['in_gyro_x'][n], data['in_gyro_y'][n]),
                revolutions=(data['in_rev_x'][n], data['in_rev_y'][n]),
                battery_mv=data['in_battery_mv'][n],
                sticks=tuple(data['in_bt_packet'][n]) if data['in_bt_present'][n] else None,
            ),
        )
        state, x, y = program.state, program.x, program.y
        logged = [[p.adc1, p.adc2] for p in outputs.log] or [[0, 0]]
        computed = {
            'out_duty_x': outputs.duty[0],
            'out_duty_y': outputs.duty[1],
            'out_operating_state': state.control_mode,
            'out_flag_avoid': state.flag_avoid,
            'out_flag_auto': state.flag_auto,
            'out_log_event': bool(outputs.log),
            'out_log_values': logged[0],
            'out_tone_event': bool(outputs.tones),
            'out_battery': bits(state.battery)[0],
            'out_gyro_offset': bits(x.gyro_offset, y.gyro_offset),
            'out_theta_diff': bits(x.theta_diff, y.theta_diff),
            'out_psi_diff': bits(x.psi_diff, y.psi_diff),
            'out_ud_int_thetadot_ref': bits(x.sum_theta_ref_dot, y.sum_theta_ref_dot),
            'out_ud_int_psidot': bits(x.sum_psi_dot, y.sum_psi_dot),
            'out_ud_int_theta_diff': bits(x.sum_theta_diff, y.sum_theta_diff),
            'out_ud_lpf_theta': bits(x.theta_smooth, y.theta_smooth),
            'out_ud_lpf_thetadot_ref': bits(x.theta_ref_dot, y.theta_ref_dot),
        }
        expected = {name: data[name][n] for name in computed}
        assert computed == expected, f'tick {n}'


def test_golden_data_exist():
    assert len(GOLDEN) >= 9
