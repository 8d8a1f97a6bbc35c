"""The commissioning program as C: equal to the Python controller, bit for bit."""

import random
from collections import Counter
from itertools import pairwise

import parts
import pytest
from generated import SHORT, Built, branch_counts, commissioning, need

from ballbot_ros.controllers.codegen.application import application_files, write_application
from ballbot_ros.controllers.codegen.folder_check import (
    BuiltApplication,
    compare,
    random_steps,
    read_folder_parameters,
)
from ballbot_ros.controllers.codegen.programs import BALANCE, COMMISSIONING, program_of
from ballbot_ros.controllers.codegen.toolchain import ARM, TARGETS
from ballbot_ros.controllers.commissioning import END
from ballbot_ros.engine.scenario_steps import check_sequences
from ballbot_ros.errors import BallbotError
from ballbot_ros.parameters import ControllerParameters, ParameterSet

VALUES = commissioning(**SHORT, play_duty=99)


def drawn_values(seed):
    """Return values for which each phase, and each of its parts, lasts a few ticks."""
    draw = random.Random(seed)
    times = {name: draw.choice((0.004, 0.008, 0.02)) for name in SHORT if name.endswith('time')}
    duties = {name: draw.randint(1, 100) for name in ('port_duty', 'play_duty')}
    return commissioning(**times, **duties, play_pulses=draw.randint(1, 20))


def steps_to_the_end(values, seed, *, out_of_range=True):
    ticks = COMMISSIONING.duration(values) + 10
    return list(random_steps(seed, ticks, out_of_range=out_of_range))


@pytest.mark.parametrize('target', TARGETS)
@pytest.mark.parametrize('seed', range(4))
def test_the_programs_are_equal_to_the_end_and_after_a_restart(built, target, seed):
    values = drawn_values(seed)
    made = built(target, values=values)
    program = made.program()
    for again in range(3):
        steps = steps_to_the_end(values, 10 * seed + again, out_of_range=again != 1)
        # No packet waits in a new program, while one may wait in a process that goes on.
        steps[0] = steps[0]._replace(inputs=steps[0].inputs._replace(sticks=(1, 2)))
        result = compare(values, program, steps if again else steps[:999])
        assert not result.difference, (again, result.difference)
        assert result.ticks == min(len(steps), len(steps) if again else 999)


def test_a_changed_duration_or_duty_changes_both(built):
    steps = steps_to_the_end(VALUES, 1)
    assert not compare(VALUES, built('c', values=VALUES).program(), steps).difference
    for number, (name, value) in enumerate(
        {'rest_time': 0.104, 'step_time': 0.008, 'play_duty': 98, 'port_duty': 3}.items()
    ):
        other = commissioning(**{**SHORT, 'play_duty': 99, name: value})
        made = built('c', values=other, name=str(number))
        assert not compare(other, made.program(), steps).difference
        assert 'in C and' in compare(VALUES, made.program(), steps).difference, name


def test_short_phases_reach_every_branch_of_the_generated_c(built):
    made = built('c', flags=('--coverage', '-O0'), values=VALUES)
    program = made.program()
    for step in steps_to_the_end(VALUES, 1):
        parts.tick(program, *step)
    del program  # the counts are written at the end of the process
    reached = Counter()
    for source in ('ballbot_controller.c', 'ballbot_app.c'):
        reached.update(branch_counts(made, source))
    assert len(reached) >= 32
    assert all(reached.values()), [key for key, count in reached.items() if not count]


def test_the_sequence_of_a_check_lasts_until_the_end():
    parameters = ParameterSet()
    for name, value in COMMISSIONING.settings(VALUES).items():
        parameters.set('controller', name, value)
    [sequence] = check_sequences(parameters)
    program = COMMISSIONING.counterpart(VALUES)
    phases = []
    for step in sequence.steps:
        parts.tick(program, *step)
        phases.append(program.controller.state.phase)
    assert [*dict.fromkeys(phases)] == [*range(END + 1)]
    assert all(after - before in (0, 1) for before, after in pairwise(phases))


def test_the_folder_knows_its_program(tmp_path):
    write_application(tmp_path / 'c', VALUES)
    read = read_folder_parameters(tmp_path / 'c').of(ControllerParameters)
    assert program_of(read) is COMMISSIONING
    assert application_files(read, tmp_path / 'c') == application_files(VALUES, tmp_path / 'c')
    assert program_of(ControllerParameters()) is BALANCE
    # Of any other controller, the document's program is generated.
    assert program_of(ControllerParameters(implementation='lqg')) is BALANCE
    path = tmp_path / 'c' / 'parameters.yaml'
    path.write_text(path.read_text().replace('user.rest_time: 0.1', 'user.rest_time: -0.1'))
    with pytest.raises(BallbotError, match=r'parameters\.yaml:\d+: .*rest_time'):
        read_folder_parameters(tmp_path / 'c')


def test_the_readme_says_what_one_does_and_the_dictionary_has_all_signals():
    files = application_files(VALUES)
    assert 'Put the robot on a stand' in files['README.md']
    assert 'rest: do not touch the robot | 0.1 s' in files['README.md']
    assert 'TARGET = commissioning' in files['Makefile']
    for variable in COMMISSIONING.variables:
        assert f'| `{variable.name}` | {variable.c_type} |' in files['DATA_DICTIONARY.md']
    for constant in COMMISSIONING.constants(VALUES):
        assert f'| `{constant.declarator}` | {constant.c_type} |' in files['DATA_DICTIONARY.md']


def test_it_is_measured_but_has_no_times_of_paths(tmp_path):
    need('arm')
    write_application(tmp_path / 'c', VALUES)
    application = BuiltApplication(tmp_path / 'c', ARM, tmp_path / 'build')
    [sequence] = check_sequences(read_folder_parameters(tmp_path / 'c'))
    assert not application.compare([sequence]).difference
    cost = application.cost([sequence])
    assert cost.instructions == {}
    tasks = {task.name: task for task in cost.tasks}
    assert tasks.keys() == {'task_init', 'task_ts1', 'task_lcd'}
    assert 50 < tasks['task_ts1'].instructions < 400
    assert tasks['task_ts1'].stack_bytes < 200


def test_a_program_of_another_kind_is_refused(tmp_path):
    need('c')
    made = Built(VALUES, 'c', tmp_path)
    with pytest.raises(BallbotError, match='the folder was made by another version'):
        BALANCE.start(made.command, made.tasks, ControllerParameters())
