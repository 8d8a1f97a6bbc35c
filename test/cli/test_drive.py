"""`ballbot drive` as a user types it, on a pseudo terminal."""

import contextlib
import os
import re
import signal
import subprocess
import termios
import urllib.request

import pytest
from graph import BALLBOT, LAST_RESORT_S, NODES, alive, children, environment, wait_for
from terminal import Terminal

from ballbot_ros.analysis.data_log import read_data_log
from ballbot_ros.recording.reader import RecordingReader

pytestmark = pytest.mark.graph

pytest.importorskip('rclpy')

UP = b'\x1b[A'
CHILDREN = set(NODES) - {'gamepad_teleop'}


class Drive(Terminal):
    """`ballbot drive` on a pseudo terminal."""

    def __init__(self, domain, folder, *arguments):
        super().__init__()
        self.settings = termios.tcgetattr(self.side)
        self.folder = folder
        words = ['drive', '--device', '', '--output', str(folder), *map(str, arguments)]
        self.process = self.start([*BALLBOT, *words], **environment(domain))

    def begin(self, names=CHILDREN):
        """Wait until the robot can be driven; return the pids of the nodes."""
        pids = wait_for(lambda: _started(self.process, names), what='the start')
        self.wait_for_text(b'remote')
        return pids

    def finish(self):
        return self.process.wait(LAST_RESORT_S)

    def kill(self):
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()

    def recorded(self):
        """Return source and sticks in the recording, in order, without repetitions."""
        with RecordingReader(self.folder / 'drive.mcap') as reader:
            assert reader.complete
            found = []
            for _, _, message in reader.messages({'/gamepad'}):
                entry = (message.header.frame_id, *map(float, message.axes))
                if not found or found[-1] != entry:
                    found.append(entry)
            return found


def _started(process, names=CHILDREN):
    found = children(process.pid)
    return found if set(found) >= names else None


@pytest.fixture
def start_drive(domain, tmp_path):
    with contextlib.ExitStack() as stack:

        def start(*arguments):
            drive = Drive(domain, tmp_path / 'drive', *arguments)
            stack.callback(drive.kill)
            return drive

        yield start


def test_keys_drive_reset_and_quit(start_drive):
    drive = start_drive('--start', '1.5', '0.5')
    pids = drive.begin()
    drive.press_until_shown(UP, 'forward +50')
    drive.wait_for_text(b'keyboard')
    drive.press_until_shown(b'a', 'rightward -50')
    drive.press(b'?')
    drive.wait_until_shown("key '?' does nothing")
    drive.press(b'+')
    drive.wait_until_shown('key speed   60 %')
    drive.press(b'r')
    drive.wait_until_shown('state       calibration')
    drive.wait_until_shown('state       remote')
    drive.press(b'q')
    assert drive.finish() == 0
    assert not any(alive(pid) for pid in pids.values())
    assert termios.tcgetattr(drive.side) == drive.settings
    path = str(drive.folder / 'drive.mcap').encode()
    wait_for(lambda: path in drive.screen.replace(b'\r\n', b''), what='the path on the screen')
    assert ('keyboard', -0.5, 0.0) in drive.recorded()
    assert drive.recorded()[0] == ('scenario', 0.0, 0.0)
    with RecordingReader(drive.folder / 'drive.mcap') as reader:
        _, _, odometry = next(reader.messages({'/plant/odom'}))
    point = odometry.pose.pose.position
    assert (point.x, point.y) == (1.5, 0.5)
    with RecordingReader(drive.folder / 'drive.mcap') as reader:
        log = read_data_log(reader)
    assert len(log.runs) == 2
    assert log.malformed == 0


def test_the_page_and_the_keyboard_go_together_and_ctrl_c_quits(start_drive):
    pytest.importorskip('viser', reason='the extra viewer is not installed')
    drive = start_drive('--no-record', '--viewer', '--set', 'viewer.port=0')
    line = wait_for(
        lambda: re.search(rb'viewer  (http://127.0.0.1:\d+/\?token=\S+)\r?\n', drive.screen),
        what='the address of the page',
    )
    drive.wait_for_text(b'press a key', line.end())
    drive.wait_for_text(b'arrows or w a s d drive', line.end())  # the panel is redrawn below it
    drive.press(b'x')  # any key begins the drive
    pids = drive.begin(CHILDREN - {'recorder'} | {'viewer'})
    with urllib.request.urlopen(line[1].decode()) as page:
        assert page.headers.get_content_type() == 'text/html'
    drive.press(UP + b'h')
    drive.wait_until_shown('forward +50')
    drive.press(b'\x03')
    assert drive.finish() == 0
    assert not any(alive(pid) for pid in pids.values())
    assert termios.tcgetattr(drive.side) == drive.settings


def test_sigterm_ends_a_drive_and_its_recording_is_complete(start_drive):
    drive = start_drive()
    pids = drive.begin()
    drive.process.send_signal(signal.SIGTERM)
    assert drive.finish() == 0
    assert not any(alive(pid) for pid in pids.values())
    assert termios.tcgetattr(drive.side) == drive.settings
    drive.recorded()


def test_a_terminal_that_vanishes_ends_the_drive(start_drive):
    drive = start_drive()
    pids = drive.begin()
    drive.press(UP + b'h')
    drive.wait_for_text(b'held')
    drive.wait_until_shown('forward +50')
    os.close(drive.side)
    drive.hang_up()
    drive.finish()
    assert not any(alive(pid) for pid in pids.values())
    assert ('keyboard', -0.5, 0.0) in drive.recorded()


def test_without_a_terminal_it_explains_how_to_drive(domain, tmp_path):
    command = [*BALLBOT, 'drive', '--device', '', '--output', str(tmp_path)]
    process = subprocess.Popen(
        command, env=environment(domain), stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        wait_for(lambda: _started(process), what='the start')
        wait_for((tmp_path / 'drive.mcap').exists, what='the recording')
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=LAST_RESORT_S)
    finally:
        process.kill()
    assert process.returncode == 0
    # Ignore the node's information: it depends on whether the run has begun by now.
    lines = err.splitlines()
    assert [line for line in lines if not line.startswith('[INFO] ')] == [
        (
            'no keyboard (standard input and output are not a terminal): '
            'drive with a gamepad, joy or cmd_vel'
        )
    ]
    assert out.splitlines()[0] == f'recording  {tmp_path / "drive.mcap"}'


def test_a_mistake_is_one_line(domain):
    done = subprocess.run(
        [*BALLBOT, 'drive', '--no-record', '--map', '/nowhere/map.png'],
        check=False, env=environment(domain), stdin=subprocess.DEVNULL,
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == 'error: /nowhere/map.png: No such file or directory\n'
