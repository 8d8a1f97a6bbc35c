"""`ballbot codegen` and `ballbot run --controller`."""

import json
import re
import shutil
from pathlib import Path

import pytest
from generated import SHORT as SHORT_PHASES
from generated import need
from graph import call, record

from ballbot_ros.cli import codegen
from ballbot_ros.controllers.codegen.application import program_sha256
from ballbot_ros.controllers.codegen.programs import BALANCE
from ballbot_ros.engine import scenario_steps
from ballbot_ros.errors import CodegenError
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.files import read_parameter_file
from ballbot_ros.recording.reader import RecordingReader

SHORT = ('--set=plant_sim.duration=2.0', '--set=gyro_driver.noise=0.7')


@pytest.fixture
def few_sequences(monkeypatch):
    monkeypatch.setattr(scenario_steps, 'RANDOM_SEQUENCES', 2)
    monkeypatch.setattr(scenario_steps, 'RANDOM_TICKS', 50)
    monkeypatch.setattr(scenario_steps, 'scenario_names', lambda: ['stationary'])


@pytest.fixture
def parameters(tmp_path):
    """A parameter file with a short calibration."""
    path = tmp_path / 'parameters.yaml'
    path.write_text('/**/controller:\n  ros__parameters: {k_i: -0.008, time_start: 100}\n')
    return path


def test_it_writes_the_folder(tmp_path, parameters):
    folder = tmp_path / 'my c'
    done = call('codegen', '--output', folder, '--params', parameters, '--mode', 'autonomous')
    assert done.returncode == 0, done.stderr
    text = (folder / 'ballbot_parameters.c').read_text()
    assert 'const float k_i = -0.008f;' in text
    assert 'const U8 autonomous = 1U;' in text
    *files, last = done.stdout.splitlines()
    for line in files:
        assert line.startswith(str(folder))
    assert last.endswith(f"check with: ballbot codegen --check '{folder}'")


def test_it_warns_of_gains_that_do_not_bear_a_brick_and_names_others(tmp_path):
    done = call('codegen', '--output', tmp_path / 'a')
    assert done.returncode == 0, done.stderr
    warning, remedies = done.stderr.splitlines()[:2], done.stderr.splitlines()[2:]
    assert warning == [
        'warning: with these gains the loop bears 3.5 ms of dead time, but link and tasks',
        'of a brick take 4.8 ms on average: the robot will rattle',
    ]
    files = []
    for each in remedies:
        borne, file = re.fullmatch(r'gains that bear ([0-9.]+) ms: --params (.+)', each).groups()
        assert float(borne) > 20.0
        files.append(Path(file))
        done = call('codegen', '--output', tmp_path / files[-1].stem, '--params', file)
        assert (done.returncode, done.stderr) == (0, '')
    assert [each.stem for each in files] == ['quiet', 'tuned']


@pytest.mark.parametrize(('log_count', 'period'), [(1, '4 ms'), (4, '16 ms'), (5, '')])
def test_it_warns_of_log_packets_that_a_real_link_may_not_bear(
    tmp_path, monkeypatch, capsys, log_count, period
):
    monkeypatch.setattr(codegen, '_warn_of_dead_time', lambda parameters: None)
    path = tmp_path / 'parameters.yaml'
    path.write_text(f'/**/controller:\n  ros__parameters: {{log_count: {log_count}}}\n')
    codegen.generate(tmp_path / 'c', BALANCE, path, None)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == bool(period)
    for line in lines:
        words = f'controller.log_count {log_count}: a log packet every {period}, below 20 ms, can'
        assert line.startswith(f'warning: {words}')
        assert 'nxtOSEK user' in line


def test_it_uses_the_parameters_of_a_recorded_run(tmp_path):
    path, _ = record(
        tmp_path, 'stationary', '--set=plant_sim.duration=1.2', '--set=controller.k_i=-0.008'
    )
    done = call('codegen', '--output', tmp_path / 'c', '--params', path)
    assert done.returncode == 0, done.stderr
    assert 'const float k_i = -0.008f;' in (tmp_path / 'c/ballbot_parameters.c').read_text()


def test_it_writes_the_commissioning_program_and_checks_it(command, tmp_path, monkeypatch):
    need('c')
    need('arm')
    monkeypatch.chdir(tmp_path)
    values = ', '.join(f'user.{name}: {value}' for name, value in SHORT_PHASES.items())
    Path('mine.yaml').write_text(f'controller: {{ros__parameters: {{{values}}}}}\n')
    words = ('--output', 'c', '--program', 'commissioning', '--params', 'mine.yaml')
    status, _, errors = command('codegen', *words)
    assert (status, errors) == (0, '')
    status, output, _ = command('codegen', '--check', 'c')
    assert status == 0, output
    assert output.count(': 679 ticks of 1 sequences') == 2
    assert 'task_ts1' in output
    assert 'times.yaml' not in output
    Path('mine.yaml').write_text('controller: {ros__parameters: {user.rest_tim: 1.0}}\n')
    status, _, errors = command('codegen', *words)
    assert status == 2
    assert 'rest_tim' in errors
    assert 'did you mean' in errors


def test_an_untouched_folder_is_equal_and_is_measured(tmp_path, parameters, few_sequences, capsys):
    need('c')
    need('arm')
    codegen.generate(tmp_path / 'c', BALANCE, parameters, None)
    assert codegen.check(tmp_path / 'c') == 0
    text = capsys.readouterr().out
    for loop in ('software in the loop (this machine)',
                 'processor in the loop (ARM7TDMI, emulated)'):  # fmt: skip
        assert f'equal    {loop}: 3050 ticks of 4 sequences' in text
    counts = {
        words[1]: int(words[3])
        for words in map(str.split, text.splitlines())
        if len(words) > 3 and words[1].startswith('task_')
    }
    assert list(counts) == ['task_init', 'task_ts1', 'task_ts2', 'task_ts3', 'task_lcd']
    # Two planes with about thirty soft-float operations each, of at least ten instructions.
    assert 2000 < counts['task_ts1'] < 20000
    assert 100 < counts['task_ts3'] < 2000
    sizes = {name: int(size) for name, size in re.findall(r'(\w+) (\d+) B\b', text)}
    assert sizes['stacks'] == 5 * 512
    sections = [sizes[name] for name in ('text', 'rodata', 'data', 'bss', 'stacks')]
    code, constants, data, cleared, stacks = sections
    rxe = f'As an RXE or RAM image: SRAM {sum(sections)} B of 65536'
    assert rxe in text
    rom = f'SRAM {data + cleared + stacks} B of 65536'
    assert rom in text
    assert f'flash {code + constants + data} B of 229376' in text
    times = tmp_path / 'c/times.yaml'
    assert text.splitlines()[-1] == str(times)
    written = read_parameter_file(times).of(ControllerParameters)
    assert {
        'task_init': written.init_instructions,
        'task_ts1': written.control_instructions + written.log_instructions,
        'task_ts2': written.obstacle_instructions,
        'task_ts3': written.state_instructions + written.tone_instructions,
        'task_lcd': written.display_instructions,
    } == counts
    assert written.times_of == program_sha256()[:16]


@pytest.mark.parametrize(
    ('file', 'right', 'wrong', 'what'),
    [
        ('ballbot_parameters.c', 'k_i = -0.008f', 'k_i = -0.0080001f', 'duty|sum|theta|psi'),
        ('ballbot_controller.c', '(1.0f - a_r)', '(1.001f - a_r)', r'theta_ref_dot'),
        ('ballbot_controller.c', '? vertical : -vertical', '? vertical : vertical', 'theta_ref'),
        ('ballbot.oil', 'CYCLETIME = 100;', 'CYCLETIME = 200;', 'battery|control_mode'),
    ],
)
def test_a_folder_that_was_edited_differs(
    tmp_path, parameters, few_sequences, capsys, file, right, wrong, what
):
    need('c')
    codegen.generate(tmp_path / 'c', BALANCE, parameters, None)
    path = tmp_path / 'c' / file
    text = path.read_text()
    assert right in text
    path.write_text(text.replace(right, wrong))
    assert codegen.check(tmp_path / 'c') == 1
    printed = capsys.readouterr().out
    assert 'DIFFERS' in printed
    assert ' in C and ' in printed


def test_a_program_that_makes_invalid_device_calls_is_refused(tmp_path, parameters, few_sequences):
    need('c')
    codegen.generate(tmp_path / 'c', BALANCE, parameters, None)
    path = tmp_path / 'c/ballbot_controller.c'
    path.write_text(path.read_text().replace('#define BRAKE 1', '#define BRAKE 0'))
    with pytest.raises(CodegenError, match='made invalid device calls: faults 0x2'):
        codegen.check(tmp_path / 'c')


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        ((), ['either --output DIR or --check DIR']),
        (('--output', 'a', '--check', 'b'), ['either --output DIR or --check DIR']),
        (('--check', 'b', '--mode', 'remote'), ['--mode require --output']),
        (('--check', 'b', '--program', 'balance'), ['--program', 'require --output']),
        (('--output', 'a', '--program', 'balanc'), ['balanc', 'commissioning']),
        (('--output', 'a', '--program', 'commissioning', '--mode', 'remote'), ['does not drive']),
        (('--output', 'a', '--mode', 'flying'), ['flying', 'autonomous']),
        (('--output', 'a', '--params', 'none.yaml'), ['none.yaml']),
        (('--check', 'nowhere'), ['nowhere', 'not found']),
        (('--output', '/dev/null/c'), ['/dev/null/c', 'Not a directory']),
    ],
)
def test_a_mistake_is_reported_in_one_line(tmp_path, monkeypatch, command, arguments, words):
    monkeypatch.chdir(tmp_path)
    status, _, errors = command('codegen', *arguments)
    assert status == 2
    [line] = errors.splitlines()
    for word in words:
        assert word in line
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def tools(tmp_path):
    """Return a folder for PATH that contains some commands only."""

    def make(*commands):
        folder = tmp_path / 'bin'
        folder.mkdir()
        for command in commands:
            (folder / command).symlink_to(shutil.which(command))
        return str(folder)

    return make


def test_without_compiler_a_run_names_the_package(tools, tmp_path, monkeypatch):
    monkeypatch.setenv('PATH', tools())
    words = ('--processes=none', '--controller=c', '--output', tmp_path / 'run')
    done = call('run', 'stationary', *words)
    assert done.returncode == 2
    assert done.stderr == 'error: gcc not found: install it with `apt install gcc`\n'
    assert not (tmp_path / 'run').exists()


@pytest.mark.parametrize(
    ('there', 'package'),
    [((), 'gcc-arm-none-eabi'), (('arm-none-eabi-gcc',), 'qemu-user')],
)
def test_without_arm_tools_a_run_names_the_package(tools, there, package, monkeypatch):
    if there:
        need('arm')
    monkeypatch.setenv('PATH', tools(*there))
    done = call('run', 'stationary', '--processes=none', '--controller=arm', '--no-record')
    assert done.returncode == 2
    assert done.stderr.endswith(f'install it with `apt install {package}`\n')


def test_a_check_that_could_not_run_does_not_count_as_passed(
    tmp_path, parameters, few_sequences, tools, monkeypatch, capsys
):
    need('c')
    codegen.generate(tmp_path / 'c', BALANCE, parameters, None)
    monkeypatch.setenv('PATH', tools('gcc', 'as', 'ld'))
    with pytest.raises(CodegenError, match='processor in the loop was not checked: arm-none-eabi'):
        codegen.check(tmp_path / 'c')
    text = capsys.readouterr().out
    assert 'equal' in text
    assert 'skipped' in text
    assert 'install it with `apt install gcc-arm-none-eabi`' in text
    assert not (tmp_path / 'c/times.yaml').exists()


def result_of(run):
    assert run.finish() in (0, 1), run.stderr  # such a short run may miss the expectations
    assert run.result['ticks'] == 500
    return run.result['duty_sha256'], run.result['recording']


def messages(path):
    """Return the controller's messages by topic, in order."""
    topics = ('controller/state', 'motor_duty', 'operating_state', 'bluetooth/tx', 'sound', 'lcd')
    with RecordingReader(path) as reader:
        found = {topic: [] for topic in topics}
        for message in reader.raw_messages():
            topic = message.topic.lstrip('/')
            if topic in found:
                # The middleware pads a message to full words.
                found[topic].append(message.data + bytes(-len(message.data) % 4))
    return found


@pytest.fixture(scope='module')
def python_run(tmp_path_factory):
    """The recording of a run with the controller in Python, and its result."""
    return record(tmp_path_factory.mktemp('python'), 'stationary', *SHORT)


@pytest.mark.graph
@pytest.mark.parametrize(
    ('processes', 'controller'),
    [('none', 'arm'), ('one', 'c'), ('separate', 'arm')],
)
def test_the_compiled_controller_changes_neither_run_nor_recording(
    start_run, tmp_path, python_run, processes, controller
):
    need(controller)
    recording, python = python_run
    run = start_run('stationary', f'--processes={processes}', '--json', *SHORT,
                    '--output', tmp_path / controller, f'--controller={controller}')  # fmt: skip
    sha256, compiled = result_of(run)
    assert sha256 == python['duty_sha256']
    found = messages(compiled)
    for topic, expected in messages(recording).items():
        assert expected, topic
        assert found[topic] == expected, topic


@pytest.mark.graph
def test_a_node_takes_its_implementation_from_a_parameter_and_names_a_missing_tool(
    start_node, tools, monkeypatch
):
    monkeypatch.setenv('PATH', tools())
    node = start_node('controller', implementation='c')
    assert node.finish() == 2
    assert node.output == 'error: gcc not found: install it with `apt install gcc`\n'


@pytest.mark.graph
def test_a_node_refuses_an_unknown_implementation(start_node):
    node = start_node('controller', implementation='rust')
    assert node.finish() == 2
    assert "no controller 'rust': give one of python, c, arm" in node.output


def test_the_json_of_the_result_differs_only_in_the_speed(tmp_path):
    need('c')
    results = []
    for name in ('python', 'c'):
        done = call('run', 'stationary', '--processes=none', '--no-record', '--json',
                       f'--controller={name}')  # fmt: skip
        result = json.loads(done.stdout)
        assert result['controller'] == {'name': name, 'sha256': None, 'portable': True}
        results.append({**result, 'real_time_factor': None, 'engine': None, 'controller': None})
    assert results[0] == results[1]
