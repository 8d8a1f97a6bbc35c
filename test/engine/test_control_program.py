"""The control program's states, commands, log and sound, with synthetic device inputs."""

from dataclasses import replace

import numpy as np
import parts
import pytest
from parts import values_of

from ballbot_ros.controllers.document.axis import ProgramConstants
from ballbot_ros.controllers.document.program import ControlProgram
from ballbot_ros.parameters import CONTROLLER
from ballbot_ros.robot.brick.bluetooth import LogPacket
from ballbot_ros.robot.brick.brick import DeviceInputs, Tone

AT_REST = DeviceInputs(
    gyro=(600, 600), revolutions=(0, 0), sonar_cm=255, battery_mv=8003, sticks=(0, 0)
)
SHORT = {'time_start': 100, 'time_auto': 300, 'time_stop': 200}


def make_program(**changes):
    return ControlProgram(values_of(CONTROLLER, **changes))


class Clock:
    """Runs a program tick by tick."""

    def __init__(self, program, systick_ms=1000):
        self.program = program
        self.elapsed_ms = 0
        self._systick_ms = systick_ms

    def run(self, until_ms, **inputs):
        """Return the outputs of the ticks up to and including `until_ms`, by their time."""
        outputs = {}
        while self.elapsed_ms <= until_ms:
            outputs[self.elapsed_ms] = parts.tick(
                self.program,
                self.elapsed_ms,
                self._systick_ms + self.elapsed_ms,
                AT_REST._replace(**inputs),
            )
            self.elapsed_ms += 4
        return outputs


def commands(mode, sonar_cm, sticks):
    """Return the signs of the speed references of planes x and y after 0.5 s."""
    program = make_program(mode=mode, **SHORT)
    Clock(program).run(500, sonar_cm=sonar_cm, sticks=sticks)
    return np.sign(program.x.theta_ref_dot), np.sign(program.y.theta_ref_dot)


def test_calibration_ends_at_the_first_task_ts3_after_time_start():
    program = make_program()
    clock = Clock(program)
    clock.run(996)
    assert program.operating_state == 'calibration'
    clock.run(1000)
    assert program.operating_state == 'remote'


def test_calibration_learns_the_gyros_offsets():
    program = make_program()
    clock = Clock(program)
    clock.run(0, gyro=(600, 600))
    clock.run(996, gyro=(596, 622))
    assert program.x.gyro_offset == pytest.approx(596, abs=1e-3)
    assert program.y.gyro_offset == pytest.approx(622, abs=1e-3)


def test_autonomous_drive_balances_until_time_auto():
    program = make_program(mode='autonomous')
    clock = Clock(program)
    states = {}
    for until_ms in (996, 1000, 4996, 5000):
        clock.run(until_ms)
        states[until_ms] = program.operating_state
    assert states == {996: 'calibration', 1000: 'balance', 4996: 'balance', 5000: 'forward'}


@pytest.mark.parametrize(
    ('mode', 'sonar_cm', 'state'),
    [
        ('remote', 255, 'remote'),
        ('remote', 31, 'remote'),
        ('remote', 30, 'backward'),
        ('autonomous', 255, 'forward'),
        ('autonomous', 31, 'forward'),
        ('autonomous', 30, 'rightward'),
        ('autonomous', 0, 'rightward'),
    ],
)
def test_an_obstacle_at_the_threshold_or_nearer_changes_the_state(mode, sonar_cm, state):
    program = make_program(mode=mode, **SHORT)
    Clock(program).run(500, sonar_cm=sonar_cm)
    assert program.operating_state == state


def test_the_program_sees_an_obstacle_20_ms_after_the_sonar():
    program = make_program(**SHORT)
    clock = Clock(program)
    clock.run(316)
    clock.run(336, sonar_cm=10)
    assert program.operating_state == 'remote'
    clock.run(340, sonar_cm=10)
    assert program.operating_state == 'backward'


def test_before_the_first_answer_the_sonar_reads_zero_and_that_is_an_obstacle():
    program = make_program(time_start=0)
    clock = Clock(program)
    clock.run(16)
    assert (program.state.distance_cm, program.operating_state) == (0, 'backward')
    clock.run(20)
    assert (program.state.distance_cm, program.operating_state) == (255, 'remote')


def states(clock, readings):
    """Return the drive state once the program has seen each reading of the sonar [cm].

    The readings are 20 ms apart, and each is seen 20 ms later.
    """
    found = []
    for sonar_cm in [*readings, readings[-1]]:
        clock.run(clock.elapsed_ms + 16, sonar_cm=sonar_cm)
        found.append(clock.program.operating_state)
    return found[1:]


def test_without_a_hold_a_missed_echo_counts_as_free_like_in_the_document():
    clock = Clock(make_program(**SHORT))
    clock.run(296)
    assert states(clock, [20, 255, 20]) == ['backward', 'remote', 'backward']


def test_with_a_hold_the_last_echo_counts_until_it_is_too_old():
    clock = Clock(make_program(sonar_hold=40, **SHORT))
    clock.run(296)
    there, gone = 'backward', 'remote'
    assert states(clock, [20, 255, 255, 255, 255]) == [there, there, there, gone, gone]
    assert states(clock, [20, 255, 20, 255, 255, 255]) == [there] * 5 + [gone]


def test_a_new_echo_replaces_a_held_one_at_once():
    clock = Clock(make_program(sonar_hold=1000, **SHORT))
    clock.run(296)
    assert states(clock, [20, 255, 31, 255, 254]) == ['backward'] * 2 + ['remote'] * 3


def test_the_hold_survives_the_wrap_of_the_system_time():
    clock = Clock(make_program(sonar_hold=40, **SHORT), systick_ms=2**32 - 320)
    clock.run(296)
    assert states(clock, [20, 255, 255, 255]) == ['backward'] * 3 + ['remote']


def test_the_tone_of_the_distance_is_off_by_default():
    outputs = Clock(make_program(**SHORT)).run(1000, sonar_cm=20)
    assert [tone for output in outputs.values() for tone in output.tones] == [Tone(440, 500, 70)]


def test_the_tone_of_the_distance_is_in_proportion_to_it_once_the_beep_is_over():
    clock = Clock(make_program(tone_gain=10, **{**SHORT, 'sound_dur': 200}))
    tones = {
        time: output.tones[0]
        for time, output in clock.run(500, sonar_cm=42).items()
        if output.tones
    }
    assert tones == {
        100: Tone(440, 200, 70),
        300: Tone(420, 100, 70),
        400: Tone(420, 100, 70),
        500: Tone(420, 100, 70),
    }
    for sonar_cm, frequency in ((254, 2540), (3, 31), (0, 31)):
        outputs = clock.run(clock.elapsed_ms + 200, sonar_cm=sonar_cm).values()
        assert [output.tones for output in outputs if output.tones][-1][0].frequency_hz == frequency


def test_without_an_obstacle_there_is_no_tone():
    outputs = Clock(make_program(tone_gain=10, **SHORT)).run(2000, sonar_cm=255)
    assert sum(len(output.tones) for output in outputs.values()) == 1


@pytest.mark.parametrize(
    ('sticks', 'signs'),
    [
        ((-100, 0), (1, 0)),
        ((100, 0), (-1, 0)),
        ((0, 100), (0, 1)),
        ((0, -100), (0, -1)),
        ((-50, -50), (1, -1)),
        ((0, 0), (0, 0)),
    ],
)
def test_stick_up_is_forward_and_stick_right_is_rightward(sticks, signs):
    assert commands('remote', 255, sticks) == signs


@pytest.mark.parametrize('vertical', [-100, 0, 100])
def test_at_an_obstacle_remote_drive_backs_off_and_still_steers(vertical):
    assert commands('remote', 20, (vertical, 40)) == (-1, 1)


def test_autonomous_drive_goes_forward_and_turns_rightward_at_an_obstacle():
    assert commands('autonomous', 255, (0, 0)) == (1, 0)
    assert commands('autonomous', 20, (0, 0)) == (0, 1)


def test_autonomous_drive_ignores_the_sticks():
    assert commands('autonomous', 255, (100, -100)) == (1, 0)


def test_the_last_stick_is_kept_while_no_packet_comes():
    program = make_program(**SHORT)
    clock = Clock(program)
    clock.run(300, sticks=(-100, 0))
    reference = program.x.theta_ref_dot
    clock.run(500, sticks=None)
    assert program.x.theta_ref_dot > reference


def test_a_newer_packet_replaces_one_that_was_not_read():
    """While the program calibrates, it reads no packet."""
    program = make_program(**SHORT)
    clock = Clock(program)
    clock.run(40, sticks=(-100, 0))
    clock.run(48, sticks=(100, 0))
    clock.run(300, sticks=None)
    assert program.x.theta_ref_dot < 0


def test_a_lasting_lean_stops_the_motors_permanently():
    program = make_program(**SHORT)
    clock = Clock(program)
    clock.run(300)
    leaning = clock.run(496, gyro=(900, 600))
    assert program.operating_state == 'remote'
    assert any(output.duty != (0, 0) for output in leaning.values())
    clock.run(900, gyro=(900, 600))
    assert program.operating_state == 'out_of_control'
    later = clock.run(3000)
    assert program.operating_state == 'out_of_control'
    assert all(output.duty == (0, 0) for output in list(later.values())[1:])


@pytest.mark.parametrize('inputs', [{'revolutions': (800, 0)}, {'revolutions': (0, -800)}])
def test_a_ball_that_is_far_from_its_reference_is_out_of_control(inputs):
    program = make_program(**SHORT)
    clock = Clock(program)
    clock.run(300)
    clock.run(700, **inputs)
    assert program.operating_state == 'out_of_control'


def test_a_short_loss_of_control_is_forgiven():
    program = make_program(**SHORT)
    clock = Clock(program)
    clock.run(300)
    clock.run(396, revolutions=(800, 0))
    clock.run(900)
    assert program.operating_state == 'remote'


@pytest.mark.parametrize('log_count', [1, 5, 25])
def test_a_log_record_leaves_every_log_count_ticks_from_the_first_controlled_one_on(log_count):
    clock = Clock(make_program(log_count=log_count))
    logged = [time for time, output in clock.run(2000).items() if output.log]
    assert logged == list(range(1004, 2001, 4 * log_count))


def test_a_log_record_holds_the_time_and_the_pitches_in_bits():
    program = make_program(**SHORT, lsb=0.001)
    clock = Clock(program)
    outputs = clock.run(400, gyro=(600, 600))
    outputs |= clock.run(600, gyro=(610, 595))
    time, record = [(time, out.log[0]) for time, out in outputs.items() if out.log][-1]
    assert record.time_ms == 1000 + time
    assert record.battery_mv == 8003
    assert record.adc1 > 500
    assert record.adc2 < -250
    assert record.adc3 == record.adc4 == 0


@pytest.mark.parametrize(
    ('content', 'has_duties', 'has_gyros'),
    [('pitch', False, False), ('duties', True, False), ('duties_and_gyros', True, True)],
)
def test_a_log_record_has_the_duties_and_readings_of_its_tick(content, has_duties, has_gyros):
    clock = Clock(make_program(**SHORT, log_count=3, log_content=content))
    clock.run(396)
    records, seen = 0, set()
    for time in range(400, 600, 4):
        gyro = 604 + time % 13, 65535 if time > 500 else 598
        output = clock.run(time, gyro=gyro, revolutions=(time % 7, -20))[time]
        for record in output.log:
            records += 1
            seen.add(output.duty)
            assert (record.data1, record.data2) == (output.duty if has_duties else (0, 0))
            limited = gyro[0], min(gyro[1], 32767)
            assert (record.adc3, record.adc4) == (limited if has_gyros else (0, 0))
            assert LogPacket.decode(record.encode()) == record
    assert records == 17
    assert len(seen) > 5


def test_the_content_of_the_log_changes_no_duty_and_nothing_else_in_a_record():
    drives = [
        Clock(make_program(**SHORT, log_count=2, log_content=content)).run(500, gyro=(603, 596))
        for content in ('pitch', 'duties_and_gyros')
    ]
    without, complete = ([drive[time] for time in sorted(drive)] for drive in drives)
    assert [each.duty for each in without] == [each.duty for each in complete]
    others = [
        replace(record, data1=0, data2=0, adc3=0, adc4=0)
        for each in complete
        for record in each.log
    ]
    assert others == [record for each in without for record in each.log]


def test_it_beeps_once_when_the_calibration_ends():
    clock = Clock(make_program(sound_freq=880, sound_dur=250, sound_volume=10))
    tones = {time: output.tones for time, output in clock.run(5000).items() if output.tones}
    assert tones == {1000: [Tone(880, 250, 10)]}


def test_the_display_is_refreshed_every_half_second():
    pages = {time: out.pages for time, out in Clock(make_program()).run(1600).items() if out.pages}
    assert list(pages) == [0, 500, 1000, 1500]
    assert all(len(page) == 1 for page in pages.values())
    assert pages[0][0].startswith('NXT BALLBOT')


def test_the_tasks_are_those_of_the_oil_file():
    parameters = ProgramConstants.of(values_of(CONTROLLER))
    tasks = {name: timing for name, *timing in parameters.tasks}
    assert tasks == {
        'task_init': [5, 0],
        'task_ts1': [4, 4],
        'task_ts2': [3, 20],
        'task_ts3': [2, 100],
        'task_lcd': [1, 500],
    }


def test_the_battery_is_averaged_ten_times_a_second():
    program = make_program()
    clock = Clock(program)
    clock.run(96)
    assert program.state.battery == 8003
    clock.run(196, battery_mv=7005)
    assert program.state.battery == pytest.approx(7803.4)
    clock.run(5000, battery_mv=7005)
    assert program.state.battery == pytest.approx(7005, abs=0.1)


def test_a_weaker_battery_gives_more_duty():
    def duty(battery_mv):
        clock = Clock(make_program(**SHORT))
        clock.run(200, battery_mv=battery_mv)
        return clock.run(240, battery_mv=battery_mv, revolutions=(20, 0))[240].duty[0]

    assert duty(7000) > duty(8000) > 0


def test_the_run_may_begin_at_any_system_time():
    def outputs(systick_ms):
        clock = Clock(make_program(**SHORT), systick_ms)
        return [out.duty for out in clock.run(600, gyro=(601, 600)).values()]

    assert outputs(0) == outputs(1000) == outputs(2**32 - 300)
