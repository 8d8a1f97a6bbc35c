"""The jobs of a recorded run: described, exported, read and replayed."""

import csv

import pytest
from graph import record

from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.recording.messages.topics import BRICK_TASKS
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.schemas import encoder, new_message
from ballbot_ros.recording.writer import RecordingWriter

TIMED = ('--set=plant_sim.kernel=true', '--set=plant_sim.link=true')


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp('timed')
    return record(folder, 'stationary', *TIMED, '--set=plant_sim.duration=2.25')[0]


def test_info_lists_them(recording, command):
    status, output, errors = command('info', recording)
    assert (status, errors) == (0, '')
    (line,) = (line.split() for line in output.splitlines() if '/brick/tasks' in line)
    assert line == ['/brick/tasks', 'std_msgs/msg/Int64MultiArray', '22', '10.00', 'Hz',
                    '0.100', 's', '1.096', 's']  # fmt: skip


def test_tables_have_a_row_per_job(recording, command, tmp_path):
    status, _, errors = command('export', recording, '--to', 'csv', '--output', tmp_path)
    assert (status, errors) == (0, '')
    with (tmp_path / 'brick_tasks.csv').open(newline='') as file:
        rows = list(csv.DictReader(file))
    jobs = read_run(recording).jobs
    assert rows[0] == {
        'time_s': '1.096', 'task': 'task_init', 'release_us': '1000000', 'start_us': '1000012',
        'end_us': '1000028', 'preempted_us': '0', 'is_lost': 'False',
    }  # fmt: skip
    assert [row['task'] for row in rows] == [jobs.tasks[number] for number in jobs.task]
    for name in ('release', 'start', 'end', 'preempted'):
        assert [int(row[f'{name}_us']) for row in rows] == getattr(jobs, name).tolist()
    assert [row['is_lost'] for row in rows] == [str(each) for each in jobs.is_lost.tolist()]


def test_the_joined_table_leaves_them_out(recording, command, tmp_path):
    command('export', recording, '--to', 'csv', '--joined', '--output', tmp_path)
    header = (tmp_path / 'joined.csv').read_text().partition('\n')[0]
    assert 'motor_duty_x_percent' in header
    assert 'brick' not in header


def test_a_malformed_message_is_named(command, tmp_path):
    path = tmp_path / 'strange.mcap'
    with RecordingWriter(path) as writer:
        topic = writer.add_topic('/brick/tasks', BRICK_TASKS.type_name)
        message = new_message(BRICK_TASKS.type_name)
        writer.write(topic, 10**9, encoder(BRICK_TASKS.type_name)(message), 1)
    status, _, errors = command('export', path, '--to', 'csv')
    assert status == 2
    assert '/brick/tasks at 1.000 s: its dimensions [] are not those of jobs' in errors
    assert not (tmp_path / 'strange_csv').exists()


def test_a_replay_compares_them(recording, command):
    status, output, errors = command('replay', recording)
    assert (status, errors) == (0, '')
    assert output.count('identical') == 2
    status, output, errors = command(
        'replay', recording, '--set', 'controller.control_instructions=9000'
    )
    assert (status, errors) == (0, '')
    assert 'run 1: jobs differ, first at sim time 2.096 s, /brick/tasks: data[27]' in output
    assert 'run 1: the same duties' in output


def test_a_run_whose_tasks_take_no_time_has_none(tmp_path, command):
    path, _ = record(tmp_path, 'stationary', '--set=plant_sim.duration=0.4')
    with RecordingReader(path) as reader:
        assert '/brick/tasks' not in reader.topics()
    run = read_run(path)
    assert run.jobs is None
    assert run.notices == ()
    assert 'jobs' not in command('replay', path, '--set', 'controller.k_i=0')[1]
