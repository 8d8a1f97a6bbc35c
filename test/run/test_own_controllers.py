"""Runs with a user's controller: the same in every arrangement, and ended cleanly by its faults."""

import json
import re
import signal
import subprocess
from pathlib import Path

import pytest
from graph import BALLBOT, record
from own_controllers import BALANCE, FAULTY, line_in_faulty

from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.recording.messages.conversions import stamp_ns
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.run.execution import execute
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.spec import RunOptions, RunSpec

DOES_NOT_RETURN = 'does not return within 1 s'

FAULT_S = 1.4
"""Sim time of the fault: the run begins at 1 s."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path('balance.py').write_text(BALANCE)
    Path('faulty.py').write_text(FAULTY)
    return tmp_path


class Notices:
    def __init__(self):
        self.lines = []
        self.notice = self.lines.append

    def update(self, elapsed_s):
        pass


def execute_faulty(class_name, *assignments):
    options = RunOptions(
        processes=Processes.NONE,
        controller=f'faulty.py:{class_name}',
        assignments=['plant_sim.duration=0.6', 'plant_sim.timeout=1', *assignments],
        output=Path(f'run_{class_name}'),
    )
    notices = Notices()
    return execute(RunSpec.of_scenario('stationary', options), notices), notices.lines


def last_duty(recording):
    """Return stamp [s], duty and frame of the last duty; that of a stop is named."""
    with RecordingReader(recording) as reader:
        duties = [message for _, _, message in reader.messages(['/motor_duty'])]
    message = max(duties, key=stamp_ns)  # the controller's stop may arrive after the plant's
    stamp_s = stamp_ns(message) / 1e9
    return stamp_s, (message.vector.x, message.vector.y), message.header.frame_id


OFF = ((0.0, 0.0), 'stop')


@pytest.mark.parametrize(
    ('class_name', 'told'),
    [
        ('ReturnsNaN', 'nan is not a whole number in -100 … 100 (ReturnsNaN.tick at 0.400 s; '),
        ('ReturnsOne', 'returned 3: not the duties of two motors'),
        ('Raises', f'faulty.py:{line_in_faulty("1 // 0")}: ZeroDivisionError'),
        ('Exits', f'faulty.py:{line_in_faulty("sys.exit")}: SystemExit: 3'),
        ('Blocks', f'faulty.py:{line_in_faulty("while True: pass")}: {DOES_NOT_RETURN}'),
        ('Sleeps', f'faulty.py:{line_in_faulty("time.sleep(1000")}: {DOES_NOT_RETURN}'),
        ('SleepsInAnyCase', f'{DOES_NOT_RETURN} (SleepsInAnyCase.tick at 0.400 s; '),
    ],
)
def test_a_fault_ends_a_run_without_nodes_with_the_motors_off(folder, class_name, told):
    before = signal.getsignal(signal.SIGALRM)
    result, notices = execute_faulty(class_name)
    assert (result.outcome, result.exit_status, result.ticks) == (Outcome.FAILED, 1, 100)
    assert told in result.reason
    assert result.reason.startswith('controller: ')
    assert notices == [result.reason]
    assert last_duty(result.recording) == (FAULT_S, *OFF)  # this tick is not in the file
    assert signal.getsignal(signal.SIGALRM) == before


def test_a_request_to_stop_ends_a_tick_that_may_wait(folder):
    result, _ = execute_faulty('SleepsWhenStopped', 'plant_sim.on_timeout=wait')
    assert (result.outcome, result.exit_status) == (Outcome.STOPPED, 128 + signal.SIGINT)
    assert last_duty(result.recording) == (FAULT_S, *OFF)


def test_the_timer_of_a_run_leaves_another_one_as_it_was(folder):
    left_s, _ = signal.getitimer(signal.ITIMER_REAL)  # that of pytest-timeout, if any
    signal.setitimer(signal.ITIMER_REAL, 500.0, 7.0)
    try:
        execute_faulty('Raises')
        delay_s, interval_s = signal.getitimer(signal.ITIMER_REAL)
    finally:
        signal.setitimer(signal.ITIMER_REAL, left_s)
    assert 0.0 < delay_s < 500.0
    assert interval_s == 7.0


@pytest.mark.usefixtures('slow_ticks_are_told')
def test_a_run_that_may_wait_waits_for_a_slow_controller(folder):
    Path('faulty.py').write_text(FAULTY.replace('time.sleep(1000.0)', 'time.sleep(1.5)\n') +
        '\n\nclass Late(Faulty):\n    def fail(self, readings):\n        time.sleep(0.02)\n'
        '        return 0, 0\n')  # fmt: skip
    result, notices = execute_faulty('Late', 'plant_sim.on_timeout=wait')
    assert result.ticks == 150
    # On a busy machine other ticks take long, too.
    late = re.search(r'(\d+) of 150 ticks took longer than 4 ms', notices[0])
    assert 50 <= int(late[1]) <= 150
    assert notices[0].startswith('controller: ')


def test_what_a_controller_prints_is_not_the_result(folder):
    words = ['run', 'stationary', '--processes=none', '--no-record', '--json']
    words += ['--controller=faulty.py:Prints', '--set=plant_sim.duration=0.1']
    done = subprocess.run([*BALLBOT, *words], capture_output=True, text=True, check=False)
    result = json.loads(done.stdout)
    assert done.stderr.count('here\n') == result['ticks'] == 25
    assert result['controller']['name'] == 'faulty.py:Prints'


# The other faults with one process: the timer of the ticks is that of a run without nodes.
# This controller sleeps, because an endless loop would only cost processor time.
@pytest.mark.graph
@pytest.mark.parametrize(
    ('processes', 'class_name', 'told'),
    [
        ('one', 'Sleeps', f'faulty.py:{line_in_faulty("time.sleep(1000")}: {DOES_NOT_RETURN}'),
        ('one', 'Raises', f'faulty.py:{line_in_faulty("1 // 0")}: ZeroDivisionError'),
        ('separate', 'Raises', f'faulty.py:{line_in_faulty("1 // 0")}: ZeroDivisionError'),
        ('separate', 'Sleeps', 'controller silent for 1 s at sim time 1.400 s'),
    ],
)
def test_a_fault_ends_a_graph_with_the_motors_off(start_run, folder, processes, class_name, told):
    run = start_run(
        'stationary', '--processes', processes, '--controller', f'faulty.py:{class_name}',
        '--output', folder / 'run', '--set', 'plant_sim.timeout=1', '--json',
    )  # fmt: skip
    assert run.finish() == 1, run.stderr
    assert run.result['outcome'] == 'failed'
    assert told in run.result['reason']
    assert run.result['ticks'] == 100
    stamp_s, *what = last_duty(folder / 'run' / 'stationary.mcap')
    assert stamp_s in (FAULT_S, FAULT_S + 0.004)  # of the controller, or of the plant
    assert tuple(what) == OFF
    assert 'Traceback' not in run.stderr
    if class_name == 'Raises' or processes == 'one':
        assert told not in run.stderr  # the result says it


@pytest.mark.graph
def test_a_fault_at_the_first_tick_ends_a_graph(start_run, folder):
    run = start_run('stationary', '--controller', 'faulty.py:RaisesAtOnce', '--no-record', '--json')
    assert run.finish() == 1, run.stderr
    assert 'RuntimeError: no (RaisesAtOnce.tick at 0.000 s; ' in run.result['reason']


@pytest.mark.graph
def test_a_slow_controller_is_told_by_its_node(start_run, folder):
    run = start_run(
        'stationary', '--controller', 'faulty.py:Slow', '--set', 'plant_sim.duration=0.2',
        '--no-record', '--json',
    )  # fmt: skip
    assert run.finish() == 1  # it has not begun to balance
    assert (
        'controller: 50 of 50 ticks took longer than 4 ms of wall time, the longest' in run.stderr
    )


@pytest.mark.graph
def test_all_ways_of_running_give_the_same_duties_which_replay_identically(
    start_run, folder, command
):
    arguments = [
        'stationary', '--controller', 'balance.py:Balance', '--set', 'controller.user.rate=1.9',
        '--set', 'plant_sim.duration=1.5', '--profile', 'hardware',
    ]  # fmt: skip
    _, without_nodes = record(Path('none'), *arguments)
    for processes in ('separate', 'one'):
        run = start_run(*arguments, f'--processes={processes}', f'--output={processes}', '--json')
        assert run.finish() in (0, 1), run.stderr  # with this noise it may miss an expectation
        assert run.result['ticks'] == 375, run.result['reason']
        assert run.result['duty_sha256'] == without_nodes['duty_sha256']
    path = Path('separate', 'stationary.mcap')
    status, output, errors = command('replay', path, '--json', '--controller', arguments[2])
    assert status == 0, errors
    assert [each['identical'] for each in json.loads(output)] == [True, True]


@pytest.mark.graph
def test_free_running_ticks_of_a_users_controller(start_run, folder):
    Path('slow.py').write_text(
        'from ballbot_ros.controllers import Controller, task\n'
        'class Mine(Controller):\n'
        ' @task(20, 1)\n def slow(self, readings): return 7, 0\n'
    )
    run = start_run(
        'stationary', '--processes=one', '--controller', 'slow.py:Mine',
        '--set', 'plant_sim.lockstep=false',
        '--set', 'plant_sim.duration=1', '--real-time-factor', '1', '--output', 'run', '--json',
    )  # fmt: skip
    run.finish()
    assert run.result['outcome'] != 'failed', run.stderr
    with RecordingReader(Path('run/stationary.mcap')) as reader:
        duties = [message.vector.x for _, _, message in reader.messages(['/motor_duty'])]
    assert duties.count(7.0) > len(duties) / 2


@pytest.mark.graph
def test_a_fault_ends_a_free_running_graph(start_run, folder):
    run = start_run(
        'stationary', '--controller', 'faulty.py:Raises',
        '--set', 'plant_sim.lockstep=false', '--real-time-factor', '1', '--output', 'run', '--json',
    )  # fmt: skip
    assert run.finish() == 1, run.stderr
    assert run.result['outcome'] == 'failed'
    assert 'ZeroDivisionError' in run.result['reason']
    assert run.result['ticks'] < 2000
    assert run.stderr.count('ZeroDivisionError') < 5
    _, duty, _ = last_duty(Path('run', 'stationary.mcap'))
    assert duty == (0.0, 0.0)


def test_the_code_that_the_run_was_composed_with_runs_and_is_attached(folder):
    options = RunOptions(processes=Processes.NONE, controller='balance.py:Balance')
    spec = RunSpec.of_scenario('stationary', options)
    Path('balance.py').write_text('raise SystemExit')
    result = execute(spec, Notices())
    assert result.exit_status == 0, result.reason
    with RecordingReader(result.recording) as reader:
        assert reader.attachments()['controller.py'].data.decode() == BALANCE


def test_no_folder_of_the_machine_is_recorded(folder, tmp_path_factory, monkeypatch):
    monkeypatch.chdir(tmp_path_factory.mktemp('elsewhere'))
    options = RunOptions(
        processes=Processes.NONE, controller=f'{folder}/faulty.py:Raises', output=Path('run')
    )
    result = execute(RunSpec.of_scenario('stationary', options), Notices())
    assert result.reason.startswith('controller: faulty.py:')
    assert str(folder).encode() not in result.recording.read_bytes()
    with RecordingReader(result.recording) as reader:
        files = reader.attachments().values()
    assert not any(str(folder).encode() in file.data for file in files)


def test_an_interrupted_import_is_no_traceback(folder, command):
    Path('broken.py').write_text('raise SystemError("\\n\\x1b no")\n')
    found = command('run', 'stationary', '--controller', 'broken.py:Mine', '--processes=none')
    assert found == (2, '', 'error: broken.py:1: SystemError: no\n')


def test_what_a_class_prints_when_it_is_loaded_is_not_the_result(folder):
    Path('loud.py').write_text(f"print('loaded')\n{BALANCE}")
    words = [*BALLBOT, 'run', 'stationary', '--processes=none', '--no-record', '--json']
    words += ['--controller=loud.py:Balance', '--set=plant_sim.duration=0.1']
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert json.loads(done.stdout)['ticks'] == 25
    assert 'loaded' in done.stderr
    words = [*BALLBOT, 'design', '--controller=loud.py:Balance']
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.stdout.startswith('# ballbot design --controller=loud.py:Balance\n/**/controller:')
