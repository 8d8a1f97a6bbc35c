"""Recorded runs at any time, and the messages to the user."""

import itertools
import json
import math
import socket
import sys

import numpy as np
import pytest

import ballbot_ros as bb
from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.cli.recordings import read_playback_run
from ballbot_ros.errors import MissingExtraError, ViewerError
from ballbot_ros.parameters import VIEWER, Dimensions, ParameterSet, ViewerParameters
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.robot.brick.brick import Tone
from ballbot_ros.run.requirements import Processes, require_viewer
from ballbot_ros.viewer import address
from ballbot_ros.viewer.address import (
    NEXT_FREE,
    address_in,
    address_line,
    check_address,
    network_warning,
    url_authority,
)
from ballbot_ros.viewer.playback_run import PlaybackRun
from ballbot_ros.viewer.scene import tone_html


@pytest.fixture(scope='module')
def run(recording):
    return PlaybackRun(recording)


def test_a_snapshot_is_the_newest_tick(run, recording):
    motion = read_run(recording).trajectory
    for tick in (0, 1000, len(motion.time) - 1):
        for later in (0.0, 0.003):
            shown = run.snapshot(motion.time[tick] + later)
            assert shown.position == tuple(motion.position[tick])
            assert shown.psi == tuple(motion.psi[tick])
            assert shown.duty == tuple(motion.duty[tick])


def test_times_beyond_the_run_show_its_ends(run):
    assert run.snapshot(-1.0).time == 0.0
    assert run.snapshot(1e3).time == run.end


def test_state_display_and_battery_follow_the_time(run):
    assert run.snapshot(0.5).state == 'calibration'
    assert run.snapshot(8.0).state in ('forward', 'rightward')
    assert run.snapshot(8.0).lcd.startswith('NXT BALLBOT')
    assert run.snapshot(8.0).battery == pytest.approx(8.0)


def test_a_tone_is_found_in_the_played_interval(run):
    assert run.tone(1.1, 9.0) is run.tone(0.9, 1.0) is run.tone(1.0, 1.0) is None
    assert run.tone(1.0, 1.02) == run.tone(0.9, 1.1) == Tone(440, 500, 70)


def test_the_map_has_its_lines(run):
    assert run.floor_map.walls.any()
    assert (run.floor_map.cells == 0).any()


def test_the_columns_of_a_run_are_those_of_its_frame(run, recording):
    frame = bb.open(recording).frame()
    assert run.columns == set(frame.columns) - {'operating_state'}
    for name, values in run.table(run.columns, run.ticks).items():
        np.testing.assert_array_equal(values, frame[name], err_msg=name)


def test_the_columns_of_a_run_are_unknown_after_its_end(run):
    columns = run.table(['pitch_x_deg', 'distance_m'], run.ticks + 10)
    assert set(columns) == {'pitch_x_deg', 'pitch_y_deg', 'distance_m'}
    for values in columns.values():
        assert np.isnan(values[-10:]).all()
        assert not np.isnan(values[:-10]).any()


def test_the_trail_grows_with_the_time_in_steps_of_a_centimetre(run):
    whole = run.trail(run.end)
    assert len(whole) > 50
    assert run.trail(0.0) == [run.start] == whole[:1]
    assert run.trail(7.0) == whole[: len(run.trail(7.0))]
    steps = [math.dist(*pair) for pair in itertools.pairwise(whole)]
    assert 0.01 < min(steps) <= max(steps) < 0.015
    x, y = run.snapshot(run.end).position
    assert math.dist(whole[-1], (x, -y)) <= 0.01


def test_a_file_that_ends_early_is_shown_up_to_there(recording, tmp_path, capsys):
    path = tmp_path / 'cut.mcap'
    path.write_bytes(recording.read_bytes()[:300_000])
    assert 1.0 < read_playback_run(path).end < 9.0
    assert f'{path}: cut off at byte 300000; the run is shown up to' in capsys.readouterr().err
    read_playback_run(recording)
    assert capsys.readouterr().err == ''


def test_equal_tones_are_different_elements():
    assert tone_html(Tone(440, 500, 70), 1) != tone_html(Tone(440, 500, 70), 2)


@pytest.fixture
def taken():
    """A port that is in use."""
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))
        taken.listen()
        yield taken.getsockname()[1]


def test_a_chosen_port_that_is_taken_is_one_line(taken):
    parameters = ParameterSet()
    parameters.set(VIEWER, 'port', taken)
    for check in (lambda: check_address('127.0.0.1', taken), lambda: require_viewer(parameters)):
        with pytest.raises(ViewerError, match=rf'served on 127.0.0.1:{taken}: Address already'):
            check()
    with pytest.raises(ViewerError, match='cannot be served on'):
        check_address('host.invalid', 0)


def test_instead_of_the_usual_port_the_next_free_one_is_taken_and_named(taken, monkeypatch):
    from ballbot_ros.viewer import page

    for module in (address, page):
        monkeypatch.setattr(module, 'USUAL_PORT', taken)
    parameters = ParameterSet()
    require_viewer(parameters)
    dimensions = Dimensions.from_parameters(parameters.of(ViewerParameters))
    served = page.Page(dimensions, 'test', '127.0.0.1', NEXT_FREE)
    try:
        port = served.server.get_port()
        assert port > taken
        note, line = address_line(served.address, NEXT_FREE).splitlines()
        assert note == f'port {taken} is in use: the page takes the next free one'
        assert address_in(line) == served.address
    finally:
        served.stop()
    for number, chosen in ((taken, NEXT_FREE), (port, 0), (port, port)):
        assert '\n' not in address_line(f'http://127.0.0.1:{number}/?token=a', chosen)
    with pytest.raises(ViewerError, match='cannot be served on'):
        check_address('host.invalid', NEXT_FREE)


def test_a_missing_recording_is_reported_before_a_taken_port(taken, monkeypatch, tmp_path, command):
    monkeypatch.chdir(tmp_path)
    status, _, error = command('view', 'missing.mcap', '--port', taken)
    assert (status, error) == (2, 'error: missing.mcap: No such file or directory\n')


def test_a_run_with_a_viewer_needs_viser_and_separate_processes(monkeypatch):
    parameters = ParameterSet()
    parameters.set(VIEWER, 'port', 0)
    require_viewer(parameters)
    for processes in (Processes.ONE, Processes.NONE):
        with pytest.raises(ViewerError, match=f'requires --processes separate, not {processes}'):
            require_viewer(parameters, processes)
    monkeypatch.setitem(sys.modules, 'viser', None)
    with pytest.raises(MissingExtraError, match='viser'):
        require_viewer(parameters)


def test_an_ipv6_address_is_in_brackets():
    assert url_authority('127.0.0.1', 80) == '127.0.0.1:80'
    assert url_authority('::1', 80) == '[::1]:80'


def test_a_page_for_the_network_warns():
    assert network_warning('127.0.0.1') == ''
    for host in ('0.0.0.0', '::', '192.0.2.1', 'robot'):
        assert 'everybody who reaches it can watch' in network_warning(host)
        assert 'everybody who has the address with the token can steer' in network_warning(host)


def test_without_viser_there_is_a_hint(monkeypatch, command, recording):
    monkeypatch.setitem(sys.modules, 'viser', None)
    status, _, error = command('view', recording)
    assert status == 2
    assert 'pip install "ballbot_ros[viewer]"' in error


def test_json_of_a_run_names_no_viewer(recording):
    """The viewer's parameters are not recorded, since a run does not depend on the page."""
    with RecordingReader(recording) as reader:
        text = reader.attachments()['parameters.yaml'].data.decode()
    assert 'viewer' not in json.dumps(text)
