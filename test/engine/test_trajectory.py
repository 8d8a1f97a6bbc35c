"""The record of a run in memory."""

import hashlib

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from parts import make_plant

from ballbot_ros.engine.trajectory import TrajectoryLog, load_trajectory, save_trajectory

duty_pairs = st.lists(st.tuples(st.integers(-128, 127), st.integers(-128, 127)), max_size=20)


def logged(duties):
    plant, log = make_plant(start_pitch_x=0.1, start_position_y=2.0), TrajectoryLog()
    for duty in duties:
        log.add(plant.truth(), *duty)
        plant.tick(*duty)
    return log


@given(duty_pairs)
def test_the_hash_is_that_of_the_signed_bytes_of_the_duty_pairs(duties):
    content = np.array(duties, dtype=np.int8).tobytes()
    assert logged(duties).duty_sha256 == hashlib.sha256(content).hexdigest()


@given(duty_pairs)
def test_duties_are_kept_tick_by_tick(duties):
    log = logged(duties)
    assert log.ticks == len(duties)
    assert [tuple(pair) for pair in log.trajectory().duty.tolist()] == duties


def test_the_hash_without_ticks_is_that_of_empty_data():
    assert TrajectoryLog().duty_sha256 == hashlib.sha256(b'').hexdigest()


def test_the_order_of_planes_and_ticks_matters_to_the_hash():
    hashes = {logged(d).duty_sha256 for d in ([(1, 2), (3, 4)], [(2, 1), (3, 4)], [(3, 4), (1, 2)])}
    assert len(hashes) == 3


def test_time_begins_at_zero_and_columns_are_planes():
    trajectory = logged([(10, -10)] * 50).trajectory()
    np.testing.assert_allclose(trajectory.time, np.arange(50) * 0.004, atol=1e-9)
    assert trajectory.psi[0].tolist() == [0.1, 0.0]
    assert trajectory.position[0].tolist() == [0.0, 2.0]
    assert trajectory.psi.shape == trajectory.position.shape == trajectory.duty.shape == (50, 2)


@pytest.mark.parametrize('count', [0, 1, 30])
def test_a_saved_trajectory_can_be_loaded(tmp_path, count):
    trajectory = logged([(10, -10)] * count).trajectory()
    summary = {'outcome': 'completed', 'reason': 'größer', 'round_trip_ms': None, 'ticks': count}
    save_trajectory(tmp_path / 'run.npz', trajectory, summary)
    loaded, loaded_summary = load_trajectory(tmp_path / 'run.npz')
    assert loaded_summary == summary
    for name, column in vars(trajectory).items():
        np.testing.assert_array_equal(vars(loaded)[name], column)
        assert vars(loaded)[name].dtype == column.dtype
