"""`ballbot twin`: a robot like the real one, with its program and its sticks."""

import re

import numpy as np
import pytest
from real_runs import logged_packets, recorded_sticks, write_csv, write_real

import ballbot_ros as bb
from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.parameters import ControllerParameters, PlantParameters
from ballbot_ros.parameters.files import read_parameter_file
from ballbot_ros.recording.messages.topics import GAMEPAD_JOY
from ballbot_ros.viewer.playback_run import PlaybackRun

HEIGHT, SPEED = 0.2, 350.0
PROGRAM = f'/**/controller:\n  ros__parameters:\n    k_thetadot: {SPEED}\n'.encode()


@pytest.fixture(scope='module')
def hidden(tmp_path_factory):
    """The recording of a robot that is not the document's, without its truth."""
    folder = tmp_path_factory.mktemp('hidden')
    values = {
        'plant_sim.body_height': HEIGHT, 'plant_sim.duration': 30.0,
        'controller.k_thetadot': SPEED, 'gyro_driver.seed': 5,
    }  # fmt: skip
    path = bb.simulate('excitation', parameters=values).save(folder / 'run.mcap')
    packets, sticks = logged_packets(path), recorded_sticks(path)
    attached = [('parameters.yaml', PROGRAM)]
    return {
        'mcap': write_real(folder / 'brick.mcap', packets, sticks=sticks, attachments=attached),
        'csv': write_csv(folder / 'log.csv', packets[:100]),
        'run': path,
    }


@pytest.fixture(scope='module')
def twin(hidden, tmp_path_factory):
    from graph import call

    folder = tmp_path_factory.mktemp('twin') / 'new'
    done = call('twin', hidden['mcap'], '--output', folder)
    assert done.returncode == 0, done.stderr
    return folder, done.stdout


def test_what_the_log_tells_is_identified_and_the_rest_is_that_of_the_profile(twin):
    folder, output = twin
    found = read_parameter_file(folder / 'twin.yaml').of(PlantParameters).body_height
    assert found == pytest.approx(HEIGHT, rel=0.1)
    attached = read_run(folder / 'twin.mcap').attached.parameters
    assert attached.of(PlantParameters).body_height == pytest.approx(found, rel=1e-6)
    assert attached.of(PlantParameters).dead_zone == 4.0
    assert attached.of(PlantParameters).real_time_factor == 0.0, 'it is as fast as it can be'
    assert attached.of(ControllerParameters).k_thetadot == SPEED
    assert (folder / 'index.html').exists()
    assert 'aligned at the first stick' in output
    assert 'B − A at the same time' in output


def test_the_twin_gets_the_sticks_of_the_real_robot(hidden, twin):
    """From the first packet on, to the nearest 20 ms."""
    real, simulated = read_run(hidden['mcap']), read_run(twin[0] / 'twin.mcap')
    sent, got = real.series[GAMEPAD_JOY], simulated.series[GAMEPAD_JOY]
    for plane in (0, 1):
        moved = sent.time[1:][np.diff(sent.values[:, plane]) != 0]
        moves = got.time[1:][np.diff(got.values[:, plane]) != 0] - simulated.calibrated
        assert len(moved) > 4
        np.testing.assert_allclose(moves, moved, atol=0.045)


def test_the_twin_is_nearer_to_the_real_robot_than_the_documents(hidden, twin, command, tmp_path):
    def apart(path):
        status, output, _ = command('compare', hidden['mcap'], path)
        assert status == 0
        return [float(each) for each in re.findall(r'([0-9.]+) (?:°|cm) rms', output)]

    document = bb.simulate(
        'excitation',
        parameters={'plant_sim.duration': 30.0, 'controller.k_thetadot': SPEED},
    ).save(tmp_path / 'document.mcap')
    pitch, _ = apart(twin[0] / 'twin.mcap')
    assert pitch < apart(document)[0]


def test_the_ghost_is_calibrated_when_the_real_robot_is(hidden, twin):
    real, ghost = PlaybackRun(hidden['mcap']), PlaybackRun(twin[0] / 'twin.mcap')
    before = ghost.snapshot(ghost_time := 7.0).position
    end = ghost.end
    ghost.align_with(real)
    calibrated = read_run(twin[0] / 'twin.mcap').calibrated
    assert ghost.end == pytest.approx(end - calibrated)
    assert ghost.snapshot(ghost_time - calibrated).position == before
    assert ghost.trail(ghost_time - calibrated)
    ghost.align_with(ghost)  # two simulated runs keep their times
    assert ghost.snapshot(ghost_time - calibrated).position == before


def test_a_csv_has_no_sticks_so_its_twin_stands_still(hidden, command, tmp_path):
    status, _, error = command('twin', hidden['csv'], '--output', tmp_path / 'new')
    assert status == 0
    assert 'has no sticks, so its twin stands still' in error
    run = bb.open(tmp_path / 'new/twin.mcap')
    assert run.metrics['peak_position_m'] < 0.1


@pytest.mark.parametrize(
    ('words', 'told'),
    [
        (['{run}'], 'not a real robot; compare simulated runs with `compare`'),
        (['nothing.csv'], 'nothing.csv: No such file or directory'),
        (['{csv}', '--profile', 'x'], "unknown profile 'x'"),
        (['{csv}', '--output', '.'], 'already exists and is not empty'),
    ],
)
def test_a_mistake_is_one_line(hidden, command, tmp_path, monkeypatch, words, told):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'file').touch()
    status, _, error = command('twin', *(word.format(**hidden) for word in words))
    assert status == 2
    assert told in error
    assert [*tmp_path.iterdir()] == [tmp_path / 'file']
