"""The control program and its tasks (section 7, Appendix C)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import SupportsFloat

from ballbot_ros.brick.brick import UINT32_MASK, Brick, DeviceInputs, DeviceOutputs
from ballbot_ros.brick.schedule import Schedule
from ballbot_ros.brick.units import NO_ECHO_CM
from ballbot_ros.controllers.document.axis import ONE, ZERO, Axis
from ballbot_ros.controllers.document.constants import ProgramConstants, Single
from ballbot_ros.controllers.document.tasks import PROGRAM_NAME
from ballbot_ros.controllers.glide import Glide
from ballbot_ros.controllers.interface import OperatingState
from ballbot_ros.parameters import ControllerParameters

LOWEST_TONE_HZ = 31

VOLTAGE_SLOPE = Single(1.089000027e-3)
VOLTAGE_OFFSET = Single(0.625)
_INT16_MIN, _INT16_MAX = -32768, 32767


class ControlMode(IntEnum):
    """Mode of the control program (section 7.6), with the values in its memory."""

    STOP = 0
    CALIBRATION = 1
    CONTROL = 2


def operating_state(
    control_mode: ControlMode, autonomous: bool, flag_avoid: bool, flag_auto: bool
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


def next_mode(
    elapsed: int, timer_stop: int, is_in_control: bool, calibrated: bool, time_stop: int
) -> tuple[ControlMode, int]:
    """Return the mode and the time at which the errors were last below their thresholds (7.6).

    Parameters
    ----------
    elapsed, timer_stop : int
        Time since task_init and the previous result [ms].
    is_in_control : bool
        Whether the errors of both planes are below their thresholds.
    calibrated : bool
        Whether the time of the calibration is over.
    time_stop : int
        Time from the loss of control until the motors stop [ms].
    """
    if is_in_control:
        timer_stop = elapsed
    if (elapsed - timer_stop) & UINT32_MASK >= time_stop:
        return ControlMode.STOP, timer_stop
    return ControlMode.CONTROL if calibrated else ControlMode.CALIBRATION, timer_stop


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


def averaged_battery(battery: Single, reading_mv: int, a_b: Single) -> Single:
    """Return the averaged battery voltage [mV] after a reading [mV] (section 7.6)."""
    return (ONE - a_b) * Single(reading_mv) + a_b * battery


class ControlProgram:
    """The program on the brick: its shared data and tasks.

    Attributes
    ----------
    brick : Brick
        The devices it reads and sets.
    x, y : Axis
        The controllers of both planes.
    battery : Single
        Averaged battery voltage [mV].
    distance_cm : int
        Distance to an obstacle [cm], 255 for none: from the sonar, or the last echo while it is
        held.
    flag_avoid, flag_auto : bool
        Whether an obstacle is near; whether the time of autonomous drive has come.
    start_time, echo_time : int
        System time [ms] of task_init and of the last echo.
    timer_stop : int
        Time since task_init [ms] at which the errors were last below their thresholds.
    calibrated : bool
        Whether ``time_start`` had passed at the last task_ts3.
    log_counter : int
        Ticks since the last log packet.
    sticks : tuple of int
        Left vertical and right horizontal of the newest packet read.
    """

    def __init__(self, parameters: ControllerParameters) -> None:
        p = self._p = ProgramConstants.of(parameters)
        self._glide = Glide(parameters)
        self.brick = Brick()
        self.x, self.y = Axis(p), Axis(p)
        self._schedule = Schedule(p.tasks)
        self._reset()

    def _reset(self) -> None:
        self.x.reset()
        self.y.reset()
        self.control_mode = ControlMode.CALIBRATION
        self.battery = ZERO
        self.distance_cm = NO_ECHO_CM
        self.flag_avoid = False
        self.flag_auto = False
        self.start_time = 0
        self.timer_stop = 0
        self.calibrated = False
        self.log_counter = 0
        self.sticks = (0, 0)
        self.echo_time = 0

    def retune(self, parameters: ControllerParameters) -> None:
        """Take over gains and thresholds from the next tick on."""
        self._glide.move_to(parameters)

    def tick(self, elapsed_ms: int, systick_ms: int, inputs: DeviceInputs) -> DeviceOutputs:
        """Run the tasks due `elapsed_ms` after the start on the inputs of that time."""
        return self.run(self._schedule.due(elapsed_ms), systick_ms, inputs)

    def run(self, tasks: Sequence[str], systick_ms: int, inputs: DeviceInputs) -> DeviceOutputs:
        """Run `tasks`, in this order, on the inputs of a tick."""
        if self._glide.is_moving:
            p = self._p = ProgramConstants.of(self._glide.tick())
            self.x.retune(p)
            self.y.retune(p)
        return self.brick.tick(systick_ms, inputs, lambda: self._run_tasks(tasks))

    def _run_tasks(self, tasks: Sequence[str]) -> None:
        for name in tasks:
            getattr(self, name)()

    @property
    def operating_state(self) -> OperatingState:
        """The state of figure 7-1, as published."""
        return operating_state(
            self.control_mode, self._p.autonomous, self.flag_avoid, self.flag_auto
        )

    def task_init(self) -> None:
        """Set the initial values (section 7.3) of all variables.

        STOP and RUN restart the program without loading it, so nothing may remain from the previous
        run.
        """
        self._reset()
        self.battery = Single(self.brick.battery_mv)
        self.x.gyro_offset = Single(self.brick.gyro[0])
        self.y.gyro_offset = Single(self.brick.gyro[1])
        self.start_time = self.brick.systick_ms

    def task_ts1(self) -> None:
        """Calibrate, balance and drive, log; or stop the motors (section 7.4)."""
        brick = self.brick
        if self.control_mode == ControlMode.CONTROL:
            self.sticks = brick.read_sticks(self.sticks)
            stick_x, stick_y = speed_command(
                self._p.autonomous, self.flag_avoid, self.flag_auto, self.sticks, self._p.gp_max
            )
            max_voltage = max_motor_voltage(self.battery)
            brick.duty = (
                self.x.control(brick.gyro[0], brick.revolutions[0], stick_x, max_voltage),
                self.y.control(brick.gyro[1], brick.revolutions[1], stick_y, max_voltage),
            )
            self._log()
            return
        if self.control_mode == ControlMode.CALIBRATION:
            self.x.calibrate(brick.gyro[0])
            self.y.calibrate(brick.gyro[1])
        brick.duty = (0, 0)

    def task_ts2(self) -> None:
        """Check for an obstacle (section 7.5); the last echo bridges missed ones."""
        brick = self.brick
        self.distance_cm, self.echo_time = held_distance(
            self.distance_cm, self.echo_time, brick.read_sonar(),
            brick.systick_ms, self._p.sonar_hold,
        )  # fmt: skip
        self.flag_avoid = self.distance_cm <= self._p.dst_thr

    def task_ts3(self) -> None:
        """Decide the operating state, average the battery voltage, sound (section 7.6)."""
        p = self._p
        self.battery = averaged_battery(self.battery, self.brick.battery_mv, p.a_b)
        elapsed = (self.brick.systick_ms - self.start_time) & UINT32_MASK
        self.flag_auto = elapsed >= p.time_auto
        calibrated = elapsed >= p.time_start
        is_in_control = self.x.in_control() and self.y.in_control()
        self.control_mode, self.timer_stop = next_mode(
            elapsed, self.timer_stop, is_in_control, calibrated, p.time_stop
        )
        if calibrated and not self.calibrated:
            self.brick.sound_tone(p.sound_freq, p.sound_dur, p.sound_volume)
        self.calibrated = calibrated
        if calibrated and elapsed - p.time_start >= p.sound_dur:
            self._sound_distance()

    def _sound_distance(self) -> None:
        """Sound a tone proportional to the distance of an obstacle (section 10)."""
        p = self._p
        if p.tone_gain > 0 and 0 <= self.distance_cm < NO_ECHO_CM:
            frequency = max(LOWEST_TONE_HZ, p.tone_gain * self.distance_cm)
            self.brick.sound_tone(frequency, p.ts3_period, p.sound_volume)

    def task_lcd(self) -> None:
        """Refresh the display."""
        self.brick.show_status(PROGRAM_NAME)

    def _log(self) -> None:
        if self.log_counter == 0:
            lsb = self._p.lsb
            self.brick.log(0, 0, logged(self.x.psi / lsb), logged(self.y.psi / lsb))
        self.log_counter = (self.log_counter + 1) & 0xFF
        if self.log_counter == self._p.log_count:
            self.log_counter = 0


def max_motor_voltage(battery: Single) -> Single:
    """Return the motor voltage at full duty [V] for a battery voltage [mV], (6.1)."""
    return VOLTAGE_SLOPE * battery - VOLTAGE_OFFSET


def logged(value: SupportsFloat) -> int:
    """Return a value of the data log: rounded in double, saturated to 16 bits."""
    return max(_INT16_MIN, min(_INT16_MAX, math.floor(float(value) + 0.5)))
