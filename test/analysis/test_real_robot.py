"""Recordings of a real robot, and the CSV of its data log: runs with fewer topics."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from real_runs import logged_packets, recorded_sticks, write_csv, write_real

import ballbot_ros as bb
from ballbot_ros.analysis.assessment import assess, shown_metrics
from ballbot_ros.analysis.comparison import ComparedRun, Comparison
from ballbot_ros.analysis.identification.experiment import logged_experiment
from ballbot_ros.analysis.report import report_document
from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.analysis.run_figures import figure_contents
from ballbot_ros.analysis.signals import signals_of
from ballbot_ros.parameters import LogFormat
from ballbot_ros.recording.csv_log import HEADER
from ballbot_ros.recording.messages.recording_files import open_recording
from ballbot_ros.recording.messages.topics import (
    CONTROLLER_STATE,
    GAMEPAD_JOY,
    GYRO_IMU,
    MOTOR_DUTY,
)
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.robot.brick.bluetooth import LogPacket
from ballbot_ros.viewer.playback_run import PlaybackRun

PROGRAM = b'/**/controller:\n  ros__parameters:\n    k_thetadot: 300.0\n'
KINDS = 'mcap', 'csv'


@pytest.fixture(scope='module')
def files(driven, tmp_path_factory):
    """The recording of a link to a brick and the CSV, each of the packets of a simulated run."""
    folder, packets = tmp_path_factory.mktemp('real'), logged_packets(driven[0])
    attached = [('parameters.yaml', PROGRAM)]
    sticks = recorded_sticks(driven[0])
    return {
        'mcap': write_real(folder / 'brick.mcap', packets, sticks=sticks, attachments=attached),
        'csv': write_csv(folder / 'log.csv', packets),
    }


@pytest.fixture(scope='module')
def real(files):
    return {kind: read_run(path) for kind, path in files.items()}


def test_both_files_give_the_same_series(real):
    mcap, csv = real['mcap'], real['csv']
    assert mcap.series.keys() - csv.series.keys() == {GAMEPAD_JOY}
    for topic, series in csv.series.items():
        np.testing.assert_array_equal(series.values, mcap.series[topic].values)
        np.testing.assert_allclose(series.time, mcap.series[topic].time, atol=1e-6)
    np.testing.assert_array_equal(csv.motion.position, mcap.motion.position)


@pytest.mark.parametrize('kind', KINDS)
def test_the_motion_is_what_the_controller_estimated(driven, real, kind):
    """The log rounds the pitch to an lsb, and the angle of a motor to a degree."""
    run, simulated, log = real[kind], read_run(driven[0]), LogFormat()
    state = simulated.series[CONTROLLER_STATE]
    first_s = logged_packets(driven[0])[0].time_ms * 1e-3 - simulated.start_ns * 1e-9
    rows = np.searchsorted(state.time, run.motion.time + first_s - 1e-3)
    psi = state.values[rows][:, [1, 3]]
    np.testing.assert_allclose(run.motion.psi, psi, atol=math.radians(log.lsb))
    position = log.ball_radius * state.values[rows][:, [0, 2]]
    np.testing.assert_allclose(run.motion.position, position, atol=1e-4)
    assert run.end == pytest.approx(simulated.end - first_s, abs=0.11)


@pytest.mark.parametrize('kind', KINDS)
def test_nothing_is_invented(real, kind):
    run = real[kind]
    assessment = assess(run)
    assert run.is_real
    assert len(run.trajectory.time) == 0
    assert run.duty_sha256 is None
    assert (assessment.outcome, assessment.reason) == (
        'not judged', 'the true motion of a real robot is unknown'
    )  # fmt: skip
    assert shown_metrics(assessment).keys() == {
        'controlled_s', 'estimated_pitch_rms_deg', 'peak_estimated_pitch_deg',
        'estimated_position_rms_m', 'peak_estimated_position_m', 'lowest_battery_v',
    }  # fmt: skip
    content = assessment.as_json()
    assert (content['ticks'], content['seed'], content['real_robot']) == (None, None, True)
    assert run.notices[0].startswith('A real robot: position and pitch are the estimates')
    assert len(run.notices) == (2 if kind == 'csv' else 1), 'only the program may be unknown'


@pytest.mark.parametrize('kind', KINDS)
def test_the_report_shows_the_estimates_under_their_name(real, kind):
    page = report_document(assess(real[kind]))
    assert 'A real robot: position and pitch are the estimates' in page
    motion, track, *others = (each.figure for each in figure_contents(real[kind]))
    assert (motion.title, track.title) == ('Estimated position and body pitch', 'Estimated track')
    assert [each.label for each in motion.panels] == [
        'estimated position [cm]', 'estimated body pitch [°]'
    ]  # fmt: skip
    sticks = ['sticks'] if kind == 'mcap' else []
    assert [each.name for each in others] == [*sticks, 'sonar', 'battery']
    for absent in ('Plant model', 'Seed', 'Margins', 'plant_sim', 'missing ticks', 'Ticks'):
        assert absent not in page, absent
    assert ('k_thetadot' in page) == (kind == 'mcap')


def test_a_simulated_run_without_its_truth_is_no_real_one(short, copy):
    """Its log says nothing of it, since it was not recorded."""
    hidden = ('/plant/imu', '/plant/odom', '/plant/joint_states', '/bluetooth/tx')
    run = read_run(copy(short[0], wanted=lambda name: name not in hidden))
    assert not run.is_real
    assert any('/plant/imu not found' in each for each in run.notices)


def test_a_signal_holds_until_the_next_packet(real):
    run = real['csv']
    stamps = run.start_ns + np.arange(0, 200_000_000, 4_000_000)
    pitch = next(each for each in signals_of(run) if each.name == 'estimated_pitch')
    shown = pitch.table(run, stamps)['estimated_pitch_x_deg']
    packets = np.degrees(run.motion.psi[:2, 0])
    np.testing.assert_allclose(shown, np.repeat(packets, 25), rtol=1e-6)


@pytest.mark.parametrize('kind', KINDS)
def test_the_viewer_moves_the_robot_by_the_estimates(files, real, kind):
    playback, motion = PlaybackRun(files[kind]), real[kind].motion
    for row in (0, 40, len(motion.time) - 1):
        shown = playback.snapshot(motion.time[row])
        assert shown.position == tuple(motion.position[row])
        assert shown.psi == tuple(motion.psi[row])
    assert 'estimated_pitch_x_deg' in playback.columns


@pytest.mark.parametrize('kind', KINDS)
def test_the_page_of_a_real_robot_offers_no_other_future(command, files, monkeypatch, kind):
    pytest.importorskip('viser')

    class AtOnce:
        """A signal that has come already."""

        signal = 15

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

    def refuse(*_):
        raise AssertionError('a page that can become live')

    monkeypatch.setattr('ballbot_ros.cli.view.StopRequest', AtOnce)
    monkeypatch.setattr('ballbot_ros.run.continued_page.ContinuedPage', refuse)
    status, output, _ = command('view', files[kind], '--no-browser', '--port', 0)
    assert status == 0
    assert 'http' in output


def test_a_log_that_was_opened_is_saved_as_a_recording(files, tmp_path):
    run = bb.open(files['csv'])
    assert run.verdict == 'not judged'
    assert len(run.frame()) == len(logged_packets(files['mcap']))
    figure = run.plot()
    assert 'duty [%]' not in [axes.get_ylabel() for axes in figure.axes]
    assert figure.get_suptitle() == 'log, real robot (estimated)'
    saved = run.save(tmp_path / 'saved.mcap')
    with RecordingReader(saved) as reader, open_recording(files['csv']) as opened:
        assert list(reader.raw_messages()) == list(opened.raw_messages())
        assert opened.size == files['csv'].stat().st_size


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize(
    ('words', 'told'),
    [
        (['info', '{file}'], 'real: estimates of its controller, without true motion'),
        (['report', '{file}', '--output', '{new}'], 'not judged: the true motion of a real robot'),
        (['export', '{file}', '--to', 'csv', '--output', '{new}'], 'controller_state.csv'),
        (['export', '{file}', '--to', 'csv', '--joined', '--output', '{new}'], 'joined.csv'),
        (['export', '{file}', '--to', 'log', '--output', '{new}'], '.csv'),
        (['compare', '{file}', '{file}'], 'metrics without a difference'),
    ],
)  # fmt: skip
def test_every_command_takes_both_files(command, files, tmp_path, kind, words, told):
    given = {'file': files[kind], 'new': tmp_path / 'new'}
    status, stdout, stderr = command(*(word.format(**given) for word in words))
    assert (status, told in stdout) == (0, True), (stdout, stderr)
    if 'log' in words:
        (written,) = (tmp_path / 'new').iterdir()
        assert written.read_bytes() == files['csv'].read_bytes()


def test_logged_duties_and_gyros_are_shown_and_nothing_is_made_of_them(driven, real, tmp_path):
    packets = [
        replace(each, data1=7, data2=-9, adc3=601, adc4=598) for each in logged_packets(driven[0])
    ]
    path = write_real(tmp_path / 'brick.mcap', packets, log_content='duties_and_gyros')
    run = read_run(path)
    assert run.motion.duty.tolist() == [[7, -9]] * len(packets)
    assert {MOTOR_DUTY, GYRO_IMU} <= run.series.keys()
    assessment = assess(run)
    assert shown_metrics(assessment) == shown_metrics(assess(real['mcap']))
    assert (run.duty_sha256, assessment.outcome) == (None, 'not judged')
    assert 'duty' in [each.figure.name for each in figure_contents(run)]
    assert 'Limit cycle' not in report_document(assessment)
    assert 'duty_x_percent' in PlaybackRun(path).columns


def test_info_names_no_seed(command, driven, files, tmp_path):
    program = [('parameters.yaml', b'/**/controller:\n  ros__parameters:\n    seed: 7\n')]
    path = write_real(tmp_path / 'b.mcap', logged_packets(driven[0])[:5], attachments=program)
    assert json.loads(command('info', path, '--json')[1])['made_by'] == {}


@pytest.mark.parametrize(
    ('words', 'told'),
    [
        (['replay', '{mcap}'], '{mcap}: a recording of a real robot cannot be run again'),
        (['replay', '{csv}'], '{csv}: a recording of a real robot cannot be run again'),
        (['branch', '{mcap}', '--at', '2', '--fault', 'gyro_x off'],
         '{mcap}: a recording of a real robot cannot be run again'),
        (['codegen', '--output', '{new}', '--params', '{mcap}'],
         '{mcap}: of a real robot; give the parameter file of its program'),
        (['repair', '{csv}'], '{csv}: not an MCAP file'),
        (['identify', '{csv}', '--truth'], '{csv}: a data log has no true states'),
        (['identify', '{mcap}', '--truth'], '{mcap}: a data log has no true states'),
        (['info', '{cells}'], '{cells}, line 3: 12 values are needed, not 2'),
        (['report', '{back}'], '{back}, line 3: its time, 1 ms, is not after 2 ms'),
        (['view', '{none}', '--no-browser'], '{none}: a data log without packets'),
        (['info', '{other}'], "{other}: is not a data log: its first line must be 'Time,"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_said_in_one_line(command, files, tmp_path, words, told):
    row = '0,0,8005,0,-123,45,-2048,2048,0,0,255'
    logs = {
        'cells': [HEADER, f'1,{row}', '1,2'], 'back': [HEADER, f'2,{row}', f'1,{row}'],
        'none': [HEADER], 'other': ['a,b', '1,2'],
    }  # fmt: skip
    paths = {**files, 'new': tmp_path / 'new', **{name: tmp_path / f'{name}.csv' for name in logs}}
    for name, lines in logs.items():
        paths[name].write_text('\n'.join([*lines, '']))
    status, stdout, stderr = command(*(word.format(**paths) for word in words))
    assert (status, stdout) == (2, '')
    assert stderr.startswith(f'error: {told.format(**paths)}') or told.format(**paths) in stderr
    assert len(stderr.splitlines()) == 1


def test_a_robot_is_identified_alike_from_both_files(files):
    mcap, csv = (logged_experiment(files[kind], {}) for kind in KINDS)
    assert mcap.readings.keys() == csv.readings.keys()
    for channel, values in csv.readings.items():
        np.testing.assert_array_equal(values, mcap.readings[channel])


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('real_first', [True, False])
def test_a_real_run_lies_over_the_simulated_one(command, files, driven, tmp_path, kind, real_first):
    """Here the real robot is the simulated one, so they differ only by the error of estimates."""
    pair = [files[kind], driven[0]] if real_first else [driven[0], files[kind]]
    status, stdout, _ = command('compare', *pair, '--json')
    content = json.loads(stdout)
    assert status == 0
    event = 'the first stick' if kind == 'mcap' else 'the end of the calibration'
    assert content['alignment'].startswith(f'aligned at {event}')
    labels = [each['label'] for each in content['runs']]
    assert sorted(label.partition(', ')[2] for label in labels) == [
        'real robot (estimated)', 'simulated'
    ]  # fmt: skip
    (apart,) = content['apart']
    pitch, position = map(float, re.findall(r'([0-9.]+) (?:°|cm) rms', apart))
    assert pitch < 0.5
    assert position < 1.0
    assert content['changes'] == ([{
        'name': 'controller.k_thetadot',
        'values': ['300', '380'] if real_first else ['380', '300'],
    }] if kind == 'mcap' else [])  # fmt: skip


def test_curves_of_a_later_start_are_shifted_to_the_first_stick(files, driven, tmp_path):
    packets, sticks = logged_packets(driven[0]), recorded_sticks(driven[0])
    first = next(time for time, pair in sticks if any(pair))
    moved = [(time, pair if time >= first + 3.0 else (0, 0)) for time, pair in sticks]
    path = write_real(tmp_path / 'late.mcap', packets, sticks=moved)
    late, run = (
        ComparedRun.from_assessment(letter, assess(read_run(each)))
        for letter, each in (('A', path), ('B', driven[0]))
    )
    compared = Comparison.of([late, run])
    assert compared.runs[0].motion['time_s'][0] == 0.0
    shift = late.first_stick - run.first_stick
    assert shift == pytest.approx(3.0 - run.calibrated, abs=0.05)
    np.testing.assert_allclose(compared.runs[1].motion['time_s'], run.motion['time_s'] + shift)
    assert compared.runs[1].motion['position_x_m'][0] == 0.0


def test_the_page_says_which_run_is_real(command, files, driven, tmp_path):
    folder = tmp_path / 'compared'
    assert command('compare', files['mcap'], driven[0], '--output', folder)[0] == 0
    page = (folder / 'index.html').read_text('utf-8')
    assert 'Times are aligned at the first stick' in page
    assert 'real robot (estimated)' in page
    assert {each.stem for each in folder.glob('*.png')} == {'pitch', 'position', 'duty', 'track'}


@pytest.mark.parametrize('others', [(), ('/motor_duty',)], ids=['duties', 'nothing'])
def test_a_simulated_run_without_its_truth_has_no_distance_from_a_real_one(
    command, files, short, copy, others
):
    hidden = ('/plant/imu', '/plant/odom', *others)
    blind = copy(short[0], wanted=lambda name: name not in hidden)
    status, stdout, _ = command('compare', files['mcap'], blind, '--json')
    assert (status, json.loads(stdout)['apart']) == (0, [])


def test_two_simulated_runs_are_not_aligned(command, short):
    content = json.loads(command('compare', short[0], short[0], '--json')[1])
    assert (content['alignment'], content['apart']) == (None, [])


def test_a_log_is_known_by_its_content(files, tmp_path):
    named = tmp_path / 'brick.txt'
    named.write_bytes(files['csv'].read_bytes())
    assert read_run(named).is_real


INT16, INT32 = st.integers(-(2**15), 2**15 - 1), st.integers(-(10**6), 10**6)
PACKETS = st.lists(
    st.tuples(st.integers(1, 1000), INT32, INT32, INT16, INT16, st.integers(0, 255)), min_size=2
)


@settings(max_examples=20, deadline=None)
@given(start=st.sampled_from([0, 2004, 2**32 - 500]), rows=PACKETS)
def test_what_a_brick_logs_comes_back(tmp_path_factory, start, rows):
    times = np.cumsum([row[0] for row in rows])
    packets = [
        LogPacket(int(start + time) % 2**32, 0, 0, 8000, 0, b, c, x, y, 0, 0, sonar)
        for time, (_, b, c, x, y, sonar) in zip(times, rows, strict=True)
    ]  # fmt: skip
    path = write_csv(tmp_path_factory.mktemp('log') / 'log.csv', packets)
    run, log = read_run(path), LogFormat()
    np.testing.assert_allclose(run.motion.time, (times - times[0]) * 1e-3, atol=1e-6)
    pitch = np.array([row[3:5] for row in rows]) * log.lsb
    np.testing.assert_allclose(np.degrees(run.motion.psi), pitch, rtol=1e-6, atol=1e-9)
    turned = np.array([row[1:3] for row in rows], float)
    theta = np.radians(log.wheel_radius / log.ball_radius * turned + pitch)
    np.testing.assert_allclose(run.motion.position, log.ball_radius * theta, rtol=1e-6, atol=1e-9)
