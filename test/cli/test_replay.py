"""`ballbot replay`: identical, or the first difference."""

import dataclasses
import json
import math
import re
import struct
from pathlib import Path

import graph
import pytest
from golden_runs import WITHOUT_FMA
from graph import Run, call, free_domain
from recordings import copy_recording

from ballbot_ros.analysis.message_comparison import MessageDifference
from ballbot_ros.analysis.recorded_controller import ReplayedController
from ballbot_ros.analysis.recording_replay import RecordingReplay, ReplayResult
from ballbot_ros.analysis.replay import read_inputs
from ballbot_ros.cli.replay import print_results
from ballbot_ros.controllers.codegen.implementation import missing_tool_for
from ballbot_ros.engine import compiled_loop
from ballbot_ros.engine.scenario.reader import scenario_names
from ballbot_ros.recording.messages.conversions import fill_header, fill_time
from ballbot_ros.recording.messages.run_reports import encode_parameter_event
from ballbot_ros.recording.messages.topics import PARAMETER_EVENTS
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.schemas import encoder, new_message
from ballbot_ros.recording.writer import RecordingWriter


def replay(*arguments):
    return call('replay', *arguments)


def record(folder, scenario, *arguments):
    with free_domain() as domain:
        run = Run(domain, scenario, '--json', '--output', folder, *arguments)
        assert run.finish() in (0, 1), run.stderr
    return run.result['recording']


@pytest.fixture(scope='module')
def push(tmp_path_factory):
    """The scenario push for 4.5 s, with noise of the gyro and without a graph."""
    words = ('--set=plant_sim.duration=4.5', '--set=gyro_driver.noise=0.7')
    return str(graph.record(tmp_path_factory.mktemp('push'), 'push', *words)[0])


def copy(recording, path, change, also=()):
    """Copy a recording; `change` takes topic, stamp and data, and returns data, or None to drop it.

    The messages `also`, given as topic, stamp and data, come first.
    """

    def edit(raw, _):
        return change(raw.topic, raw.stamp_ns, raw.data)

    return copy_recording(path, recording, edit=edit, first=also)


AT_WALLS = ('autonomous', 'hardware_autonomous', 'remote_wall')
"""Scenarios whose robots react to a wall, within 7 s; sticks and pushes begin within 3 s."""


@pytest.mark.parametrize('name', scenario_names())
def test_every_shipped_scenario_is_identical(tmp_path, name):
    seconds = 8 if name in AT_WALLS else 4
    short = ('--processes=none', f'--set=plant_sim.duration={seconds}', '--output', tmp_path)
    assert call('run', name, *short).returncode in (0, 1)
    done = replay(tmp_path / f'{name}.mcap', '--json')
    assert done.returncode == 0, done.stdout + done.stderr
    controller, robot = json.loads(done.stdout)
    assert controller['identical']
    assert robot['identical']
    assert controller['ticks'] == robot['ticks'] == 250 * seconds


@pytest.mark.parametrize('name', ['stationary', 'hardware_autonomous'])
def test_a_recording_of_another_processor_is_identical(tmp_path, monkeypatch, name):
    with monkeypatch.context() as there:
        there.setenv('OPENBLAS_CORETYPE', 'Nehalem')
        there.setenv('GLIBC_TUNABLES', WITHOUT_FMA['GLIBC_TUNABLES'])
        recording = record(tmp_path, name, '--processes=none', '--set=plant_sim.duration=4')
    done = replay(recording)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count('identical, 1000 ticks') == 2


@pytest.mark.graph
def test_a_run_of_the_graph_is_identical(tmp_path):
    recording = record(tmp_path, 'hardware_autonomous', '--set=plant_sim.duration=2')
    done = replay(recording)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count('identical, 500 ticks') == 2
    assert done.stderr == ''


def replayed_by_both(recording, monkeypatch):
    """Replay by compiled code and by the interpreter; return both results and their engines."""
    monkeypatch.setattr(compiled_loop, 'has_kept_code', lambda name: True)
    results = []
    for least in (0, math.inf):
        monkeypatch.setattr(compiled_loop, 'MIN_TICKS', least)
        monkeypatch.setattr(compiled_loop, 'is_loaded', lambda function: False)
        done = replay(recording, '--json')
        found = json.loads(done.stdout)
        engines = [each.pop('engine') for each in found]
        results.append((engines, done.returncode, found))
    return results


@pytest.mark.parametrize(
    ('scenario', 'words'),
    [
        ('push', ['plant_sim.duration=5']),
        ('hardware_forward_backward', ['plant_sim.duration=6', 'gyro_driver.delay=3']),
        ('remote_wall', ['plant_sim.on_wall_hit=stop']),
        ('push', ['plant_sim.duration=5', 'controller.implementation=pid']),
        ('push', ['plant_sim.duration=4.03', 'plant_sim.kernel=true', 'plant_sim.link=true']),
        (
            'push',
            [
                'plant_sim.duration=4',
                'plant_sim.kernel=true',
                'gyro_driver.faults=gyro_x stuck time=2 duration=0.05; gyro_y delayed amount=5',
                'plant_sim.faults=brick restart time=2.5 duration=0.1; motor_x weak time=2',
            ],
        ),
        (
            'square',
            [
                'plant_sim.duration=5',
                'gamepad_teleop.faults=gamepad delayed',
                'encoder_driver.faults=encoder_x slow time=3',
            ],
        ),
    ],
)
def test_compiled_and_interpreted_replays_have_the_same_result(
    tmp_path, monkeypatch, scenario, words
):
    pytest.importorskip('numba')
    recording = graph.record(tmp_path, scenario, *(f'--set={each}' for each in words))[0]
    compiled, interpreted = replayed_by_both(recording, monkeypatch)
    assert compiled == (['compiled'] * 2, 0, interpreted[2])
    assert interpreted[:2] == (['interpreted'] * 2, 0)


def test_they_tell_the_same_difference(push, two_plants, tmp_path, monkeypatch):
    pytest.importorskip('numba')

    def change(topic, stamp, data):
        if (topic, stamp) == ('/gyro', 2_104_000_000):
            return data[:-184] + struct.pack('<d', math.radians(640.0)) + data[-176:]
        return None if (topic, stamp) == ('/bluetooth/tx', 3_004_000_000) else data

    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(Path(push).read_bytes()[:-100_000])
    for path, status in ((copy(push, tmp_path / 'changed.mcap', change), 1), (cut, 0)):
        compiled, interpreted = replayed_by_both(path, monkeypatch)
        # What the controller does with these samples has to be replayed.
        assert compiled == (['interpreted', 'compiled'], status, interpreted[2]), path
    compiled, interpreted = replayed_by_both(two_plants(), monkeypatch)
    assert compiled[1:] == (0, interpreted[2])


def test_changed_parameters_and_several_inputs_are_interpreted(push, tmp_path, monkeypatch):
    pytest.importorskip('numba')

    def change(topic, stamp, data):
        is_other = topic == '/gamepad' and stamp > 3_000_000_000
        return data.replace(b'scenario', b'operator') if is_other else data

    several = copy(push, tmp_path / 'several.mcap', change)
    tuned = retuned(push, tmp_path / 'tuned.mcap', {3_204_000_000: {'dst_thr': 31}})
    for path in (several, tuned):
        compiled, _ = replayed_by_both(path, monkeypatch)
        assert compiled[:2] == (['interpreted'] * 2, 0), path


def test_an_identical_robot_has_an_identical_controller(push, tmp_path):
    file = tmp_path / 'mine.py'
    file.write_text('from ballbot_ros.controllers.pid import PID\nclass Mine(PID): pass\n')
    short = '--set=plant_sim.duration=2'
    by_pid, own = (
        graph.record(tmp_path / name, 'push', short, f'--controller={controller}')[0]
        for name, controller in (('pid', 'pid'), ('own', f'{file}:Mine'))
    )
    for path, controller in ((push, None), (by_pid, None), (own, f'{file}:Mine')):
        with RecordingReader(path) as reader:
            replay = RecordingReplay(reader, tmp_path, controller)
            robot = replay.replay_robot(lambda time: None)
            alone = replay.replay_controller(lambda time: None)
            follows = dataclasses.replace(alone, engine=robot.engine)
            assert robot.difference is None
            # A user's class may depend on more than the samples.
            assert replay.controller_in_robot == (None if path == own else follows)


@pytest.mark.parametrize(
    'assignment', ['plant_sim.map=track', 'controller.nothing=1', 'controller.k_i=x']
)
def test_only_the_parameters_of_the_controller_can_be_varied(push, assignment):
    done = replay(push, '--set', assignment)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert assignment.partition('=')[0].rpartition('.')[2] in done.stderr


def test_one_bit_in_one_duty_is_found_at_its_tick(push, tmp_path):
    def change(topic, stamp, data):
        if topic == '/motor_duty' and stamp == 3_404_000_000:
            return data[:-20] + bytes([data[-20] ^ 1]) + data[-19:]
        return data

    done = replay(copy(push, tmp_path / 'changed.mcap', change), '--json')
    assert done.returncode == 1
    for each in json.loads(done.stdout):
        assert not each['identical']
        assert each['first_difference']['sim_time_s'] == pytest.approx(3.404)
        assert each['first_difference']['topic'] == 'motor_duty'


def test_a_changed_sample_is_distinguished_from_a_wrong_duty(push, tmp_path):
    def change(topic, stamp, data):
        if topic == '/gyro' and stamp == 2_104_000_000:
            with RecordingReader(push) as reader:
                other = next(
                    m for m in reader.raw_messages(['/gyro']) if m.stamp_ns > 2_900_000_000
                )
            # Keep the stamp of this tick, with the reading of another one.
            return data[:12] + other.data[12:]
        return data

    done = replay(copy(push, tmp_path / 'changed.mcap', change))
    assert done.returncode == 1
    controller, robot = (
        line for line in done.stdout.splitlines() if line.startswith(('controller', 'robot'))
    )
    assert '/motor_duty' in controller or '/controller/state' in controller
    assert 'differs first at sim time 2.104 s, /gyro' in robot
    assert 'recorded inputs' in done.stdout


@pytest.mark.parametrize(
    ('name', 'byte', 'bit', 'told'),
    [
        ('/motor_duty', 27, 6, 'infinity'),  # the exponent of ±1
        ('/gamepad', 28, 1, 'not a valid sensor_msgs/msg/Joy'),  # two axes become none
        ('/gyro', 15, 6, 'Invalid string length'),
        ('/sonar', 38, 7, 'not within 0 … 255'),  # no echo becomes 1.7e38 m
    ],
)
def test_an_impossible_input_is_reported_in_one_line(push, tmp_path, name, byte, bit, told):
    with RecordingReader(push) as reader:
        stamps = [
            stamp
            for _, stamp, message in reader.messages([name])
            if (abs(message.vector.x) == 1.0 if name == '/motor_duty' else stamp % 10**8 == 0)
        ]

    def change(topic, stamp, data):
        if (topic, stamp) == (name, stamps[-1]):
            return data[:byte] + bytes([data[byte] ^ 1 << bit]) + data[byte + 1 :]
        return data

    path = copy(push, tmp_path / 'changed.mcap', change)
    done = replay(path)
    assert done.returncode == 2
    assert re.search(told, done.stderr)
    assert str(path) in done.stderr
    assert f' at {stamps[-1] // 10**8}' in done.stderr


@pytest.fixture
def push_by(push, tmp_path):
    """Return the same run as if another implementation of the controller had recorded it."""

    def change(name):
        was, now = (f'implementation: {each}\n'.encode() for each in ('python', name))
        return copy_recording(
            tmp_path / f'{name}.mcap', push, attach=lambda data: data.replace(was, now)
        )

    return change


@pytest.mark.parametrize('missing', ['', 'gcc not found: install it with `apt install gcc`'])
def test_the_recorded_implementation_replays_it_or_the_replacement_is_named(
    push_by, monkeypatch, missing
):
    path = push_by('c')
    monkeypatch.setattr(
        'ballbot_ros.analysis.recording_replay.missing_tool_for', lambda name: missing
    )
    done = replay(path, '--json')
    assert done.returncode == 0
    for each in json.loads(done.stdout):
        (implementation,) = each['implementations']
        assert implementation['recorded'] == 'c'
        assert implementation['replayed'] == ('python' if missing else 'c')
        assert bool(implementation['reason']) == bool(missing)
    notes = done.stderr.splitlines()
    assert len(notes) == bool(missing)
    assert all(note.startswith(f'note: {path}: ') and missing in note for note in notes)


def test_the_requested_controller_replays_it(push_by):
    done = replay(push_by('arm'), '--controller=python', '--set=controller.k_i=-0.1')
    assert done.returncode == 0
    assert done.stdout.splitlines()[0] == 'implementation: python, recorded arm'
    assert done.stderr == ''


def test_recorded_text_is_shown_as_it_is(capsys):
    told = "data: recorded '[/red][bold]', replayed 'remote'"
    print_results(
        [ReplayResult('robot', 1, 1, MessageDifference(0, 'operating_state', told))],
        [ReplayedController('[bold]', 'python')],
    )
    out = capsys.readouterr().out
    assert told in out
    assert 'implementation: python, recorded [bold]' in out


def test_a_missing_message_is_found(push, tmp_path):
    def change(topic, stamp, data):
        return None if (topic, stamp) == ('/bluetooth/tx', 3_004_000_000) else data

    done = replay(copy(push, tmp_path / 'changed.mcap', change), '--json')
    assert done.returncode == 1
    for each in json.loads(done.stdout):
        assert each['first_difference']['topic'] == 'bluetooth/tx'


EVENTS = '/controller/parameter_events'


def retuned(recording, path, events):
    """Copy a recording with made-up changes of parameters, by stamp [ns]."""
    first = [
        (
            EVENTS,
            stamp,
            values if isinstance(values, bytes) else encode_parameter_event(stamp, values),
        )
        for stamp, values in events.items()
    ]
    return copy_recording(path, recording, first=first, types={EVENTS: PARAMETER_EVENTS.type_name})


def test_changes_of_parameters_are_repeated_at_their_ticks(push, tmp_path):
    plain = json.loads(replay(push, '--json').stdout)
    path = retuned(push, tmp_path / 'tuned.mcap', {3_204_000_000: {'dst_thr': 40, 'k_i': -0.5}})
    done = replay(path, '--json')
    assert done.returncode == 1
    for each, before in zip(json.loads(done.stdout), plain, strict=True):
        # The change keeps the duty of its tick; the integral differs from the next one on.
        assert each['first_difference']['sim_time_s'] >= 3.204
        assert each['first_difference']['topic'] in ('motor_duty', 'controller/state')
        assert before['identical']
    same = retuned(push, tmp_path / 'same.mcap', {3_204_000_000: {'dst_thr': 31}})
    done = replay(same, '--json')
    assert done.returncode == 0, done.stdout
    for each, before in zip(json.loads(done.stdout), plain, strict=True):
        assert each['messages'] == before['messages'] + 1


@pytest.mark.parametrize(
    ('values', 'told'),
    [
        ({'mode': 'autonomous'}, "controller.mode can't change during a run of python"),
        ({'implementation': 'evil.py:X'}, "controller.implementation can't change"),
        (
            {'nothing': 1.0},
            "controller.nothing can't change during a run of python",
        ),
        ({'k_i': 1e10}, 'controller.k_i: 10000000000.0 is not within'),
        ({'k_f': (1.0,)}, 'controller.k_f: (1.0,) is not a list of 4 numbers'),
        ({'k_i': 'x'}, "controller.k_i: 'x' is not a number"),
        (b'\0\1\0\0', 'buffer'),
    ],
)
def test_a_change_that_no_controller_made_is_an_error(push, tmp_path, values, told):
    done = replay(retuned(push, tmp_path / 'wrong.mcap', {3_204_000_000: values}))
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert told in done.stderr
    assert 'wrong.mcap' in done.stderr


def test_a_varied_parameter_keeps_its_value(push, tmp_path):
    """A change of it in the recording does not apply, one of another does."""
    ask = ('--set', 'controller.k_i=-0.1', '--json')
    plain = replay(push, *ask)
    path = retuned(push, tmp_path / 'tuned.mcap', {3_204_000_000: {'k_i': -0.5}})
    assert json.loads(replay(path, *ask).stdout) == json.loads(plain.stdout)
    path = retuned(push, tmp_path / 'also.mcap', {3_204_000_000: {'pwm_gain': 0.5}})
    assert json.loads(replay(path, *ask).stdout) != json.loads(plain.stdout)


def test_the_c_program_does_not_replay_changes(push, tmp_path):
    if missing := missing_tool_for('c'):
        pytest.skip(missing)
    path = retuned(push, tmp_path / 'tuned.mcap', {3_204_000_000: {'k_i': -0.5}})
    done = replay(path, '--controller', 'c')
    assert done.returncode == 2
    assert "controller.k_i can't change during a run of c" in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize('start_ns', [500_000_000, 60_000_000_000], ids=['before', 'after'])
def test_a_run_without_any_answered_tick_is_not_a_difference(push, tmp_path, start_ns):
    """The run was reset before its first answer, and has only messages without a stamp."""
    run, clock = new_message('std_msgs/msg/Header'), new_message('rosgraph_msgs/msg/Clock')
    fill_header(run, start_ns, '2')
    fill_time(clock.clock, start_ns)
    hit = encoder('std_msgs/msg/Bool')(new_message('std_msgs/msg/Bool'))
    also = [
        ('/plant/run', start_ns, encoder('std_msgs/msg/Header')(run)),
        ('/wall_hit', start_ns, hit),
        ('/clock', start_ns, encoder('rosgraph_msgs/msg/Clock')(clock)),
    ]
    path = copy(push, tmp_path / 'reset.mcap', lambda topic, stamp, data: data, also)
    done = replay(path, '--json')
    assert done.returncode == 0, done.stdout
    assert [each['runs'] for each in json.loads(done.stdout)] == [1, 1]


@pytest.fixture
def two_plants(push, tmp_path):
    """The runs of two plants, as a leftover recorder writes them: both begin at 1 s.

    The first plant is stopped early. `change` takes the number of the plant, and topic, stamp and
    data of a message; it returns the data, or None to drop the message.
    """

    def write(change=lambda plant, topic, stamp, data: data):
        path = tmp_path / 'two_plants.mcap'
        path.unlink(missing_ok=True)
        ends_ns = {1: 3_000_000_000, 2: 5_000_000_000}

        def edit(raw, plant):
            data = raw.data
            if raw.topic == '/plant/run':
                run = new_message('std_msgs/msg/Header')
                fill_header(run, raw.stamp_ns, f'1 plant{plant}')
                data = encoder('std_msgs/msg/Header')(run)
            return (
                change(plant, raw.topic, raw.stamp_ns, data)
                if raw.stamp_ns < ends_ns[plant]
                else None
            )

        return copy_recording(path, push, push, edit=edit)

    return write


def test_the_runs_of_two_plants_in_one_file_are_both_replayed(two_plants):
    done = replay(two_plants(), '--json')
    assert done.returncode == 0, done.stdout + done.stderr
    for each in json.loads(done.stdout):
        assert each['identical']
        assert each['runs'] == 2
        assert each['ticks'] == 500 + 1000


def test_a_difference_in_the_first_of_two_plants_is_shown_with_the_inputs_around_it(
    two_plants,
):
    def change(plant, topic, stamp, data):
        if (plant, topic, stamp) == (1, '/motor_duty', 2_404_000_000):
            return data[:-20] + bytes([data[-20] ^ 1]) + data[-19:]
        return data

    done = replay(two_plants(change))
    assert done.returncode == 1
    assert done.stdout.count('differs first at sim time 2.404 s, /motor_duty') == 2
    assert done.stdout.count('2.404 s') == 3


def test_the_inputs_around_a_difference_are_those_of_its_plant(two_plants):
    def told(*, other_gyro):
        def change(plant, topic, stamp, data):
            if stamp == 2_404_000_000 and (plant, topic) == (1, '/motor_duty'):
                return data[:-20] + bytes([data[-20] ^ 1]) + data[-19:]
            if stamp == 2_404_000_000 and (plant, topic) == (2, '/gyro') and other_gyro:
                rate = struct.pack('<d', math.radians(640.0))  # of plane x
                return data[:-184] + rate + data[-176:]
            return data

        return replay(two_plants(change)).stdout

    assert 'recorded inputs' in told(other_gyro=False)
    assert told(other_gyro=True) == told(other_gyro=False)


def test_a_run_has_begun_once_its_own_plant_has_moved_the_clock(two_plants):
    def change(plant, topic, stamp, data):
        is_first = topic == '/plant/run' or (topic, stamp) == ('/plant/imu', 1_000_000_000)
        return data if plant == 1 or is_first else None

    with RecordingReader(two_plants(change)) as reader:
        recorded = read_inputs(reader)
        assert [recorded.has_begun(each.run) for each in recorded.runs] == [True, False]


def test_a_plant_that_has_only_announced_its_run_does_not_count(two_plants):
    def change(plant, topic, stamp, data):
        return data if plant == 1 or topic == '/plant/run' else None

    done = replay(two_plants(change), '--json')
    assert done.returncode == 0, done.stdout + done.stderr
    assert [each['runs'] for each in json.loads(done.stdout)] == [1, 1]


def test_duties_before_the_first_run_belong_to_another_run(two_plants):
    def change(plant, topic, stamp, data):
        if plant == 1 and topic == '/plant/run':
            run = new_message('std_msgs/msg/Header')
            fill_header(run, 1_500_000_000, '1 plant1')
            return encoder('std_msgs/msg/Header')(run)
        return data

    done = replay(two_plants(change))
    assert done.returncode == 2
    assert done.stderr.endswith(': begins in mid-run\n')


def test_another_parameter_shows_what_would_have_happened(push):
    same = json.loads(replay(push, '--set=controller.dst_thr=20', '--json').stdout)
    assert [each['differing'] for each in same] == [0]
    done = replay(push, '--set=controller.k_i=-0.1', '--json')
    assert done.returncode == 0
    (other,) = json.loads(done.stdout)
    assert other['differing'] > 100
    assert other['first_sim_time_s'] >= 2.0
    assert max(other['largest_percent']) > 0


def test_a_recording_that_was_cut_is_replayed_up_to_the_cut(push, tmp_path):
    data = Path(push).read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(data[: len(data) // 2])
    done = replay(cut, '--json')
    assert done.returncode == 0, done.stdout + done.stderr
    assert all(each['identical'] and each['ticks'] > 100 for each in json.loads(done.stdout))
    assert f'note: {cut}: cut off at byte' in done.stderr


def test_an_unusable_recording_is_refused_in_one_line(tmp_path):
    foreign, text = tmp_path / 'foreign.mcap', tmp_path / 'text.mcap'
    with RecordingWriter(foreign) as writer:
        writer.add_topic('/motor_duty', 'geometry_msgs/msg/Vector3Stamped')
    text.write_text('text ' * 10)
    for path, told in ((foreign, 'parameters.yaml is not attached'), (text, 'not an MCAP')):
        done = replay(path)
        assert (done.returncode, done.stdout) == (2, '')
        assert len(done.stderr.splitlines()) == 1, done.stderr
        assert told in done.stderr
        assert str(path) in done.stderr
