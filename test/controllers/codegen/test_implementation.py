"""The compiled program as nodes and closed loop use it."""

import gc
import os
import signal
from pathlib import Path

import parts
import pytest
from generated import need
from parts import AT_REST, values_of

from ballbot_ros.controllers.codegen.implementation import implementation_for
from ballbot_ros.controllers.codegen.toolchain import TARGETS
from ballbot_ros.controllers.document.program import ControlProgram
from ballbot_ros.errors import CodegenError
from ballbot_ros.parameters import CONTROLLER


def own_children():
    """Return the process ids of this process's children."""
    tasks = Path('/proc/self/task').glob('*/children')
    return {int(pid) for task in tasks for pid in task.read_text().split()}


def test_python_is_the_default():
    assert isinstance(implementation_for(values_of(CONTROLLER)).make(), ControlProgram)


@pytest.mark.parametrize('target', TARGETS)
def test_each_program_starts_from_the_initial_state_and_ends_with_its_owner(target):
    need(target)
    make = implementation_for(values_of(CONTROLLER, implementation=target, time_start=0)).make
    gc.collect()
    before = own_children()
    for _ in range(2):
        program = make()
        assert program.operating_state == 'calibration'
        states = []
        for elapsed_ms in range(0, 12, 4):
            parts.tick(program, elapsed_ms, 1000 + elapsed_ms, AT_REST)
            states.append(program.operating_state)
        assert states == ['backward'] * 3  # the sonar has not answered yet
        assert len(own_children() - before) == 1
        del program
        assert own_children() == before


@pytest.mark.parametrize('target', TARGETS)
def test_a_program_that_dies_is_reported(target):
    need(target)
    make = implementation_for(values_of(CONTROLLER, implementation=target)).make
    before = own_children()
    program = make()
    parts.tick(program, 0, 1000, AT_REST)
    [pid] = own_children() - before
    os.kill(pid, signal.SIGKILL)
    with pytest.raises(CodegenError, match='the compiled controller ended with status -9'):
        parts.tick(program, 4, 1004, AT_REST)


def test_a_value_that_no_device_gives_is_refused():
    need('c')
    program = implementation_for(values_of(CONTROLLER, implementation='c')).make()
    with pytest.raises(CodegenError, match="a reading is out of its device's range"):
        parts.tick(program, 0, 1000, AT_REST._replace(battery_mv=70000))


@pytest.mark.parametrize('implementation', ['python', 'c'])
def test_only_the_named_tasks_run(implementation):
    if implementation in TARGETS:
        need(implementation)
    program = implementation_for(
        values_of(CONTROLLER, implementation=implementation, time_start=0)
    ).make()
    assert program.run(['task_init', 'task_lcd'], 1000, AT_REST).pages
    assert program.operating_state == 'calibration'
    assert program.run(['task_ts3'], 1004, AT_REST).tones
    assert program.operating_state == 'remote'
    assert not program.run(['task_ts1'], 1008, AT_REST).pages
    program.run(['task_ts2'], 1012, AT_REST)
    assert program.operating_state == 'backward'  # the sonar has not answered yet
