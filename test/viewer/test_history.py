"""The recent history of a live run: signals and trail."""

import math

import numpy as np
import pytest

from ballbot_ros.analysis.signals import SIGNALS
from ballbot_ros.recording.messages.conversions import ControllerState
from ballbot_ros.viewer.snapshot import (
    LIVE_SIGNALS,
    TRAIL_PIECE,
    TRAIL_POINTS,
    WINDOW_S,
    History,
    Snapshot,
)


def snapshot(position=(0.0, 0.0), time=1.0):
    return Snapshot(time, position, (0.0, 0.0))


def test_the_history_holds_the_last_seconds():
    history = History()
    for tick in range(3000):
        history.add(snapshot(time=tick * 0.004))
        history.add(snapshot(time=tick * 0.004))
    time, columns = history.columns(0.026, None)
    assert abs(len(time) - WINDOW_S / 0.004) <= 2
    assert time[-1] - time[0] == pytest.approx(WINDOW_S)
    assert {values.shape for values in columns.values()} == {time.shape}
    history.clear()
    assert len(history.columns(0.026, None)[0]) == 1


def test_the_history_has_the_signals_under_the_names_of_a_frame():
    history = History()
    history.add(
        Snapshot(
            2.0,
            position=(1.0, 2.0),
            psi=(0.1, -0.1),
            sonar=math.inf,
            estimates=ControllerState((3.0, 4.0), (0.2, 0.0), (5.0, math.nan), (1.0, 0.0)),
            sticks=(0.5, -1.0),
        )
    )
    time, columns = history.columns(0.1, (0.5, -0.5))
    newest = {name: values[-1] for name, values in columns.items()}
    assert time.tolist() == [0.0, 2.0]
    assert newest['position_x_m'] == 1.0
    assert newest['pitch_y_deg'] == pytest.approx(-5.7296, abs=1e-4)
    assert newest['estimated_pitch_x_deg'] == pytest.approx(11.4592, abs=1e-4)
    assert newest['estimated_position_y_m'] == pytest.approx(-0.1)
    assert newest['reference_position_x_m'] == pytest.approx(1.0)
    assert newest['reference_speed_x_m_per_s'] == pytest.approx(0.1)
    assert newest['stick_y_percent'] == -100.0
    assert newest['distance_m'] == math.inf
    for name in ('reference_position_y_m', 'speed_x_m_per_s', 'battery_v'):
        assert math.isnan(newest[name]), name
    frame = {name for signal in SIGNALS for name in signal.columns}
    assert set(columns) == LIVE_SIGNALS <= frame


def test_positions_of_the_controller_need_the_start():
    history = History()
    history.add(snapshot(time=1.0))
    _, columns = history.columns(0.1, None)
    assert np.isnan(columns['estimated_position_x_m']).all()
    assert columns['position_x_m'][-1] == 0.0


def test_the_trail_continues_at_any_length():
    history = History()
    history.add(snapshot(time=0.5))
    history.add(snapshot((0.001, 0.0), time=0.6))
    assert history.trail() == [(0.0, 0.0)]
    for step in range(1, 2 * TRAIL_POINTS):
        before = history.trail()
        history.add(snapshot((0.02 * step, 0.01 * step), time=float(step)))
        assert history.trail()[-1] == (0.02 * step, -0.01 * step)
        assert len(history.trail()) >= min(step, TRAIL_POINTS)
        # Whole pieces disappear, so that those that remain need not be sent again.
        assert history.trail()[:-1] in (before, before[TRAIL_PIECE:])
    assert len(history.trail()) <= TRAIL_POINTS + TRAIL_PIECE


def test_a_jump_back_restarts_the_history():
    history = History()
    for time in (5.0, 6.0, 2.0, 3.0):
        history.add(snapshot((time, 0.0), time=time))
    assert history.columns(0.026, None)[0].tolist() == [0.0, 2.0, 3.0]
    assert history.trail() == [(2.0, 0.0), (3.0, 0.0)]
