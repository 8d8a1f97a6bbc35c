"""Which lines of a log pass through the panel, and which stay on the terminal."""

import pytest

from ballbot_ros.nodes.teleop.terminal import PassingMessages


def test_only_the_newest_lines_of_level_info_are_kept():
    messages = PassingMessages(2)
    for number in range(5):
        assert messages.take(f'[INFO] [1795727421.93] [gamepad_teleop]: in command: {number}\n')
    assert [*messages.lines] == ['gamepad_teleop: in command: 3', 'gamepad_teleop: in command: 4']
    messages.lines.append('key x does nothing')
    assert messages.lines[-1] == 'key x does nothing'


@pytest.mark.parametrize(
    'line',
    ['[WARN] [1.0] [plant_sim]: late', '[ERROR] [1.0] [a]: b', 'viewer  http://x/', '', '[INFO]'],
)
def test_all_other_lines_stay(line):
    messages = PassingMessages(2)
    assert not messages.take(line)
    assert not messages.lines
