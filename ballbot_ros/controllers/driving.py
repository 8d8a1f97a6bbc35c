"""What the shipped controllers share: when to balance, where to drive, when to give up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from ballbot_ros.brick.units import NO_ECHO_CM
from ballbot_ros.controllers.controller import TICK_MS, Duty, Readings
from ballbot_ros.controllers.interface import Estimates, OperatingState
from ballbot_ros.parameters import quantity, setting

TICK_S = TICK_MS / 1000
FULL_STICK, FULL_DUTY = 100, 100
MOTORS_OFF: Duty = (0, 0)


@dataclass(frozen=True, kw_only=True)
class DrivingParameters:
    """The parameters of :class:`Driving`, named like those of the document's program."""

    mode: Literal['remote', 'autonomous'] = setting('remote', 'drive mode', '7.3')
    k_thetadot: float = quantity(380.0, 'deg/s', (0.0, 1e4), 'ball speed at full stick', '7.7')
    dst_thr: int = quantity(30, 'cm', (-1, 255), 'obstacle avoidance threshold', '7.7')
    sonar_hold: int = quantity(
        200, 'ms', (0, 60000), 'time for which the last echo stays valid if none returns', 'project'
    )
    time_start: int = quantity(1000, 'ms', (0, 60000), 'gyro calibration time', '7.4')
    time_auto: int = quantity(5000, 'ms', (0, 3600000), 'start of autonomous drive', '7.6')
    time_stop: int = quantity(
        500, 'ms', (20, 60000), 'time from the loss of control until the motors stop', '7.6'
    )
    theta_diff_thr: float = quantity(
        600.0, 'deg', (0.0, 1e6), 'ball angle error from which control counts as lost', '7.6'
    )
    psi_diff_thr: float = quantity(
        15.0, 'deg', (0.0, 180.0), 'body pitch from which control counts as lost', '7.6'
    )
    sound_freq: int = quantity(440, 'Hz', (31, 14080), 'tone after calibration', '7.6')
    sound_dur: int = quantity(500, 'ms', (0, 65535), 'duration of that tone', '7.6')
    sound_volume: int = quantity(70, '%', (0, 100), 'volume of that tone', '7.6')


class Driving:
    """Decides everything but the balance: section 7.5, 7.6 and figure 7-1.

    Call :meth:`update` at the start of a tick. If the robot then :attr:`balances`, compute the
    duties for :attr:`sticks`, and call :meth:`watch` with the new estimates.

    Parameters
    ----------
    sound : callable
        :meth:`~ballbot_ros.controllers.controller.Controller.sound` of the controller.

    Attributes
    ----------
    state : OperatingState
        The state of figure 7-1.
    gyro_offsets : tuple of float
        Mean gyro readings [deg/s] of the planes x and y until the end of the calibration.
    """

    def __init__(
        self, parameters: DrivingParameters, sound: Callable[[int, int, int], None]
    ) -> None:
        self._p = parameters
        self._sound = sound
        self.state = OperatingState.CALIBRATION
        self.gyro_offsets = (0.0, 0.0)
        self._sums = (0, 0)
        self._samples = 0
        self._sticks = (0, 0)
        self._distance_cm = NO_ECHO_CM
        self._echo_ms = 0
        self._in_control_ms = 0

    @property
    def balances(self) -> bool:
        """Whether the controller shall balance; otherwise the motors are off."""
        return self.state not in (OperatingState.CALIBRATION, OperatingState.OUT_OF_CONTROL)

    @property
    def sticks(self) -> tuple[int, int]:
        """Speed command for the planes x and y, -100 ... 100."""
        if self.state is OperatingState.REMOTE:
            vertical, horizontal = self._sticks
            return _limited(-vertical), _limited(horizontal)
        if self.state is OperatingState.BACKWARD:
            return -FULL_STICK, _limited(self._sticks[1])
        if self.state is OperatingState.FORWARD:
            return FULL_STICK, 0
        if self.state is OperatingState.RIGHTWARD:
            return 0, FULL_STICK
        return 0, 0

    def update(self, readings: Readings) -> OperatingState:
        """Return the operating state for the readings of a tick."""
        self._sticks = readings.sticks
        self._follow_echo(readings)
        if self.state is OperatingState.OUT_OF_CONTROL:
            return self.state
        now_ms = readings.elapsed_ms
        if now_ms < self._p.time_start or not self._samples:
            self._calibrate(readings.gyro)
            self._in_control_ms = now_ms
            return self.state
        if self.state is OperatingState.CALIBRATION:
            self._sound(self._p.sound_freq, self._p.sound_dur, self._p.sound_volume)
        lost = now_ms - self._in_control_ms >= self._p.time_stop
        self.state = OperatingState.OUT_OF_CONTROL if lost else self._drive_state(now_ms)
        return self.state

    def plane(self, readings: Readings, axis: int) -> tuple[float, int, float]:
        """Return the inputs of the controller of plane x (axis 0) or y (axis 1).

        They are the gyro reading without its offset [deg/s], the motor angle [deg] and the
        commanded ball rate [deg/s].
        """
        rate = readings.gyro[axis] - self.gyro_offsets[axis]
        speed = self.sticks[axis] / FULL_STICK * self._p.k_thetadot
        return rate, readings.revolutions[axis], speed

    def watch(self, readings: Readings, x: Estimates, y: Estimates) -> None:
        """Check whether both planes are in control, by the estimates of a tick (7.6)."""
        p = self._p
        if all(
            abs(plane.theta_ref - plane.theta) < p.theta_diff_thr
            and abs(plane.psi) < p.psi_diff_thr
            for plane in (x, y)
        ):
            self._in_control_ms = readings.elapsed_ms

    def _calibrate(self, gyro: tuple[int, int]) -> None:
        self._sums = self._sums[0] + gyro[0], self._sums[1] + gyro[1]
        self._samples += 1
        self.gyro_offsets = self._sums[0] / self._samples, self._sums[1] / self._samples

    def _follow_echo(self, readings: Readings) -> None:
        """Take the newest echo; it bridges missed ones for a while."""
        if readings.distance_cm != NO_ECHO_CM:
            self._distance_cm, self._echo_ms = readings.distance_cm, readings.elapsed_ms
        elif readings.elapsed_ms - self._echo_ms > self._p.sonar_hold:
            self._distance_cm = NO_ECHO_CM

    def _drive_state(self, now_ms: int) -> OperatingState:
        obstacle = self._distance_cm <= self._p.dst_thr
        if self._p.mode == 'remote':
            return OperatingState.BACKWARD if obstacle else OperatingState.REMOTE
        if now_ms < self._p.time_auto:
            return OperatingState.BALANCE
        return OperatingState.RIGHTWARD if obstacle else OperatingState.FORWARD


class SpeedReference:
    """Smooth reference of the ball angle for a speed command.

    The speed follows the command through two equal low passes, so that the acceleration, and with
    it the pitch that it takes, does not jump.

    Parameters
    ----------
    time_constant : float
        Of each low pass [s].

    Attributes
    ----------
    theta, theta_dot, theta_ddot : float
        Ball angle [deg], its rate [deg/s] and acceleration [deg/s²].
    """

    def __init__(self, time_constant: float) -> None:
        self._share = TICK_S / (TICK_S + time_constant)
        self._first = 0.0
        self.theta = self.theta_dot = self.theta_ddot = 0.0

    def update(self, speed: float) -> None:
        """Advance by a tick towards a speed [deg/s]."""
        self.theta += TICK_S * self.theta_dot
        self._first += self._share * (speed - self._first)
        step = self._share * (self._first - self.theta_dot)
        self.theta_ddot = step / TICK_S
        self.theta_dot += step


def duty_for(voltage: float, max_voltage: float) -> int:
    """Return the duty [%] closest to a motor voltage [V]; 0 if the battery gives none."""
    if max_voltage <= 0.0:
        return 0
    share = voltage / max_voltage * FULL_DUTY
    return round(max(-FULL_DUTY, min(FULL_DUTY, share)))


def _limited(stick: int) -> int:
    """Return a stick within -100 ... 100; a packet may hold -128."""
    return max(-FULL_STICK, min(FULL_STICK, stick))
