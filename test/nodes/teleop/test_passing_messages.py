"""Which lines of a log pass through the panel, and which stay on the terminal."""

import pytest

from ballbot_ros.nodes.teleop.terminal import info_message


def test_lines_of_level_info_pass():
    line = '[INFO] [1795727421.93] [gamepad_teleop]: in command: keyboard\n'
    assert info_message(line) == 'gamepad_teleop: in command: keyboard'


@pytest.mark.parametrize(
    'line',
    ['[WARN] [1.0] [plant_sim]: late', '[ERROR] [1.0] [a]: b', 'viewer  http://x/', '', '[INFO]'],
)
def test_all_other_lines_stay(line):
    assert not info_message(line)
