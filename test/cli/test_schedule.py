"""`ballbot schedule`: the tasks as a table and as JSON, estimates, warnings, and refusals."""

import json

import pytest

from ballbot_ros.engine import brick_schedule

OVERLOADED = '--set', 'controller.processor_clock=9'


def shown(command, *arguments):
    status, stdout, stderr = command('schedule', *arguments)
    assert (status, stderr) == (0, '')
    return stdout


def content(command, *arguments):
    return json.loads(shown(command, '--json', *arguments))


def cells(text, name):
    """Return the cells of a row of the table."""
    (row,) = [line for line in text.splitlines() if line.startswith(f'│ {name} ')]
    return [cell.strip() for cell in row.strip('│').split('│')][1:]


@pytest.fixture
def takes(monkeypatch):
    """Let the jobs of any controller take this time on this machine [µs]."""

    def take(time_us):
        monkeypatch.setattr(brick_schedule, 'measured_time', lambda *_: time_us)

    return take


def test_the_table_has_a_row_for_each_task_and_the_shares_add_up(command):
    text = shown(command)
    assert cells(text, 'task_ts1') == ['4', '4', '339', '7.1%', '367', '367', '0']
    assert cells(text, 'task_init')[1] == 'once'
    assert cells(text, 'interrupts') == ['', '1', '12', '17.0%', '', '', '']
    assert cells(text, 'all')[3] == '25.1%'
    assert 'Simulated: 20 s; all alarms start together.' in text
    assert 'Switched off in runs with these parameters: controller.kernel, controller.link.' in text
    assert max(map(len, text.splitlines())) <= 80


def test_json_has_what_the_table_has(command):
    text, found = shown(command, '--profile', 'hardware'), content(command, '--profile', 'hardware')
    assert [task['name'] for task in found['tasks']] == [
        'task_init', 'task_ts1', 'task_ts2', 'task_ts3', 'task_lcd',
    ]  # fmt: skip
    for task in found['tasks']:
        assert cells(text, task['name']) == [
            str(task['priority']), str(task['period_ms'] or 'once'), str(task['time_us']),
            f'{task["share"]:.1%}', str(task['worst_us']), str(task['simulated_us']), '0',
        ]  # fmt: skip
    shares = [found['interrupt_share'], *(task['share'] for task in found['tasks'])]
    assert found['load'] == pytest.approx(sum(shares))
    assert (found['estimate'], found['tick_time'], found['warnings']) == (None, None, [])


def test_a_run_with_kernel_and_link_leaves_out_nothing(command, tmp_path):
    file = tmp_path / 'brick.yaml'
    file.write_text('plant_sim: {ros__parameters: {kernel: true, link: true}}\n', encoding='utf-8')
    assert 'Switched off' not in shown(command, '--params', file)
    found = content(command, '--params', file, '--set', 'controller.link=false')
    assert found['switched_off'] == ['controller.link']


def test_with_the_defect_limits_are_marked(command):
    text = shown(command, '--set', 'controller.kernel_defect=true')
    assert cells(text, 'task_ts3')[4:6] == ['≤ 1594', '1594']
    assert '≤: at most; alarms that are lost, or late by the defect, take load away.' in text


def test_the_declared_time_of_a_controller_is_used(command):
    found = content(command, '--controller', 'pid', '--set', 'controller.tick_time=3200')
    (task,) = found['tasks']
    assert (task['name'], found['tick_time'], found['estimate']) == ('tick', 3200.0, None)
    assert task['time_us'] == 3809  # with the interrupts of the bus


def test_a_measured_time_is_marked_as_an_estimate(command, takes):
    takes(31.0)
    words = '--controller', 'pid', '--measure', '40'
    text, found = shown(command, *words), content(command, *words)
    assert cells(text, 'tick')[2] == '≈ 1476'
    assert (
        '≈: estimate: 31 µs on this machine × 40; to declare it: --set controller.tick_time=1240'
    ) in text
    assert found['estimate'] == '31 µs on this machine × 40'
    declared = content(command, '--controller', 'pid', '--set', 'controller.tick_time=1240')
    assert found['tasks'] == declared['tasks']


def test_a_controller_is_measured_whatever_time_it_declares(command):
    found = content(
        command, '--controller', 'pid', '--measure', '0.1',
        '--set', 'controller.kernel=true', '--set', 'controller.tick_time=5000',
    )  # fmt: skip
    assert 0.0 < found['tick_time'] < 5000.0


def test_a_deadline_that_can_be_missed_is_warned_of(command):
    words = '--set', 'controller.control_instructions=70000', '--set', 'controller.bus_cycles=0'
    text = shown(command, *words, '--set', 'controller.time_variation=0.6')
    assert cells(text, 'task_ts2')[4] == '∞'
    warnings = [line for line in text.splitlines() if line.startswith('warning: ')]
    assert len(warnings) == 6
    assert warnings[0].startswith('warning: task_ts1 may end 4')
    for name, line in zip(('ts2', 'ts3', 'lcd'), warnings[1:4], strict=True):
        assert line.startswith(f'warning: task_{name} may end any time after its alarm, beyond its')
    for line in warnings[4:]:
        assert line.startswith('warning: task_ts1 may set its duty 4')


@pytest.mark.parametrize(
    ('arguments', 'problem'),
    [
        (['--controller', 'pid', '--set', 'controller.tick_time=0'], 'controller.tick_time: 0 µs;'),
        (OVERLOADED, 'controller: at 9 MHz the interrupts need 91% of the processor and the tasks'),
        (['--controller', 'pid', *OVERLOADED], 'of the processor and the tasks 67%, together more'),
        (['--set', 'controller.ts2_period=0'], 'controller.ts2_period: 0 is not one of 4, 20, 100'),
        (['--set', 'controller.times_of=abc'], 'abc is another program than the document, which'),
        (['--set', 'controller.link_time=20'], 'link_time: longer than interrupt_time'),
        (['--profile', 'hrdware'], 'did you mean hardware?'),
        (['--measure', '40'], "--measure: needs a --controller other than the document's"),
        (['--controller', 'pid', '--measure', '0'], '0.0 is not in the range'),
        (['--controller', 'pid', '--measure', 'nan'], "'nan' is not a number"),
        (['--controller', 'pid', '--measure', '1e5'], '--measure: 31 µs on this machine × 100000'),
        (['--controller', 'pid', '--measure', '200'], '200: controller: at 48.055 MHz the interr'),
    ],
)
def test_mistakes_are_refused_on_one_line(command, takes, arguments, problem):
    takes(31.0)
    status, stdout, stderr = command('schedule', *arguments)
    assert (status, stdout) == (2, '')
    assert problem in stderr
    assert stderr.count('\n') == 1


@pytest.mark.parametrize(
    ('period_ms', 'body', 'problem'),
    [
        (0, 'return 0, 0', 'the period 0 ms is not a multiple of 4 ms'),
        (4, 'return 1 // 0, 0', 'ZeroDivisionError'),
    ],
)
def test_mistakes_of_an_own_controller_are_refused_on_one_line(
    command, tmp_path, period_ms, body, problem
):
    file = tmp_path / 'mine.py'
    file.write_text(
        'from ballbot_ros.controllers import Controller, task\n\n\n'
        'class Mine(Controller):\n'
        f'    @task({period_ms}, 1)\n'
        f'    def step(self, readings):\n        {body}\n',
        encoding='utf-8',
    )
    status, stdout, stderr = command('schedule', '--controller', f'{file}:Mine', '--measure', '3')
    assert (status, stdout) == (2, '')
    assert problem in stderr
    assert stderr.count('\n') == 1
