"""What the shipped controllers share: when to balance, where to drive, when to give up."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple, Protocol

from ballbot_ros.controllers.controller import Controller, Duty, P, Readings
from ballbot_ros.controllers.document.axis import LCD_MS, PROGRAM_NAME
from ballbot_ros.controllers.document.program import logged
from ballbot_ros.controllers.interface import Estimates, OperatingState
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.robot.brick.sensors import NO_ECHO_CM

MOTORS_OFF: Duty = (0, 0)


class PlaneInputs(NamedTuple):
    """What the controller of a plane gets.

    Attributes
    ----------
    gyro : int
        Gyro reading [deg/s + offset].
    rate : float
        The same without the offset at the calibration [deg/s].
    revolution : int
        Motor angle [deg].
    stick : int
        Speed command, -gp_max ... gp_max.
    speed : float
        Ball rate that it commands [deg/s].
    """

    gyro: int
    rate: float
    revolution: int
    stick: int
    speed: float


class PlaneController(Protocol):
    """The controller of one plane, with its state; both planes are alike."""

    @property
    def estimates(self) -> Estimates:
        """What it estimates, updated by each call."""

    def duty(self, readings: Readings, inputs: PlaneInputs) -> int:
        """Return the duty [%]."""

    def retune(self, parameters: Any, settings: ControllerParameters) -> None:
        """Use other gains."""


class DrivingController(Controller[P]):
    """A controller that drives as the document's program does, with another law of balance."""

    tunable_settings: ClassVar[tuple[str, ...]] = (
        'k_thetadot',
        'dst_thr',
        'theta_diff_thr',
        'psi_diff_thr',
    )

    def make_plane(self) -> PlaneController:
        """Return the controller of a plane, at rest."""
        raise NotImplementedError

    def start(self) -> None:
        """Start both planes at rest."""
        self._driving = Driving(self.settings, self.sound)
        self._planes = self.make_plane(), self.make_plane()
        self._ticks = 0
        self.x, self.y = (plane.estimates for plane in self._planes)

    def retune(self, parameters: P, settings: ControllerParameters) -> None:
        """Use other gains and thresholds."""
        super().retune(parameters, settings)
        self._driving.retune(settings)
        for plane in self._planes:
            plane.retune(parameters, settings)

    def tick(self, readings: Readings) -> Duty:
        """Return the duties for the readings."""
        if readings.elapsed_ms % LCD_MS == 0:
            self.show(PROGRAM_NAME)
        driving = self._driving
        self.operating_state = driving.update(readings)
        if not driving.balances:
            return MOTORS_OFF
        if self._ticks % self.settings.log_count == 0:
            lsb = self.settings.lsb
            self.log(adc1=logged(self.x.psi / lsb), adc2=logged(self.y.psi / lsb))
        self._ticks += 1
        x, y = self._planes
        duty = (
            x.duty(readings, driving.inputs(readings, 0)),
            y.duty(readings, driving.inputs(readings, 1)),
        )
        driving.watch(readings, self.x, self.y)
        return duty


def limited(stick: int, settings: ControllerParameters) -> int:
    """Return a stick within its largest values; a packet may hold more."""
    return max(-settings.gp_max, min(settings.gp_max, stick))


def commanded_rate(stick: int, settings: ControllerParameters) -> float:
    """Return the ball rate [deg/s] that a stick commands."""
    return limited(stick, settings) / settings.gp_max * settings.k_thetadot


class Driving:
    """Decides everything but the balance: section 7.5, 7.6 and figure 7-1.

    Call :meth:`update` at the start of a tick. If the robot then :attr:`balances`, compute the
    duties for :attr:`sticks`, and call :meth:`watch` with the new estimates.

    Parameters
    ----------
    settings : ControllerParameters
        Those of the document's program: drive mode, speed, thresholds, times, tone.
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
        self, settings: ControllerParameters, sound: Callable[[int, int, int], None]
    ) -> None:
        self._p = settings
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
        """Speed command for the planes x and y, -gp_max ... gp_max."""
        if self.state is OperatingState.REMOTE:
            vertical, horizontal = self._sticks
            return limited(-vertical, self._p), limited(horizontal, self._p)
        if self.state is OperatingState.BACKWARD:
            return -self._p.gp_max, limited(self._sticks[1], self._p)
        if self.state is OperatingState.FORWARD:
            return self._p.gp_max, 0
        if self.state is OperatingState.RIGHTWARD:
            return 0, self._p.gp_max
        return 0, 0

    def retune(self, settings: ControllerParameters) -> None:
        """Use other thresholds, and another speed at full stick."""
        self._p = settings

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

    def inputs(self, readings: Readings, axis: int) -> PlaneInputs:
        """Return the inputs of the controller of plane x (axis 0) or y (axis 1)."""
        stick = self.sticks[axis]
        return PlaneInputs(
            readings.gyro[axis],
            readings.gyro[axis] - self.gyro_offsets[axis],
            readings.revolutions[axis],
            stick,
            commanded_rate(stick, self._p),
        )

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
