"""A drive by hand: its settings, its nodes, and its exit status."""

import os
import signal
import threading
import time
from contextlib import nullcontext
from functools import partial
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from graph import LAST_RESORT_S
from laws import refusal

from ballbot_ros.errors import BallbotError
from ballbot_ros.lockstep.liveness import ThreadTime
from ballbot_ros.nodes import processes
from ballbot_ros.parameters import GAMEPAD, NODES, RECORDER, VIEWER, PlantParameters
from ballbot_ros.run import drive, one_process
from ballbot_ros.run.drive import DriveResult, drive_spec
from ballbot_ros.run.one_process import NodeThread


def test_a_drive_is_in_real_time_and_survives_walls():
    """An assignment overrides everything; y in the frame map has the opposite sign of plane y."""
    plant = drive_spec(start=(1.5, 0.5)).parameters.of(PlantParameters)
    assert (plant.real_time_factor, plant.on_wall_hit) == (1.0, 'report')
    assert (plant.start_position_x, plant.start_position_y) == (1.5, -0.5)
    words = ('plant_sim.real_time_factor=0.5', 'plant_sim.on_wall_hit=stop')
    plant = drive_spec(assignments=words).parameters.of(PlantParameters)
    assert (plant.real_time_factor, plant.on_wall_hit) == (0.5, 'stop')


def test_a_mistake_of_the_user_gives_the_exit_status_before_any_other_failure():
    for failure, ends, gamepad, expected in (
        ('', [0, 0], 0, 0),
        ('', [0, 0], 1, 1),
        ('', [0, 1], 0, 1),
        ('', [1, 2], 1, 2),
        ('plant_sim was killed by SIGKILL', [-9, 0], 0, 1),
        ('gyro_driver ended with status 2', [0, 2], 0, 2),
    ):
        found = drive._exit_status(failure, ends, gamepad)
        assert found == expected, (failure, ends, gamepad)


def test_a_drive_refuses_what_it_can_not_use(monkeypatch):
    monkeypatch.setenv('PATH', '')
    for assignment, told in (
        ('recorder.output=x.mcap', 'recorder.output cannot be set'),
        ('controller.implementation=c', 'gcc not found'),
        ('plant_sim.map=mars', "unknown map 'mars'"),
    ):
        error = refusal(BallbotError, partial(drive_spec, assignments=[assignment]))
        assert told in error, assignment


class Graph:
    """Replaces ROS and the processes of a drive; `run` is called with what stops the drive."""

    def __init__(self, monkeypatch, run=lambda should_stop: None):
        self.run = run
        self.events, self.notices = [], []
        self.gamepad = SimpleNamespace(terminal=None, finished=False, exit_status=0)
        self.error = None
        for name, stub in (
            ('require_viewer', lambda parameters: self.events.append('viewer can start')),
            ('ForkClient', nullcontext),
            ('ros', lambda level: nullcontext()),
            ('GamepadTeleop', self._make_gamepad),
            ('NodeThread', lambda node: self),
            ('run_nodes', self._run_nodes),
        ):
            monkeypatch.setattr(drive, name, stub)

    def _make_gamepad(self, parameters):
        self.parameters = parameters
        return self.gamepad

    def _run_nodes(self, client, names, parameters, scratch, observer, should_stop):
        self.names = names
        self.run(should_stop)
        return {}, ''

    def close(self):
        self.events.append('gamepad closed')

    def drive(self, output, *, record=True, **options):
        observer = SimpleNamespace(notice=self.notices.append)
        return drive.drive(drive_spec(output=output, record=record), observer, **options)


def test_a_drive_starts_the_other_nodes_and_a_viewer_if_asked_for(monkeypatch, tmp_path):
    others = [name for name in NODES if name != GAMEPAD]
    unrecorded = [name for name in others if name != RECORDER]
    for record, viewer, names in (
        (True, False, others), (False, False, unrecorded), (False, True, [*unrecorded, VIEWER]),
    ):  # fmt: skip
        graph = Graph(monkeypatch)
        assert graph.drive(tmp_path, record=record, viewer=viewer) == DriveResult(0, None)
        assert graph.names == names
        assert ('viewer can start' in graph.events) == viewer


def test_a_drive_without_a_keyboard_says_why(monkeypatch, tmp_path):
    for reason in ('', 'no terminal'):
        graph = Graph(monkeypatch)
        graph.drive(tmp_path, no_keyboard=reason)
        assert graph.parameters.keyboard == (not reason)
        assert [reason in notice for notice in graph.notices] == ([True] if reason else [])


def test_a_drive_writes_the_recording_where_it_is_told(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    graph = Graph(monkeypatch, lambda should_stop: (tmp_path / 'run/drive.mcap').touch())
    result = graph.drive(tmp_path / 'run')
    assert result.recording == tmp_path / 'run/drive.mcap'


def test_a_signal_the_quit_key_and_the_loss_of_the_terminal_stop_a_drive(monkeypatch, tmp_path):
    def vanish(gamepad):
        gamepad.terminal = SimpleNamespace(is_closed=True)

    for stop in (
        lambda gamepad: signal.raise_signal(signal.SIGTERM),
        lambda gamepad: setattr(gamepad, 'finished', True),
        vanish,
    ):
        seen = []

        graph = Graph(monkeypatch)

        def run(should_stop, stop=stop, seen=seen, gamepad=graph.gamepad):
            seen.append(should_stop())
            stop(gamepad)
            seen.append(should_stop())

        graph.run = run
        graph.drive(tmp_path)
        assert seen == [False, True]


def test_the_gamepad_is_closed_and_its_error_is_raised(monkeypatch, tmp_path):
    graph = Graph(monkeypatch)
    graph.error = OSError('lost')
    with pytest.raises(OSError, match='lost'):
        graph.drive(tmp_path)
    assert graph.events == ['gamepad closed']

    def fail(should_stop):
        raise BallbotError('another plant')

    graph = Graph(monkeypatch, fail)
    with pytest.raises(BallbotError, match='another plant'):
        graph.drive(tmp_path)
    assert graph.events == ['gamepad closed']


@pytest.mark.parametrize('is_starved', [True, False])
def test_a_node_on_a_thread_has_more_time_if_it_lacks_a_processor(is_starved, monkeypatch):
    """If its thread still runs at the end of the interpreter, Python may abort."""
    returns = threading.Event()
    monkeypatch.setattr(one_process, 'END_S', 0.2)
    monkeypatch.setattr(one_process, 'spin', lambda nodes, end: returns.wait(LAST_RESORT_S))
    node = SimpleNamespace(get_name=lambda: 'pad', close=list, destroy_node=list)
    thread, looks = NodeThread(node), []

    def threads_by_process(processes):
        looks.append(processes)
        if len(looks) == 20:
            returns.set()
        queued_s = time.monotonic() if is_starved else 0.0
        return {os.getpid(): {1: ThreadTime(0.0, queued_s, is_runnable=is_starved)}}

    monkeypatch.setattr(processes, 'threads_by_process', threads_by_process)
    thread.close()
    assert returns.is_set() is is_starved
    returns.set()


def test_a_node_on_a_thread_ends_in_order_and_stores_its_error(monkeypatch):
    for error in (None, KeyError('lost')):
        events, ended = [], threading.Event()

        def spin(nodes, end, error=error, events=events, ended=ended):
            # A callback that hangs must not keep the command from ending.
            events.append(('spin', nodes, threading.current_thread().daemon))
            if error:
                ended.set()
                raise error
            while not end.done():
                time.sleep(0.001)
            ended.set()

        node = SimpleNamespace(
            get_name=lambda: 'pad',
            **{
                name: lambda name=name, events=events: events.append(name)
                for name in ('finish', 'close', 'destroy_node')
            },
        )
        monkeypatch.setattr(one_process, 'spin', spin)
        thread = NodeThread(node)
        if error:
            assert ended.wait(LAST_RESORT_S)
        thread.close()
        assert ended.wait(LAST_RESORT_S)
        assert thread.error is error
        assert events == [
            ('spin', [node], True), *(['finish'] if error else []), 'close', 'destroy_node'
        ]  # fmt: skip
