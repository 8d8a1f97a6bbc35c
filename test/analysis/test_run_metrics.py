"""Metrics of series whose answers are known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ballbot_ros.analysis.assessment import shown_metrics
from ballbot_ros.analysis.extraction import Status
from ballbot_ros.analysis.figure_parts import Interval
from ballbot_ros.analysis.metrics import Judgement
from ballbot_ros.analysis.run_data import Series
from ballbot_ros.analysis.run_metrics import RUN_METRICS
from ballbot_ros.engine.scenario.scenario import Expectation
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.recording.messages.topics import (
    BATTERY_STATE,
    CONTROLLER_STATE,
    GAMEPAD_JOY,
    GYRO_IMU,
    PLANT_IMU,
    PLANT_JOINT_STATES,
    PLANT_ODOM,
)

COUNT = 1000
STAMPS = 1_000_000_000 + 4_000_000 * np.arange(COUNT)


def series(*columns):
    values = np.column_stack([np.broadcast_to(column, COUNT) for column in columns])
    return Series(STAMPS, STAMPS * 1e-9 - 1.0, values)


@pytest.fixture
def metrics(short_assessment):
    """Measure the run `short` with the given series instead of its own."""

    def measure(given=None, **changes):
        return RUN_METRICS.measure(replace(short_assessment.run, series=given or {}, **changes))

    return measure


def test_without_topics_only_times_and_ticks_are_measured(metrics):
    known = {name for name, value in metrics().items() if not math.isnan(value)}
    assert known == {name for name in RUN_METRICS if name.startswith('time_in')} | {'missing_ticks'}


def test_constant_current_at_constant_rate_takes_its_energy(metrics):
    # 0.1 A through 6.69 ohm, and 0.468 V·s/rad at 2 rad/s, in both motors, from 1 s on.
    given = {PLANT_JOINT_STATES: series(2.0, 2.0, 0.0317, 0.0317)}
    power = 2 * (6.69 * 0.1 + 0.468 * 2.0) * 0.1
    assert metrics(given)['energy_j'] == pytest.approx(power * (COUNT - 1 - 250) * 0.004)


def test_braking_returns_no_energy(metrics):
    given = {PLANT_JOINT_STATES: series(-20.0, 0.0, 0.0317, 0.0)}
    assert metrics(given)['energy_j'] == 0.0


def test_the_gyro_offset_is_the_reading_minus_the_estimated_rate(metrics):
    given = {
        GYRO_IMU: series(*np.radians([600.0, 597.0])),
        PLANT_IMU: series(0.0, 0.0, *np.radians([-1.0, 0.0])),
        CONTROLLER_STATE: series(*[0.0] * 4, *np.radians([-3.0, 0.5]), *[0.0] * 4),
    }
    measured = metrics(given)
    assert measured['gyro_offset_error_x_deg_per_s'] == pytest.approx(2.0)
    assert measured['gyro_offset_error_y_deg_per_s'] == pytest.approx(0.5)


def test_estimation_errors_count_only_while_the_controller_is_active(metrics):
    believed = np.where(np.arange(COUNT) < 250, 0.0, 0.02)
    given = {
        PLANT_IMU: series(0.0, 0.0, 0.0, 0.0),
        PLANT_ODOM: series(0.026, 0.0),
        CONTROLLER_STATE: series(1.0, believed, 0.0, believed, *[0.0] * 6),
    }
    measured = metrics(given)
    assert measured['pitch_error_rms_deg'] == pytest.approx(math.degrees(0.02))
    assert measured['position_error_rms_m'] == pytest.approx(0.0, abs=1e-12)
    stopped = metrics(given, states=(Interval(0.0, 4.0, 'out_of_control'),))
    assert math.isnan(stopped['pitch_error_rms_deg'])


def test_states_are_timed_and_the_lowest_voltage_is_found(metrics):
    states = (
        Interval(0.0, 1.0, 'calibration'),
        Interval(1.0, 2.5, 'forward'),
        Interval(2.5, 3.0, 'rightward'),
        Interval(3.0, 4.0, 'forward'),
    )
    volts = 8.0 - 0.5 * (np.arange(COUNT) == 700)
    measured = metrics({BATTERY_STATE: series(volts)}, states=states)
    assert measured['time_in_forward_s'] == pytest.approx(2.5)
    assert measured['time_in_balance_s'] == 0.0
    assert measured['lowest_battery_v'] == 7.5


@pytest.mark.parametrize('lockstep', [True, False])
def test_counters_are_the_last_that_the_nodes_reported(metrics, lockstep):
    def status(role, **values):
        return Status(f'/any/{role}: loop', 'OK', 0, ('role', *values), (role, *values.values()))

    statuses = []
    for second, hertz in enumerate(('0.0', '200.0', '240.0', '250.0')):
        counters = {'late ticks': str(second), 'resends': '7', 'rate [Hz]': hertz}
        statuses.append((float(second), status('plant_sim', **counters)))
    statuses.append((4.0, status('controller', **{'late ticks': '100'})))
    plant = PlantParameters(lockstep=lockstep)
    measured = metrics(statuses=tuple(statuses), plant=plant)
    assert measured['late_ticks'] == (3.0 if lockstep else 103.0)
    assert measured['resends'] == 7.0
    assert measured['tick_rate_hz'] == 240.0


def test_the_numbers_of_the_shipped_run(short_assessment):
    """Golden: the document's stationary robot, for three seconds."""
    golden = {
        'settling_time_s': 1.132,
        'peak_pitch_deg': 4.061,
        'time_in_calibration_s': 1.0,
        'time_in_remote_s': 2.0,
        'lowest_battery_v': 8.0,
        'missing_ticks': 0.0,
        'tick_jitter_ms': 0.0,
    }
    measured = {name: short_assessment.metrics[name] for name in golden}
    assert measured == pytest.approx(golden, rel=2e-3)
    assert 0.5 < short_assessment.metrics['energy_j'] < 5.0
    assert short_assessment.metrics['position_error_rms_m'] < 1e-3


def test_a_run_that_is_driven_has_no_settling_time_to_show(short_assessment):
    run = short_assessment.run
    sticks = run.series[GAMEPAD_JOY]
    moved = replace(sticks, values=np.where(sticks.time > 2.0, 0.5, 0.0)[:, np.newaxis])
    forward = (Interval(1.0, 2.0, 'forward'),)
    for driven, is_shown in (
        (run, True),
        (replace(run, series={**run.series, GAMEPAD_JOY: moved}), False),
        (replace(run, states=forward), False),
    ):
        shown = shown_metrics(replace(short_assessment, run=driven))
        assert ('settling_time_s' in shown) == is_shown
        assert 'peak_pitch_deg' in shown


def test_a_missed_expectation_without_a_value_is_told_in_words():
    missed = Judgement(Expectation('settling_time_s', maximum=3.0), math.nan)
    assert str(missed) == 'settling_time_s without a value instead of ≤ 3'
