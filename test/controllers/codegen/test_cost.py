"""The instructions of the program's paths: counted, written to a file, and the defaults."""

import shutil
from dataclasses import fields

import parts
import pytest
from generated import need
from parts import values_of

from ballbot_ros.controllers.codegen import application
from ballbot_ros.controllers.codegen.application import (
    CODE_TEMPLATES,
    TEMPLATE_FOLDER,
    application_files,
    program_sha256,
    write_application,
    write_times,
)
from ballbot_ros.controllers.codegen.folder_check import (
    BuiltApplication,
    InputSequence,
    TaskCall,
    path_instructions,
    path_steps,
)
from ballbot_ros.controllers.codegen.toolchain import ARM
from ballbot_ros.controllers.document.program import (
    TASK_NUMBERS,
    ControlMode,
    ControlProgram,
    job_time,
)
from ballbot_ros.parameters import CONTROLLER, ControllerParameters
from ballbot_ros.parameters.brick_time import TaskCosts
from ballbot_ros.parameters.files import read_parameter_file
from ballbot_ros.robot.brick.job_times import JobTimes

VALUES = values_of(CONTROLLER)
STOP, CALIBRATION, CONTROL = ControlMode
COUNTS = [field.name for field in fields(TaskCosts) if field.name.endswith('_instructions')]


def calls_of(folder):
    """Return the calls of all tasks of the default program, on the sequence with all paths."""
    write_application(folder / 'c', VALUES)
    built = BuiltApplication(folder / 'c', ARM, folder / 'build')
    return built.calls([InputSequence('paths', list(path_steps(VALUES)))])


@pytest.fixture(scope='module')
def calls(tmp_path_factory):
    need('arm')
    return calls_of(tmp_path_factory.mktemp('cost'))


@pytest.fixture
def templates(tmp_path, monkeypatch):
    """A copy of the templates, which is used instead of them."""
    folder = tmp_path / 'templates'
    shutil.copytree(TEMPLATE_FOLDER, folder)
    monkeypatch.setattr(application, 'TEMPLATE_FOLDER', folder)
    return folder


def test_each_path_is_counted_and_the_long_ones_take_longer(calls):
    counts = path_instructions(calls)
    assert list(counts) == COUNTS
    assert min(counts.values()) > 0
    control, calibration, log, state, tone, stop, obstacle, display = (
        counts[f'{path}_instructions']
        for path in ('control', 'calibration', 'log', 'state', 'tone', 'stop', 'obstacle',
                     'display')
    )  # fmt: skip
    assert control > calibration > stop > display
    assert control > log > stop
    assert calibration > tone
    assert state > obstacle > display


def test_no_job_of_the_kernel_is_shorter_than_its_call(calls):
    """The kernel's model of a job and the labels of the counted calls agree."""
    counts = {name.removesuffix('_instructions'): n for name, n in path_instructions(calls).items()}
    times = JobTimes(**counts, own=0.0, variation=0.0, sonar=0)
    reached = set()
    for call in calls:
        number = TASK_NUMBERS[call.task]
        job = job_time(times, number, call.control_mode, call.has_logged, call.has_tone)
        assert call.instructions <= job, call
        if call.instructions == job:
            reached.add(call.path)
    assert reached == counts.keys()


def test_the_defaults_are_the_counts_for_the_default_parameters(calls):
    for name, count in path_instructions(calls).items():
        assert getattr(VALUES, name) == pytest.approx(count, rel=0.15), name


def test_the_file_of_times_gives_exactly_the_counts(tmp_path):
    counts = {name: 1000 + number for number, name in enumerate(COUNTS)}
    path = write_times(tmp_path, VALUES, counts)
    written = read_parameter_file(path).of(ControllerParameters)
    assert {name: getattr(written, name) for name in COUNTS} == counts
    assert written.times_of == program_sha256()[:16]
    assert application_files(written) == application_files(VALUES)
    assert 'counted by ballbot codegen --check' in path.read_text()


@pytest.mark.parametrize('name', CODE_TEMPLATES)
def test_another_text_of_the_program_is_another_program(templates, name):
    before = program_sha256()
    path = templates / name
    path.write_text(path.read_text() + '\n')
    assert program_sha256() != before
    shutil.copy(TEMPLATE_FOLDER / name, path)
    (templates / 'README.md').write_text('')
    assert program_sha256() == before


def test_a_slower_task_costs_more_and_no_other(calls, templates, tmp_path):
    path = templates / 'ballbot_controller.c'
    text, start = path.read_text(), 'TASK(task_ts2)\n{\n'
    assert text.count(start) == 1
    loop = '    volatile U32 n;\n\n    for (n = 0U; n < 100U; n++) {\n    }\n'
    path.write_text(text.replace(start, start + loop))
    slower, before = path_instructions(calls_of(tmp_path)), path_instructions(calls)
    more = {name: slower[name] - count for name, count in before.items()}
    # At least load, compare and branch, and at most ten instructions.
    assert 300 < more.pop('obstacle_instructions') < 1000
    assert max(map(abs, more.values())) <= 5


@pytest.mark.parametrize(
    'changes',
    [
        {},
        {'mode': 'autonomous', 'time_start': 2**31, 'time_auto': 2**32 - 5000, 'time_stop': 2**31},
        {'time_start': 0, 'time_stop': 4, 'tone_gain': 1, 'log_count': 255},
        {'theta_diff_thr': 1e6, 'psi_diff_thr': 180.0, 'wheel_radius': 0.001, 'ball_radius': 1.0},
        {'theta_diff_thr': 0.0, 'ts2_period': 4, 'ts3_period': 4, 'time_start': 400},
    ],
)
def test_one_sequence_takes_all_paths(changes):
    values = values_of(CONTROLLER, **changes)
    program, paths = ControlProgram(values), set()
    for step in path_steps(values):
        mode = program.state.control_mode
        outputs = parts.tick(program, *step)
        paths.add((mode, bool(outputs.log)))
        if outputs.tones:
            paths.add('tone')
        if values.mode == 'autonomous' and program.state.flag_auto:
            paths.add('auto')
    assert paths >= {
        (CALIBRATION, False), (CONTROL, True), (CONTROL, False), (STOP, False), 'tone',
    }  # fmt: skip
    assert ('auto' in paths) == (values.mode == 'autonomous')


def test_a_robot_that_never_stops_has_no_path_of_the_stop():
    values = values_of(CONTROLLER, time_start=2**32 - 1, time_stop=2**32 - 1)
    program, modes = ControlProgram(values), set()
    for step in path_steps(values):
        parts.tick(program, *step)
        modes.add(program.state.control_mode)
    assert modes == {CALIBRATION}


def call_of(instructions, mode, *, has_logged=False):
    return TaskCall('task_ts1', mode, has_logged, False, instructions)


def test_a_path_that_is_not_taken_has_no_count():
    calibration = call_of(400, CALIBRATION)
    assert path_instructions([calibration]) == {'calibration_instructions': 400}
    packets = [call_of(count, CONTROL, has_logged=True) for count in (6300, 6100)]
    assert path_instructions([calibration, *packets]) == {
        'calibration_instructions': 400,
        'control_instructions': 6300,
        'log_instructions': 0,
    }
