"""Closes its terminal in a line above the panel; prints 'gone' when this is reported."""

import fcntl
import os
import pty
import signal
import termios
import threading

from prompt_toolkit.renderer import Renderer

from ballbot_ros.nodes.teleop.terminal import KeyboardSticks, Terminal

output = os.dup(1)
ours, side = pty.openpty()
signal.signal(signal.SIGHUP, signal.SIG_IGN)
fcntl.ioctl(side, termios.TIOCSCTTY, 0)
for fd in (0, 1, 2):
    os.dup2(side, fd)
os.close(side)

shown, gone = threading.Event(), threading.Event()
Terminal(
    KeyboardSticks(50),
    lambda: shown.set() or {},
    on_sticks=lambda sticks: None,
    on_reset=lambda: None,
    on_quit=lambda: None,
    on_key=lambda: None,
    on_closed=gone.set,
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
gone.wait()
os.write(output, b'gone\n')
