"""Machine code that processes share."""

import contextlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip('numba')

from compiled_logarithm import compile_logarithm

from ballbot_ros.engine import compilation
from ballbot_ros.robot.arithmetic import natural_log

PROGRAM = """
from numba.core.event import install_recorder

from ballbot_ros.robot.arithmetic import natural_log
from ballbot_ros.engine.compilation import compiled_and_kept

fast = compiled_and_kept(natural_log)
print(flush=True)
input()
with install_recorder('numba:compile') as recorder:
    assert fast(2.0) == natural_log(2.0)
compiled = [event.data['dispatcher'].py_func.__name__ for _, event in recorder.buffer]
print('natural_log' in compiled)
"""


def test_a_function_is_compiled_in_the_background_and_only_once(tmp_path, monkeypatch):
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    monkeypatch.setenv('PYTHONPATH', str(Path(__file__).parents[2]), prepend=os.pathsep)
    monkeypatch.delenv(compilation.NO_BACKGROUND)
    monkeypatch.setattr(compilation, '_in_background', set())
    started, spawn = [], os.posix_spawn

    def counted(*words, **options):
        started.append(spawn(*words, **options))

    monkeypatch.setattr(os, 'posix_spawn', counted)
    compilation._folder.cache_clear()
    try:
        for _ in range(2):
            compilation.compile_in_background(natural_log.__qualname__, compile_logarithm)
        (process,) = started
        assert os.getsid(process) == process
        _, status = os.waitpid(process, 0)
        assert status == 0
        assert compilation.is_kept(natural_log)
        monkeypatch.setattr(compilation, '_in_background', set())
        compilation.compile_in_background(natural_log.__qualname__, compile_logarithm)
        assert len(started) == 1
    finally:
        compilation._folder.cache_clear()


def test_a_system_without_room_for_a_process_goes_on_without(tmp_path, monkeypatch):
    monkeypatch.delenv(compilation.NO_BACKGROUND)
    monkeypatch.setattr(compilation, '_in_background', set())
    monkeypatch.setattr(compilation, 'has_kept_code', lambda name: False)
    monkeypatch.setattr(sys, 'executable', str(tmp_path / 'missing'))
    compilation.compile_in_background(natural_log.__qualname__, compile_logarithm)
    assert compilation._in_background == {natural_log.__qualname__}


def test_of_several_processes_that_need_it_at_once_one_compiles(tmp_path):
    environment = {**os.environ, 'XDG_CACHE_HOME': str(tmp_path)}
    with contextlib.ExitStack() as stack:
        processes = [
            stack.enter_context(
                subprocess.Popen(
                    [sys.executable, '-c', PROGRAM],
                    env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                )
            )
            for _ in range(2)
        ]  # fmt: skip
        for process in processes:
            process.stdout.readline()
        for process in processes:
            print(file=process.stdin, flush=True)
        answers = [process.communicate()[0] for process in processes]
    assert sorted(answers) == ['False\n', 'True\n']
