"""What the shipped controllers share: when to balance, where to drive, when to give up."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

from ballbot_ros.controllers.controller import Duty, Law, LawController, P, Readings
from ballbot_ros.controllers.document.axis import LCD_MS, PROGRAM_NAME
from ballbot_ros.controllers.document.program import held_distance, logged, speed_command
from ballbot_ros.controllers.interface import Estimates, OperatingState
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.robot.brick.sensors import NO_ECHO_CM
from ballbot_ros.robot.compiler_hints import completed

OPERATING_STATES = tuple(OperatingState)
"""The states of figure 7-1 by their numbers."""

CALIBRATION, BALANCE, REMOTE, FORWARD, RIGHTWARD, BACKWARD, OUT_OF_CONTROL = range(
    len(OPERATING_STATES)
)


class DrivingConstants(NamedTuple):
    """The parameters of the document's program that driving needs, with their names."""

    is_autonomous: bool
    gp_max: int
    k_thetadot: float
    dst_thr: int
    sonar_hold: int
    time_start: int
    time_auto: int
    time_stop: int
    theta_diff_thr: float
    psi_diff_thr: float


def driving_constants(settings: ControllerParameters) -> DrivingConstants:
    """Return the constants for the parameters of the node ``controller``."""
    return DrivingConstants(
        settings.mode == 'autonomous',
        *(getattr(settings, name) for name in DrivingConstants._fields[1:]),
    )


class DrivingState(NamedTuple):
    """What drives the robot carries from one tick to the next.

    Attributes
    ----------
    operating : int
        Number of the state of figure 7-1, such as that of ``calibration``.
    offset_x, offset_y : float
        Mean gyro readings [deg/s] until the end of the calibration.
    sum_x, sum_y, samples : int
        Their sums and number.
    distance_cm, echo_ms : int
        As in :func:`~ballbot_ros.controllers.document.program.held_distance`.
    in_control_ms : int
        When both planes were last in control.
    balanced : int
        Number of ticks in which the planes were balanced.
    """

    operating: int
    offset_x: float
    offset_y: float
    sum_x: int
    sum_y: int
    samples: int
    distance_cm: int
    echo_ms: int
    in_control_ms: int
    balanced: int


STANDING_BY = DrivingState(CALIBRATION, 0.0, 0.0, 0, 0, 0, NO_ECHO_CM, 0, 0, 0)
"""The state before the first tick."""


class Motion(NamedTuple):
    """One plane's estimates and references [deg, deg/s], in the order of :class:`Estimates`."""

    theta: float
    psi: float
    theta_dot: float
    psi_dot: float
    theta_ref: float
    theta_ref_dot: float


NO_MOTION = Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class PlaneInputs(NamedTuple):
    """What the law of a plane gets.

    Attributes
    ----------
    axis : int
        0 for plane x, 1 for plane y.
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
    battery_mv : int
        Battery voltage [mV].
    """

    axis: int
    gyro: int
    rate: float
    revolution: int
    stick: int
    speed: float
    battery_mv: int


class State(NamedTuple):
    """The state of a controller that drives; those of the planes have a `motion`."""

    driving: DrivingState
    x: Any
    y: Any


def balance(constants: Any, plane: Any, inputs: PlaneInputs) -> tuple[Any, int]:
    """Return the next state of a plane, and its duty [%]: a controller's own function."""
    raise NotImplementedError


def driving_law(balance: Callable[..., tuple[Any, int]]) -> Law:
    """Return the law that balances the planes by `balance`, and decides everything else."""
    return completed(_law, 'balance', balance)


def _law(constants: Any, state: State, readings: Readings) -> tuple[State, Duty]:
    """Return the next state and the duty: sections 7.5, 7.6 and figure 7-1.

    The constants have those of :class:`DrivingConstants` as `driving`.
    """
    p = constants.driving
    driving = driven(p, state.driving, readings)
    if not _is_balanced(driving.operating):
        return State(driving, state.x, state.y), (0, 0)
    (gyro_x, gyro_y), (revolution_x, revolution_y) = readings.gyro, readings.revolutions
    vertical, horizontal = readings.sticks
    stick_x, stick_y = speed_command(
        p.is_autonomous, driving.operating in (BACKWARD, RIGHTWARD), driving.operating != BALANCE,
        (limited(vertical, p), limited(horizontal, p)), p.gp_max,
    )  # fmt: skip
    x, duty_x = balance(
        constants, state.x,
        PlaneInputs(
            0, gyro_x, gyro_x - driving.offset_x, revolution_x, stick_x,
            commanded_rate(stick_x, p), readings.battery_mv,
        ),
    )  # fmt: skip
    y, duty_y = balance(
        constants, state.y,
        PlaneInputs(
            1, gyro_y, gyro_y - driving.offset_y, revolution_y, stick_y,
            commanded_rate(stick_y, p), readings.battery_mv,
        ),
    )  # fmt: skip
    are_in_control = is_in_control(p, x.motion) and is_in_control(p, y.motion)
    driving = watched(driving, are_in_control, readings.elapsed_ms)
    return State(driving, x, y), (duty_x, duty_y)


def driven(p: DrivingConstants, state: DrivingState, readings: Readings) -> DrivingState:
    """Return the state for the readings of a tick, before the planes are balanced."""
    (
        operating, offset_x, offset_y, sum_x, sum_y, samples, distance_cm, echo_ms, in_control_ms,
        balanced,
    ) = state  # fmt: skip
    now_ms = readings.elapsed_ms
    distance_cm, echo_ms = held_distance(
        distance_cm, echo_ms, readings.distance_cm, now_ms, p.sonar_hold
    )
    if operating != OUT_OF_CONTROL:
        if now_ms < p.time_start or samples == 0:
            gyro_x, gyro_y = readings.gyro
            sum_x, sum_y, samples = sum_x + gyro_x, sum_y + gyro_y, samples + 1
            offset_x, offset_y = sum_x / samples, sum_y / samples
            in_control_ms = now_ms
        elif now_ms - in_control_ms >= p.time_stop:
            operating = OUT_OF_CONTROL
        else:
            operating = _drive_state(p, distance_cm, now_ms)
    return DrivingState(
        operating, offset_x, offset_y, sum_x, sum_y, samples, distance_cm, echo_ms, in_control_ms,
        balanced,
    )  # fmt: skip


def _drive_state(p: DrivingConstants, distance_cm: int, now_ms: int) -> int:
    """Return the state of figure 7-1 while the robot is in control."""
    obstacle = distance_cm <= p.dst_thr
    if not p.is_autonomous:
        return BACKWARD if obstacle else REMOTE
    if now_ms < p.time_auto:
        return BALANCE
    return RIGHTWARD if obstacle else FORWARD


def _is_balanced(operating: int) -> bool:
    """Return whether the planes are balanced in a state; otherwise the motors are off."""
    return operating not in (CALIBRATION, OUT_OF_CONTROL)


def limited(stick: int, p: DrivingConstants | ControllerParameters) -> int:
    """Return a stick within its largest values; a packet may hold more."""
    return max(-p.gp_max, min(p.gp_max, stick))


def commanded_rate(stick: int, p: DrivingConstants | ControllerParameters) -> float:
    """Return the ball rate [deg/s] that a stick commands."""
    return limited(stick, p) / p.gp_max * p.k_thetadot


def is_in_control(p: DrivingConstants, motion: Motion) -> bool:
    """Return whether the errors of a plane are below their thresholds (7.6)."""
    error = abs(motion.theta_ref - motion.theta)
    return error < p.theta_diff_thr and abs(motion.psi) < p.psi_diff_thr


def watched(state: DrivingState, are_in_control: bool, now_ms: int) -> DrivingState:
    """Return the state after a tick in which the planes were balanced."""
    (
        operating, offset_x, offset_y, sum_x, sum_y, samples, distance_cm, echo_ms, in_control_ms,
        balanced,
    ) = state  # fmt: skip
    return DrivingState(
        operating, offset_x, offset_y, sum_x, sum_y, samples, distance_cm, echo_ms,
        now_ms if are_in_control else in_control_ms, balanced + 1,
    )  # fmt: skip


class Reference(NamedTuple):
    """Smooth reference of the ball angle for a speed command.

    Attributes
    ----------
    theta, theta_dot, theta_ddot : float
        Ball angle [deg], its rate [deg/s] and acceleration [deg/s²].
    first : float
        The speed after the first of the two low passes [deg/s].
    """

    theta: float
    theta_dot: float
    theta_ddot: float
    first: float


NO_REFERENCE = Reference(0.0, 0.0, 0.0, 0.0)


def low_pass_share(time_constant: float) -> float:
    """Return what a low pass with a time constant [s] takes over of a change in a tick."""
    return TICK_S / (TICK_S + time_constant)


def next_reference(share: float, reference: Reference, speed: float) -> Reference:
    """Advance a reference by a tick towards a speed [deg/s].

    The speed follows the command through two equal low passes, so that the acceleration, and with
    it the pitch that it takes, does not jump. `share` is the result of :func:`low_pass_share`.
    """
    theta, theta_dot, _, first = reference
    theta += TICK_S * theta_dot
    first += share * (speed - first)
    step = share * (first - theta_dot)
    return Reference(theta, theta_dot + step, step / TICK_S, first)


class DrivingController(LawController[P]):
    """A controller that drives as the document's program does, with another law of balance.

    Its law is a :func:`driving_law`, and its state a :class:`State`; that of a plane is `at_rest`
    before the first tick.
    """

    at_rest: ClassVar[Any]

    tunable_settings: ClassVar[tuple[str, ...]] = (
        'k_thetadot',
        'dst_thr',
        'theta_diff_thr',
        'psi_diff_thr',
    )

    @classmethod
    def initial_state(cls, constants: Any) -> State:
        """Return the state before the first tick."""
        return State(STANDING_BY, cls.at_rest, cls.at_rest)

    def start(self) -> None:
        """Set the initial state, and publish its estimates."""
        super().start()
        self._publish_estimates()

    def report(self, before: Any, readings: Readings) -> None:
        """Publish estimates, operating state, tone and log as the document's program does."""
        settings, operating = self.settings, self.state.driving.operating
        if readings.elapsed_ms % LCD_MS == 0:
            self.show(PROGRAM_NAME)
        if before.driving.operating == CALIBRATION != operating:
            self.sound(settings.sound_freq, settings.sound_dur, settings.sound_volume)
        if _is_balanced(operating) and before.driving.balanced % settings.log_count == 0:
            psi_x, psi_y = before.x.motion.psi, before.y.motion.psi
            self.log(adc1=logged(psi_x / settings.lsb), adc2=logged(psi_y / settings.lsb))
        self.operating_state = OPERATING_STATES[operating]
        self._publish_estimates()

    def _publish_estimates(self) -> None:
        self.x, self.y = Estimates(*self.state.x.motion), Estimates(*self.state.y.motion)
