"""Reading runs from recordings: complete, damaged and foreign ones."""

import math

import numpy as np
import pytest
from hypothesis import example, settings
from hypothesis import strategies as st
from laws import given, is_read_or_refused_in_one_line

from ballbot_ros import simulate
from ballbot_ros.analysis.assessment import assess
from ballbot_ros.analysis.metrics import measure
from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.engine.scenario.metrics import METRICS
from ballbot_ros.engine.trajectory import Trajectory
from ballbot_ros.errors import RecordingError
from ballbot_ros.recording.messages.topics import (
    ACCEPTED_PUSH,
    CONTROLLER_STATE,
    MOTOR_DUTY,
    PLANT_IMU,
)
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.schemas import new_message
from ballbot_ros.recording.writer import RecordingWriter


def same(one, other):
    """Return whether numbers are equal up to the rounding of a quaternion's angle."""
    return one == pytest.approx(other, rel=1e-9, abs=1e-12, nan_ok=True)


def numbers(metrics):
    return {name: math.nan if metrics[name] is None else metrics[name] for name in METRICS}


@pytest.mark.parametrize('which', ['driven', 'short'])
def test_the_metrics_are_those_that_the_run_printed(which, request):
    path, result = request.getfixturevalue(which)
    assessment = assess(read_run(path))
    assert same(numbers(assessment.metrics), numbers(result['metrics']))
    assert assessment.outcome == result['outcome']
    verdicts = [each.verdict for each in assessment.expectations]
    assert verdicts == ['met' if e['holds'] else 'not met' for e in result['expectations']]
    assert len(assessment.run.trajectory.time) == result['ticks']


def test_the_run_is_complete_and_has_its_attachments(driven_assessment):
    run = driven_assessment.run
    assert run.complete
    assert run.notices == ()
    assert (run.number, run.count) == (1, 1)
    assert run.attached.versions['ballbot_ros']
    assert [(each.name, round(each.end, 3)) for each in run.states] == [
        ('calibration', 1.0),
        ('remote', 20.0),
    ]
    assert all(each.age_ms == (0.0, 0.0) for each in run.topic_statistics)


def test_announced_pushes_do_not_age_the_messages_before_them(tmp_path):
    path = tmp_path / 'push.mcap'
    simulate('push').save(path)
    ages = {each.topic: each.age_ms for each in read_run(path).topic_statistics}
    assert ACCEPTED_PUSH.resolved() in ages
    assert set(ages.values()) == {(0.0, 0.0)}


def _is_true_of_the_beginning(part, whole):
    """Assert that everything in a part of a recording is also true of the complete run."""
    trajectory = part.run.trajectory
    count = len(trajectory.time)
    beginning = Trajectory(*(column[:count] for column in vars(whole.run.trajectory).values()))
    for column, other in zip(vars(trajectory).values(), vars(beginning).values(), strict=True):
        assert np.array_equal(column, other)
    expected = measure(beginning, whole.run.plant)
    assert same({name: part.metrics[name] for name in METRICS}, expected)
    for one, other in zip(part.expectations, whole.expectations, strict=False):
        if one.verdict != 'not judged':
            assert one.verdict == other.verdict


def assessed(path):
    """Return the assessment of a file; None if it is refused in one line."""
    found = []
    assert is_read_or_refused_in_one_line(lambda: found.append(assess(read_run(path))))
    return found


@settings(max_examples=8)
@given(st.floats(0.0, 1.0))
@example(0.5)
@example(0.995)
def test_a_truncated_recording_is_never_reported_as_complete(
    driven, driven_assessment, tmp_path_factory, share
):
    content = driven[0].read_bytes()
    path = tmp_path_factory.mktemp('cut') / 'cut.mcap'
    path.write_bytes(content[: int(share * (len(content) - 1))])
    for part in assessed(path):
        assert part.run.damage
        assert not part.run.complete
        assert part.outcome in ('incomplete', 'expectations not met')
        _is_true_of_the_beginning(part, driven_assessment)


@settings(max_examples=8)
@given(st.floats(0.0, 1.0, exclude_max=True), st.integers(1, 255))
def test_a_flipped_byte_is_harmless_or_reported(
    short, short_assessment, tmp_path_factory, place, value
):
    content = bytearray(short[0].read_bytes())
    content[int(place * len(content))] ^= value
    path = tmp_path_factory.mktemp('flip') / 'flip.mcap'
    path.write_bytes(content)
    for part in assessed(path):
        if part.run.damage is None and not part.run.notices:
            assert same(part.metrics, short_assessment.metrics)
        elif part.run.attached.has_parameters:
            _is_true_of_the_beginning(part, short_assessment)


def test_a_run_that_ends_before_the_release_proves_nothing(make_run):
    path, _ = make_run('stationary', '--set=plant_sim.duration=0.5')
    assessment = assess(read_run(path))
    assert assessment.run.complete
    assert assessment.outcome not in ('passed', 'incomplete')


def test_a_free_running_recording_has_a_notice_about_its_duties(short, copy):
    path = copy(
        short[0],
        wanted=lambda name: name != '/participants',
        attach=lambda data: data.replace(b'lockstep: true', b'lockstep: false'),
    )
    assert any('free-running' in notice for notice in read_run(path).notices)


def test_a_run_that_was_stopped_early_is_incomplete(short, copy):
    path = copy(short[0], edit=lambda raw, _: raw.data if raw.stamp_ns < 3_000_000_000 else None)
    assessment = assess(read_run(path))
    assert assessment.run.damage is None
    assert assessment.outcome == 'incomplete'
    assert '1.996 s of 3 s' in assessment.reason


LACKING = {
    '/plant/imu': {'settling_time_s', 'peak_pitch_deg', 'steady_pitch_rms_deg',
                   'pitch_error_rms_deg', 'gyro_offset_error_x_deg_per_s',
                   'gyro_offset_error_y_deg_per_s'},
    '/plant/odom': {'position_rms_m', 'peak_position_m', 'overshoot_m', 'station_rms_m',
                    'station_radius_m', 'final_position_x_m', 'final_position_y_m',
                    'distance_driven_m', 'peak_speed_m_per_s', 'position_error_rms_m',
                    'speed_error_rms_m_per_s'},
    '/motor_duty': {'duty_rms_percent', 'duty_saturated_share', 'tick_jitter_ms'},
    '/plant/joint_states': {'energy_j'},
    '/battery_state': {'lowest_battery_v'},
    '/gyro': {'gyro_offset_error_x_deg_per_s', 'gyro_offset_error_y_deg_per_s'},
    '/controller/state': {'pitch_error_rms_deg', 'position_error_rms_m', 'speed_error_rms_m_per_s',
                          'gyro_offset_error_x_deg_per_s', 'gyro_offset_error_y_deg_per_s',
                          'controlled_s', 'estimated_pitch_rms_deg', 'peak_estimated_pitch_deg',
                          'estimated_position_rms_m', 'peak_estimated_position_m'},
}  # fmt: skip


@pytest.mark.parametrize('topic', LACKING)
def test_a_missing_topic_costs_only_its_own_metrics(short, short_assessment, copy, topic):
    part = assess(read_run(copy(short[0], wanted=lambda name: name != topic)))
    for name, value in part.metrics.items():
        expected = math.nan if name in LACKING[topic] else short_assessment.metrics[name]
        assert same(value, expected), name
    assert any(topic in notice for notice in part.run.notices)
    if topic in ('/plant/imu', '/plant/odom', '/motor_duty'):
        assert part.outcome == 'incomplete'


def test_only_the_controllers_topics_are_enough(short, copy):
    kept = ('/controller/state', '/operating_state')
    run = read_run(copy(short[0], wanted=kept.__contains__))
    assert list(run.series) == [CONTROLLER_STATE]
    assert len(run.trajectory.time) == 0
    assert all(math.isnan(assess(run).metrics[name]) for name in METRICS)


def test_the_map_is_read_from_its_topic(short, copy):
    message = new_message('nav_msgs/msg/OccupancyGrid')
    message.info.width, message.info.height, message.info.resolution = 3, 2, 0.5
    message.info.origin.position.x = -1.0
    message.data = np.array([0, 0, 100, 0, 0, 0], np.int8)
    path = copy(short[0], extra={'/map': (message, 1_000_000_000)})
    grid = read_run(path).grid
    assert grid.cells.tolist() == [[0, 0, 100], [0, 0, 0]]
    assert (grid.resolution, grid.origin) == (0.5, (-1.0, 0.0))
    assert read_run(short[0]).grid is None


def test_a_namespace_is_found(short, short_assessment, tmp_path):
    path = tmp_path / 'named.mcap'
    writer = RecordingWriter(path)
    with RecordingReader(short[0]) as reader:
        topics = {
            name: writer.add_topic(name if name == '/clock' else f'/lab/one{name}', each.type_name)
            for name, each in reader.topics().items()
        }
        for raw in reader.raw_messages():
            writer.write(topics[raw.topic], raw.stamp_ns, raw.data, raw.sequence)
    writer.close()
    assert np.array_equal(
        read_run(path).trajectory.position, short_assessment.run.trajectory.position
    )


def test_a_missing_tick_is_counted_and_prevents_a_verdict(short, copy):
    dropped = []

    def lose(raw, _):
        if raw.topic == '/motor_duty' and raw.stamp_ns == 2_500_000_000:
            dropped.append(raw)
            return None
        return raw.data

    part = assess(read_run(copy(short[0], edit=lose)))
    assert len(dropped) == 1
    assert part.metrics['missing_ticks'] == 1.0
    assert part.metrics['tick_jitter_ms'] > 0.0
    assert part.outcome == 'incomplete'
    assert {each.verdict for each in part.expectations} == {'not judged'}


def test_the_last_of_two_runs_is_reported_by_default(short, driven, driven_assessment, copy):
    path = copy(driven[0], short[0])
    last = read_run(path)
    assert (last.number, last.count) == (2, 2)
    assert any('2 runs' in notice for notice in last.notices)
    assert len(last.trajectory.time) == short[1]['ticks']
    assert [each.name for each in last.states] == ['calibration', 'remote']
    first = read_run(path, 1)
    assert np.array_equal(first.trajectory.psi, driven_assessment.run.trajectory.psi)
    with pytest.raises(RecordingError, match='run 3 not found; the file has runs 1 … 2'):
        read_run(path, 3)


def test_without_attachments_the_defaults_are_used_with_a_notice(short, copy):
    part = assess(read_run(copy(short[0], attach=lambda data: None)))
    assert len(part.run.notices) == 3
    assert part.outcome == 'not judged'
    assert part.as_json()['seed'] is None


def test_a_topic_of_another_type_is_left_out(short, copy):
    run = read_run(copy(short[0], types={'/plant/imu': 'std_msgs/msg/String'}))
    assert PLANT_IMU not in run.series
    assert any('std_msgs/msg/String' in notice for notice in run.notices)


def test_a_malformed_message_is_one_line(short, copy):
    path = copy(short[0], edit=lambda raw, _: raw.data[:9] if raw.topic == '/gyro' else raw.data)
    with pytest.raises(
        RecordingError, match=r'/gyro at .* is not a valid sensor_msgs/msg/Imu'
    ) as refused:
        read_run(path)
    assert '\n' not in str(refused.value)


@pytest.mark.parametrize('kept', [['/clock'], []])
def test_a_foreign_file_is_one_line(short, copy, kept):
    with pytest.raises(RecordingError, match='not a recording of a ballbot') as refused:
        read_run(copy(short[0], wanted=kept.__contains__))
    assert '\n' not in str(refused.value)


def test_a_file_that_is_cut_near_its_start_is_said_to_be_cut(short, tmp_path):
    path = tmp_path / 'cut.mcap'
    path.write_bytes(short[0].read_bytes()[:20])
    told = 'cut.mcap: cut off at byte 20, and the rest is not a recording of a ballbot: it has none'
    with pytest.raises(RecordingError, match=told):
        read_run(path)


def test_a_run_without_ticks_is_one_line(short, copy):
    path = copy(short[0], edit=lambda raw, _: raw.data if raw.topic == '/plant/run' else None)
    with pytest.raises(RecordingError, match='nothing to report'):
        read_run(path)


def test_a_run_of_one_tick_can_be_reported(short, copy):
    path = copy(short[0], edit=lambda raw, _: raw.data if raw.stamp_ns == 1_000_000_000 else None)
    run = read_run(path)
    assert len(run.trajectory.time) == 1
    assert not run.complete
    assert len(run.series[MOTOR_DUTY].stamps) == 1
    assert assess(run).outcome == 'incomplete'
