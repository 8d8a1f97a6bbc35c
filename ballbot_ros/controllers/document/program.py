"""The control program and its tasks (section 7, Appendix C)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from enum import IntEnum
from typing import Any, NamedTuple, SupportsFloat

from ballbot_ros.controllers.document.axis import (
    AT_REST,
    LCD_MS,
    ONE,
    PROGRAM_NAME,
    TS1_MS,
    ZERO,
    AxisEstimates,
    AxisState,
    Constants,
    PlaneValues,
    ProgramConstants,
    Single,
    calibrated_offset,
    constants_of,
    control,
    in_control,
    task_timings,
)
from ballbot_ros.controllers.interface import BUS_BUSY, SAME_TICK, Glide, OperatingState
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.timing import MILLISECOND_NS
from ballbot_ros.robot.brick.bluetooth import LogPacket
from ballbot_ros.robot.brick.brick import (
    NO_SAMPLE,
    UINT32_MASK,
    DeviceInputs,
    DeviceOutputs,
    Inputs,
    Tone,
    as_numbers,
    status_page,
)
from ballbot_ros.robot.brick.job_times import JobTimes, job_times, kernel_constants, load_of
from ballbot_ros.robot.brick.kernel import TICK_US, mean_duty_delay
from ballbot_ros.robot.brick.link import is_sending, link_of, mean_analog_age
from ballbot_ros.robot.brick.schedule import TaskTiming
from ballbot_ros.robot.brick.sensors import NO_DATA_CM, NO_ECHO_CM
from ballbot_ros.robot.compiler_hints import inlined

LOWEST_TONE_HZ = 31

VOLTAGE_SLOPE = Single(1.089000027e-3)
VOLTAGE_OFFSET = Single(0.625)
_INT16_MIN, _INT16_MAX = -32768, 32767
LOG_DUTIES, LOG_GYROS = 1, 2
"""From which `log_content` on a log packet has duties, and readings of the gyros."""


class ControlMode(IntEnum):
    """Mode of the control program (section 7.6), with the values in its memory."""

    STOP = 0
    CALIBRATION = 1
    CONTROL = 2


STOP, CALIBRATION, CONTROL = (int(mode) for mode in ControlMode)
"""As plain numbers, which compare faster."""


def operating_state(
    control_mode: int, autonomous: bool, flag_avoid: bool, flag_auto: bool
) -> OperatingState:
    """Return the state of figure 7-1."""
    if control_mode == ControlMode.CALIBRATION:
        return OperatingState.CALIBRATION
    if control_mode != ControlMode.CONTROL:
        return OperatingState.OUT_OF_CONTROL
    if not autonomous:
        return OperatingState.BACKWARD if flag_avoid else OperatingState.REMOTE
    if not flag_auto:
        return OperatingState.BALANCE
    return OperatingState.RIGHTWARD if flag_avoid else OperatingState.FORWARD


def held_distance(
    distance_cm: int, echo_time: int, sonar_cm: int, now_ms: int, sonar_hold: int
) -> tuple[int, int]:
    """Return the distance to an obstacle [cm] and the time of the last echo [ms] (section 7.5).

    The last echo bridges missed ones for `sonar_hold` [ms].

    Parameters
    ----------
    distance_cm, echo_time : int
        The previous results.
    sonar_cm : int
        Reading of the sonar at the system time `now_ms`.
    """
    if sonar_cm != NO_ECHO_CM:
        return sonar_cm, now_ms
    if (now_ms - echo_time) & UINT32_MASK > sonar_hold:
        return NO_ECHO_CM, echo_time
    return distance_cm, echo_time


def speed_command(
    autonomous: bool, flag_avoid: bool, flag_auto: bool, sticks: tuple[int, int], gp_max: int
) -> tuple[int, int]:
    """Return the speed command of planes x and y (section 7.5, figure 7-1).

    In autonomous drive, the robot drives forward, and rightward at an obstacle, as in section 7.5
    and figure 7-1; the listing of Appendix C exchanges the planes.
    """
    if not autonomous:
        vertical, horizontal = sticks
        if flag_avoid:
            vertical = gp_max
        # An int8 negation leaves -128 unchanged.
        return -vertical if vertical != -128 else -128, horizontal
    if not flag_auto:
        return 0, 0
    return (0, gp_max) if flag_avoid else (gp_max, 0)


INIT, TS1, TS2, TS3, LCD = 1, 2, 4, 8, 16
"""The tasks of a tick, as bits of one number; a lower one has a higher priority."""

TASK_BITS = {'task_init': INIT, 'task_ts1': TS1, 'task_ts2': TS2, 'task_ts3': TS3, 'task_lcd': LCD}

TASK_NUMBERS = {name: number for number, name in enumerate(TASK_BITS)}
"""The number of each task in the kernel."""

PRIORITIES = tuple(each.priority for each in task_timings(20, 100))
"""The priority of each task in the kernel; it does not depend on the periods."""

DUTY_TASK, BUS_TASK = TASK_NUMBERS['task_ts1'], TASK_NUMBERS['task_ts2']
"""Those that set the duty and read the sonar."""


class ProgramState(NamedTuple):
    """Everything in the program and its devices that changes with time.

    Attributes
    ----------
    x, y : AxisState
        What the planes carry from one period to the next.
    estimates_x, estimates_y : AxisEstimates
        The newest estimates of the planes.
    control_mode : int
        A :class:`ControlMode`.
    battery : Single
        Averaged battery voltage [mV].
    distance_cm, echo_time : int
        As in :func:`held_distance`.
    flag_avoid, flag_auto : bool
        Whether an obstacle is near; whether the time of autonomous drive has come.
    start_time : int
        System time [ms] of task_init.
    timer_stop : int
        Time since task_init [ms] at which the errors were last below their thresholds.
    calibrated : bool
        Whether ``time_start`` had passed at the last task_ts3.
    log_counter : int
        Ticks since the last log packet.
    vertical, horizontal : int
        The sticks of the newest packet read.
    waiting_vertical, waiting_horizontal : int
        Those of a packet that has not been read; `NO_SAMPLE` if there is none.
    connected : bool
        Whether a packet has ever come.
    sonar_cm, sonar_reply, sonar_register : int
        The program's last reading of the sonar, the next one, and the newest sample.
    battery_mv : int
        The newest sample.
    systick_ms : int
        uint32 system time.
    gyro_x, gyro_y, revolution_x, revolution_y : int
        The newest samples.
    duty_x, duty_y : int
        Duty [%].
    has_logged, log_sonar_cm : bool, int
        Whether the tick has sent a log packet, and the reading of the sonar in it.
    has_started_tone, distance_tone_hz : bool, int
        Whether the tick has sounded the tone of the start, and the frequency of that of the
        distance, or 0.
    has_drawn : bool
        Whether the tick has drawn the display.
    """

    x: AxisState
    y: AxisState
    estimates_x: AxisEstimates
    estimates_y: AxisEstimates
    control_mode: int
    battery: Single
    distance_cm: int
    echo_time: int
    flag_avoid: bool
    flag_auto: bool
    start_time: int
    timer_stop: int
    calibrated: bool
    log_counter: int
    vertical: int
    horizontal: int
    waiting_vertical: int
    waiting_horizontal: int
    connected: bool
    sonar_cm: int
    sonar_reply: int
    sonar_register: int
    battery_mv: int
    systick_ms: int
    gyro_x: int
    gyro_y: int
    revolution_x: int
    revolution_y: int
    duty_x: int
    duty_y: int
    has_logged: bool
    log_sonar_cm: int
    has_started_tone: bool
    distance_tone_hz: int
    has_drawn: bool


NO_ESTIMATES = (ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO)

INITIAL_STATE = ProgramState(
    AT_REST, AT_REST, NO_ESTIMATES, NO_ESTIMATES, CALIBRATION, ZERO,
    NO_ECHO_CM, 0, False, False, 0, 0, False, 0, 0, 0, NO_SAMPLE, NO_SAMPLE, False,
    NO_DATA_CM, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, False, 0, False, 0, False,
)  # fmt: skip
"""The state of a brick that has just been switched on."""


@inlined
def program_tick(
    law: Constants,
    p: ProgramConstants,
    state: ProgramState,
    inputs: Inputs,
    tasks: int,
    systick_ms: int,
) -> ProgramState:
    """Return the state after some tasks, by priority, on the inputs of a tick.

    Parameters
    ----------
    law : tuple
        Result of :func:`~ballbot_ros.controllers.document.axis.constants_of` for `p`, which may be
        the row of a table.
    tasks : int
        As bits, such as :data:`TS1`, and `SAME_TICK` and `BUS_BUSY`.
    systick_ms : int
        uint32 system time [ms].
    """
    (
        x, y, estimates_x, estimates_y, control_mode, battery, distance_cm, echo_time,
        flag_avoid, flag_auto, start_time, timer_stop, calibrated, log_counter,
        vertical, horizontal, waiting_vertical, waiting_horizontal, connected,
        sonar_cm, sonar_reply, sonar_register, battery_mv, _, _, _, _, _, duty_x, duty_y,
        has_logged, log_sonar_cm, has_started_tone, distance_tone_hz, has_drawn,
    ) = state  # fmt: skip
    gyro_x, gyro_y, revolution_x, revolution_y, new_sonar, new_battery, stick, across = inputs
    if not tasks & SAME_TICK:
        if new_sonar != NO_SAMPLE:
            sonar_register = new_sonar
        if new_battery != NO_SAMPLE:
            battery_mv = new_battery
        if stick != NO_SAMPLE:
            waiting_vertical, waiting_horizontal, connected = stick, across, True
        has_logged = has_started_tone = has_drawn = False
        distance_tone_hz = 0

    if tasks & INIT:
        # STOP and RUN restart the program without loading it, so nothing may remain from the
        # previous run (section 7.3).
        x = (Single(gyro_x), ZERO, ZERO, ZERO, ZERO, ZERO)
        y = (Single(gyro_y), ZERO, ZERO, ZERO, ZERO, ZERO)
        estimates_x = estimates_y = NO_ESTIMATES
        control_mode, battery = CALIBRATION, Single(battery_mv)
        distance_cm, echo_time, flag_avoid, flag_auto = NO_ECHO_CM, 0, False, False
        start_time, timer_stop, calibrated, log_counter = systick_ms, 0, False, 0
        vertical = horizontal = 0

    if tasks & TS1:  # calibrate, balance and drive, log; or stop the motors (section 7.4)
        duty_x = duty_y = 0
        if control_mode == CONTROL:
            if waiting_vertical != NO_SAMPLE:
                vertical, horizontal = waiting_vertical, waiting_horizontal
                waiting_vertical = NO_SAMPLE
            stick_x, stick_y = speed_command(
                p.autonomous, flag_avoid, flag_auto, (vertical, horizontal), p.gp_max
            )
            volts = max_motor_voltage(battery)
            x, estimates_x, percent_x = control(
                law, x, Single(gyro_x), Single(revolution_x), Single(stick_x), volts
            )
            y, estimates_y, percent_y = control(
                law, y, Single(gyro_y), Single(revolution_y), Single(stick_y), volts
            )
            duty_x, duty_y = int(percent_x), int(percent_y)
            has_logged, log_sonar_cm = log_counter == 0, sonar_cm
            log_counter = (log_counter + 1) & 0xFF
            if log_counter == p.log_count:
                log_counter = 0
        elif control_mode == CALIBRATION:
            x = (calibrated_offset(x[0], gyro_x, p.a_gc), x[1], x[2], x[3], x[4], x[5])
            y = (calibrated_offset(y[0], gyro_y, p.a_gc), y[1], y[2], y[3], y[4], y[5])

    if tasks & TS2:  # look for an obstacle (section 7.5)
        # nxtOSEK fetches the sensor's register over I2C after the call, so the program sees a
        # value one period of the calling task later. While the bus is busy, it sees the last one.
        if not tasks & BUS_BUSY:
            sonar_cm, sonar_reply = sonar_reply, sonar_register
        distance_cm, echo_time = held_distance(
            distance_cm, echo_time, sonar_cm, systick_ms, p.sonar_hold
        )
        flag_avoid = distance_cm <= p.dst_thr

    if tasks & LCD:
        has_drawn = True

    if tasks & TS3:  # decide the state, average the battery voltage, sound (section 7.6)
        battery = (ONE - p.a_b) * Single(battery_mv) + p.a_b * battery
        elapsed = (systick_ms - start_time) & UINT32_MASK
        flag_auto = elapsed >= p.time_auto
        was_calibrated, calibrated = calibrated, elapsed >= p.time_start
        has_started_tone = calibrated and not was_calibrated
        if in_control(estimates_x[5], estimates_x[6], p.theta_diff_thr, p.psi_diff_thr) and (
            in_control(estimates_y[5], estimates_y[6], p.theta_diff_thr, p.psi_diff_thr)
        ):
            timer_stop = elapsed
        control_mode = CONTROL if calibrated else CALIBRATION
        if (elapsed - timer_stop) & UINT32_MASK >= p.time_stop:
            control_mode = STOP
        if calibrated and elapsed - p.time_start >= p.sound_dur:
            distance_tone_hz = tone_of(distance_cm, p.tone_gain)

    return ProgramState(
        x, y, estimates_x, estimates_y, control_mode, battery, distance_cm, echo_time,
        flag_avoid, flag_auto, start_time, timer_stop, calibrated, log_counter,
        vertical, horizontal, waiting_vertical, waiting_horizontal, connected,
        sonar_cm, sonar_reply, sonar_register, battery_mv, systick_ms,
        gyro_x, gyro_y, revolution_x, revolution_y, duty_x, duty_y,
        has_logged, log_sonar_cm, has_started_tone, distance_tone_hz, has_drawn,
    )  # fmt: skip


def job_time(
    times: JobTimes, task: int, control_mode: int, has_logged: bool, has_tone: bool
) -> float:
    """Return how long a job takes [µs].

    Parameters
    ----------
    task : int
        One of :data:`TASK_NUMBERS`.
    control_mode : int
        That of a job of task_ts1.
    has_logged, has_tone : bool
        Whether a job of task_ts1 sends a log packet, and whether one of task_ts3 starts a tone.
    """
    if task == 1:
        if control_mode == CONTROL:
            return times.control + (times.log if has_logged else 0.0)
        return times.calibration if control_mode == CALIBRATION else times.stop
    if task == 2:
        return times.obstacle
    if task == 3:
        return times.state + (times.tone if has_tone else 0.0)
    return times.display if task == 4 else times.init


def longest_times(times: JobTimes) -> dict[str, float]:
    """Return how long a job of each task takes on its longest path [µs]."""
    return {
        task: max(job_time(times, number, mode, True, True) for mode in ControlMode)
        for task, number in TASK_NUMBERS.items()
    }


def mean_delays(p: Any) -> tuple[float, float]:
    """Return the mean age of the gyro's readings and the mean delay of duties in control [ms].

    They are those of kernel and link.
    """
    link, times = link_of(p), job_times(p)
    job_us = job_time(times, DUTY_TASK, CONTROL, has_logged=False, has_tone=False)
    mean_us = job_us * (1.0 + 0.5 * times.variation)
    duty_us = mean_duty_delay(kernel_constants(p), mean_us, is_sending(link, 0))
    return mean_analog_age(link) / MILLISECOND_NS, duty_us / TICK_US


def task_load(p: Any) -> Any:
    """Return the share of the processor that the tasks take in control.

    The parameters may be columns.
    """
    log = p.log_instructions / p.log_count, p.bluetooth_time / p.log_count
    tone = p.tone_gain > 0
    return (
        load_of(p, p.control_instructions + log[0], log[1], 1000.0 * TS1_MS)
        + load_of(p, p.obstacle_instructions, 0.0, 1000.0 * p.ts2_period)
        + load_of(p, p.state_instructions, tone * p.tone_time, 1000.0 * p.ts3_period)
        + load_of(p, p.display_instructions, p.display_time, 1000.0 * LCD_MS)
    )


class ControlProgram:
    """The program on the brick; its `state` is everything that changes with time."""

    def __init__(self, parameters: ControllerParameters) -> None:
        self._glide = Glide(parameters)
        self._use(parameters)
        self.state = INITIAL_STATE

    def _use(self, parameters: ControllerParameters) -> None:
        self._p = ProgramConstants.of(parameters)
        self._law = constants_of(self._p)

    def copy(self) -> ControlProgram:
        """Return a program in the same state, which goes on by itself."""
        twin = copy(self)
        twin._glide = copy(self._glide)
        return twin

    @property
    def tasks(self) -> tuple[TaskTiming, ...]:
        """The tasks, as they are numbered in the kernel."""
        return self._p.tasks

    def retune(self, parameters: ControllerParameters) -> None:
        """Take over gains and thresholds from the next tick on."""
        self._glide.move_to(parameters)

    def restart(self) -> None:
        """Do nothing: task_init, which runs first, leaves nothing of what was before."""

    def run(
        self, tasks: Sequence[str], systick_ms: int, inputs: DeviceInputs, flags: int = 0
    ) -> DeviceOutputs:
        """Run `tasks` on the inputs of a tick, by priority."""
        for name in tasks:
            flags |= TASK_BITS[name]
        if self._glide.is_moving and not flags & SAME_TICK:
            self._use(self._glide.tick())
        self.state = program_tick(
            self._law, self._p, self.state, as_numbers(inputs), flags, systick_ms & UINT32_MASK
        )
        return self.outputs_of(self.state)

    def job_time(self, task: str, outputs: DeviceOutputs, times: JobTimes) -> float:
        """Return how long the job takes that has just run [µs]."""
        number, mode = TASK_NUMBERS[task], self.state.control_mode
        return job_time(times, number, mode, bool(outputs.log), bool(outputs.tones))

    def outputs_of(self, state: ProgramState) -> DeviceOutputs:
        """Return the outputs of the tick after which the program has a state."""
        p, outputs = self._p, DeviceOutputs((state.duty_x, state.duty_y))
        if state.has_logged:
            has_duties, has_gyros = p.log_content >= LOG_DUTIES, p.log_content >= LOG_GYROS
            outputs.log.append(
                LogPacket(
                    time_ms=state.systick_ms, data1=state.duty_x * has_duties,
                    data2=state.duty_y * has_duties, battery_mv=state.battery_mv,
                    rev_a=0, rev_b=state.revolution_x, rev_c=state.revolution_y,
                    adc1=logged(state.estimates_x[1] / p.lsb),
                    adc2=logged(state.estimates_y[1] / p.lsb),
                    adc3=min(state.gyro_x, _INT16_MAX) * has_gyros,
                    adc4=min(state.gyro_y, _INT16_MAX) * has_gyros, sonar_cm=state.log_sonar_cm,
                )
            )  # fmt: skip
        if state.has_started_tone:
            outputs.tones.append(Tone(p.sound_freq, p.sound_dur, p.sound_volume))
        if state.distance_tone_hz:
            outputs.tones.append(Tone(state.distance_tone_hz, p.ts3_period, p.sound_volume))
        if state.has_drawn:
            outputs.pages.append(
                status_page(
                    PROGRAM_NAME,
                    systick_ms=state.systick_ms,
                    battery_mv=state.battery_mv,
                    revolutions=(0, state.revolution_x, state.revolution_y),
                    adc=(state.gyro_x, state.gyro_y, 0, 0),
                    bluetooth_connected=state.connected,
                    sonar_cm=state.sonar_cm,
                )
            )
        return outputs

    @property
    def x(self) -> PlaneValues:
        """The controller of plane x."""
        return PlaneValues(*self.state.x, *self.state.estimates_x)

    @property
    def y(self) -> PlaneValues:
        """The controller of plane y."""
        return PlaneValues(*self.state.y, *self.state.estimates_y)

    @property
    def operating_state(self) -> OperatingState:
        """The state of figure 7-1, as published."""
        return self.operating_state_of(self.state)

    def operating_state_of(self, state: ProgramState) -> OperatingState:
        """Return the operating state in another state."""
        return operating_state(
            state.control_mode, self._p.autonomous, state.flag_avoid, state.flag_auto
        )


def tone_of(distance_cm: int, tone_gain: int) -> int:
    """Return the frequency [Hz] of a tone proportional to a distance, 0 for none (section 10)."""
    if tone_gain > 0 and 0 <= distance_cm < NO_ECHO_CM:
        return max(LOWEST_TONE_HZ, tone_gain * distance_cm)
    return 0


def max_motor_voltage(battery: Single) -> Single:
    """Return the motor voltage at full duty [V] for a battery voltage [mV], (6.1)."""
    return VOLTAGE_SLOPE * battery - VOLTAGE_OFFSET


def logged(value: SupportsFloat) -> int:
    """Return a value of the data log: rounded in double, saturated to 16 bits."""
    return max(_INT16_MIN, min(_INT16_MAX, math.floor(float(value) + 0.5)))
