"""Closes its terminal in a line above the panel; prints 'gone' when this is reported."""

import fcntl
import os
import pty
import termios
import threading
import time

from prompt_toolkit.renderer import Renderer

from ballbot_ros.nodes.teleop.sticks import NO_SOURCE, Arbiter
from ballbot_ros.nodes.teleop.terminal import KeyboardSticks, Terminal
from ballbot_ros.robot.brick.bluetooth import NEUTRAL

output = os.dup(1)
ours, side = pty.openpty()
fcntl.ioctl(side, termios.TIOCSCTTY, 0)
for fd in (0, 1, 2):
    os.dup2(side, fd)
os.close(side)

shown = threading.Event()
keyboard = Terminal(
    KeyboardSticks(50),
    Arbiter(),
    lambda: (NO_SOURCE, NEUTRAL),
    lambda: shown.set() or {},
    on_quit=lambda: None,
)
shown.wait()
reset = Renderer.reset


def hang_up(*arguments, **options):
    # Close the terminal when the panel has just been erased, to make room for the line.
    Renderer.reset = reset
    os.close(ours)
    reset(*arguments, **options)


Renderer.reset = hang_up
os.write(2, b'a line\n')
while not keyboard.is_closed:
    time.sleep(0.01)
os.write(output, b'gone\n')
