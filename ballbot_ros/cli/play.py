"""`ballbot play`: the player with keys and a status line."""

from __future__ import annotations

import os
import re
import select
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click

from ballbot_ros.cli.options import RECORDING, split_at_commas
from ballbot_ros.nodes.middleware import stay_local
from ballbot_ros.parameters import PLAYER, ParameterSet, PlayerParameters
from ballbot_ros.recording.playback import terminal_action
from ballbot_ros.run.requirements import require_rclpy

KEYS_S = 0.05
QUIT = 'q'
_KEY = re.compile('\x1b\\[[0-9]+~|\x1b[\\[O].|.', re.DOTALL)


def _play_file(parameters: PlayerParameters) -> int:
    """Play a recording; return the exit status."""
    require_rclpy()
    from rclpy.logging import LoggingSeverity
    from rclpy.parameter import Parameter

    from ballbot_ros.nodes.base import run_node
    from ballbot_ros.nodes.player import Player

    stay_local()

    def make() -> Player:
        player = Player(parameters)
        player.get_logger().set_level(LoggingSeverity.WARN)
        if not sys.stdin.isatty():
            return player

        def press(key: str) -> None:
            if key == QUIT:
                player.finish()
            elif action := terminal_action(key):
                player.playback.apply(action)
                if player.playback.rate != player.parameters.rate:
                    player.set_parameters([Parameter('rate', value=player.playback.rate)])

        def attend() -> None:
            playback = player.playback
            for key in _read_keys():
                press(key)
            if sys.stderr.isatty():
                paused = '' if playback.is_playing else '   paused'
                sys.stderr.write(
                    f'\r{playback.time:8.2f} / {playback.end:.2f} s   {playback.rate:.2f} ×'
                    f'{"   loop" if playback.is_looping else ""}{paused}\x1b[K'
                )
                sys.stderr.flush()

        player.create_wall_timer(KEYS_S, attend)
        return player

    with _key_by_key():
        return run_node(make)


def parse_keys(text: str) -> list[str]:
    """Split the keys that a terminal sends together; some have several characters."""
    return _KEY.findall(text)


@contextmanager
def _key_by_key() -> Iterator[None]:
    """Let a terminal give keys as they are pressed; leave the status line at the end."""
    if not sys.stdin.isatty():
        yield
        return
    before = termios.tcgetattr(sys.stdin)
    tty.setcbreak(sys.stdin, termios.TCSADRAIN)
    try:
        yield
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)
        if sys.stderr.isatty():
            sys.stderr.write('\n')


def _read_keys() -> list[str]:
    """Return the keys that were pressed since the last call."""
    if not select.select([sys.stdin], [], [], 0.0)[0]:
        return []
    return parse_keys(os.read(sys.stdin.fileno(), 64).decode(errors='replace'))


@click.command('play')
@click.argument('file', type=RECORDING)
@click.option('--rate', default=1.0, show_default=True, help='Speed in multiples of real time.')
@click.option(
    '--start', default=0.0, show_default=True, help='Start, counted from the first message [s].'
)
@click.option('--loop', is_flag=True, help='Restart at the end.')
@click.option(
    '--topics',
    multiple=True,
    callback=split_at_commas,
    metavar='TOPIC[,TOPIC…]',
    help='The topics to publish; can be repeated.  [default: all]',
)
def command(file: Path, rate: float, start: float, loop: bool, topics: list[str]) -> int:
    """Publish the recording FILE with its /clock, on the recorded topics.

    Keys: space pauses, → and ← skip 5 s, . goes one tick on, Home goes to the start, End pauses at
    the end, l restarts at the end, + and - change the speed, q ends. The player does not publish
    /clock and plant topics in a domain with a running plant.
    """
    parameters = ParameterSet()
    parameters.set(PLAYER, 'file', str(file))
    parameters.set(PLAYER, 'rate', rate)
    parameters.set(PLAYER, 'start', start)
    parameters.set(PLAYER, 'loop', loop)
    parameters.set(PLAYER, 'topics', ','.join(topics))
    return _play_file(parameters.of(PlayerParameters))
