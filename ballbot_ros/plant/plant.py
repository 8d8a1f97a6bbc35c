"""The robot as a physical object: both planes, motors, battery, pushes, walls and falls."""

from __future__ import annotations

import struct
from collections import deque
from typing import NamedTuple

from ballbot_ros.brick.dead_time import DeadTime
from ballbot_ros.numerics.elementary import sine_cosine
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.plant.actuator import Actuator, motor_current, supply_current
from ballbot_ros.plant.battery import Battery, BatteryParameters
from ballbot_ros.plant.delayed_duty import DelayedDuty, DutyState
from ballbot_ros.plant.ground_truth import GroundTruth, MeasuredState, Pair, Push
from ballbot_ros.plant.integration import PlaneState, linear_step, nonlinear_step
from ballbot_ros.plant.model import PhysicalParameters
from ballbot_ros.plant.wall_contact import ContactState, Floor, WallContact, WallHit, ball_position
from ballbot_ros.timing import STEP_NS, STEPS_PER_TICK, TICK_NS

_FLOAT32 = struct.Struct('<f')


def has_fallen(psi_x: float, psi_y: float, fall_angle: float) -> bool:
    """Return whether a pitch [rad] is not within the fall angle [rad]; NaN is not."""
    return not (-fall_angle < psi_x < fall_angle and -fall_angle < psi_y < fall_angle)


def state_after_fall(state: PlaneState, fall_angle: float) -> PlaneState:
    """Return the state of a fallen plane at rest, at a pitch of at most `fall_angle` [rad]."""
    return state[0], max(-fall_angle, min(fall_angle, state[1])), 0.0, 0.0


def wheel_angle(ratio: float, theta: float, psi: float, start_psi: float) -> float:
    """Return the angle [rad] of a wheel since the start, from ball angle and pitch [rad]."""
    return ratio * (theta - (psi - start_psi))


def shaft_angle(shaft: float, wheel: float, half_play: float) -> float:
    """Return the angle of the motor shaft, which the wheel drags along within the gear play.

    The previous angle of the shaft, the wheel's angle and half of the play are in rad.
    """
    return min(wheel + half_play, max(wheel - half_play, shaft))


def add_push_forces(
    force_theta: float,
    force_psi: float,
    force: float,
    torque: float,
    psi: float,
    ball_radius: float,
    body_height: float,
) -> Pair:
    """Return the generalised forces [N·m] on theta and psi, with those of a push added.

    Parameters
    ----------
    force_theta, force_psi : float
        The other forces [N·m].
    force, torque : float
        Horizontal force at the body's centre [N] and torque [N·m] of the push.
    psi : float
        Pitch [rad].
    ball_radius, body_height : float
        Rs and L [m].
    """
    _, cosine = sine_cosine(psi)
    force_theta += force * ball_radius
    force_psi += force * body_height * cosine
    force_psi += torque
    return force_theta, force_psi


def is_release(time_ns: int, hold_until: int) -> bool:
    """Return whether the step that begins at a time [ns] is the first after the hold [ns]."""
    return time_ns - STEP_NS < hold_until <= time_ns


def released(state: PlaneState, pitch_rate: float) -> PlaneState:
    """Return the state of a plane that is released with a rate of its pitch [rad/s]."""
    return state[0], state[1], state[2], state[3] + pitch_rate


class PlantState(NamedTuple):
    """Everything in a plant that changes with time; its parameters are not in it.

    Attributes
    ----------
    time_ns : int
        Sim time [ns].
    planes : tuple of PlaneState
        Of planes x and y.
    shaft : tuple of float
        Angles of the motor shafts [rad], if the gears have play.
    voltage : tuple of float
        Motor voltages [V].
    charge, battery_voltage : float
        Charge drawn from the battery [A·s], and its terminal voltage [V].
    pushes : tuple of Push
        The active and pending ones.
    fallen, stopped : bool
        As in :class:`Plant`.
    contact : ContactState or None
        None without walls.
    duties : DutyState or None
        None if the motors have no dead time.
    steps : tuple of MeasuredState
        The steps that are kept.
    """

    time_ns: int
    planes: tuple[PlaneState, PlaneState]
    shaft: Pair
    voltage: Pair
    charge: float
    battery_voltage: float
    pushes: tuple[Push, ...]
    fallen: bool
    stopped: bool
    contact: ContactState | None
    duties: DutyState | None
    steps: tuple[MeasuredState, ...]


class Plant:
    """Both planes of the ballbot, from one reset to the next.

    Parameters
    ----------
    start_ns : int
        Sim time [ns] of the first tick.
    floor : Floor or None
        The walls; None for an unlimited floor.

    Attributes
    ----------
    time_ns : int
        Sim time [ns].
    fallen : bool
        Whether the body has fallen.
    stopped : bool
        Whether a wall hit has ended the run (``on_wall_hit: stop``); the motors are then off.
    """

    def __init__(
        self, parameters: PlantParameters, start_ns: int, floor: Floor | None = None
    ) -> None:
        p = PhysicalParameters.from_parameters(parameters)
        self._physical = p
        self._ratio = p.ratio
        self._back_emf = p.back_emf_constant * p.ratio
        self._actuator = Actuator.from_parameters(parameters)
        self._battery = Battery(BatteryParameters.from_parameters(parameters))
        dead_time = DeadTime(
            'actuator', TICK_NS,
            parameters.actuator_delay, parameters.actuator_delay_jitter, parameters.seed,
        )  # fmt: skip
        self._delayed_duty = DelayedDuty(dead_time) if dead_time.longest else None
        self._steps: deque[MeasuredState] = deque()
        linear = parameters.plant_model == 'linear'
        make = linear_step if linear else nonlinear_step
        self._step = make(p, STEP_NS * 1e-9)
        self._hold_until = start_ns + round(parameters.hold_time * 1e9)
        self._fall_angle: float = parameters.fall_angle
        self._half_play: float = parameters.backlash / 2.0
        self._start = (parameters.start_position_x, parameters.start_position_y)
        self._start_psi: Pair = (parameters.start_pitch_x, parameters.start_pitch_y)
        self._start_rates = (parameters.start_pitch_rate_x, parameters.start_pitch_rate_y)
        self._planes: list[PlaneState] = [(0.0, psi, 0.0, 0.0) for psi in self._start_psi]
        self._shaft = [0.0, 0.0]
        self._voltage: Pair = (0.0, 0.0)
        self._pushes: list[Push] = []
        self._contact: WallContact | None = None
        if floor is not None:
            self._contact = WallContact(floor, p, linear=linear, start=self._start)
        self._stops_at_hit = parameters.on_wall_hit == 'stop'
        self.stopped = False
        self.time_ns = start_ns
        self.fallen = False

    def keep_steps(self, age: int) -> None:
        """Keep the physics steps up to this age for the truth; 0 for none.

        Steps from before the start, or before they were kept, are like the first one known.
        """
        count = age + 1 if age else 0
        if count != len(self._steps):
            known = self._steps or (self._measured_state(),)
            self._steps = deque([known[0]] * count, maxlen=count)
            self._steps.extend(known)

    def push(self, push: Push) -> None:
        """Add a disturbance; a push that has already ended has no effect."""
        self._pushes.append(push)

    @property
    def pushes(self) -> int:
        """Number of active and pending pushes."""
        return len(self._pushes)

    def tick(self, duty_x: int, duty_y: int) -> None:
        """Advance by one tick of 4 ms under integer duties within -100 ... 100 %."""
        duties = (duty_x, duty_y)
        delayed = self._delayed_duty
        if delayed:
            delayed.command(duties, self.time_ns)
        voltage_is_constant = not (delayed or self._battery.draining)
        if voltage_is_constant:
            self._apply(duties)
        for _ in range(STEPS_PER_TICK):
            if not voltage_is_constant:
                if delayed:
                    duties = delayed.at(self.time_ns)
                self._apply(duties)
                self._battery.draw(self._supply_current(duties), STEP_NS * 1e-9)
            if self.time_ns >= self._hold_until and not self.fallen:
                self._move()
            self.time_ns += STEP_NS
            if self._steps:
                self._steps.append(self._measured_state())
        if self._contact:
            self._contact.update_contact(self.time_ns)
            if self._contact.in_contact and self._stops_at_hit:
                self.stopped = True
                self._voltage = (0.0, 0.0)

    @property
    def wall_hit(self) -> bool:
        """Whether there was a wall hit in the 20 ms up to the last multiple of 20 ms."""
        return self._contact is not None and self._contact.in_contact

    @property
    def newest_hit(self) -> WallHit | None:
        """The most recent wall hit; None before the first."""
        return self._contact.newest if self._contact else None

    def _apply(self, duties: tuple[int, int]) -> None:
        volts = self._battery.voltage
        self._voltage = (
            self._actuator.voltage(duties[0], volts),
            self._actuator.voltage(duties[1], volts),
        )

    def _move(self) -> None:
        if is_release(self.time_ns, self._hold_until):
            rate_x, rate_y = self._start_rates
            self._planes = [released(self._planes[0], rate_x), released(self._planes[1], rate_y)]
        x, y = self._planes
        voltage_x, voltage_y = self._voltage
        if self._pushes:
            x = self._step(x, voltage_x, *self._pushed(0))
            y = self._step(y, voltage_y, *self._pushed(1))
        else:
            x = self._step(x, voltage_x, 0.0, 0.0)
            y = self._step(y, voltage_y, 0.0, 0.0)
        if self._contact:
            before = self._planes[0], self._planes[1]
            x, y = self._contact.resolve(before, (x, y), self.time_ns + STEP_NS)
        limit = self._fall_angle
        if has_fallen(x[1], y[1], limit):
            self.fallen = True
            x, y = state_after_fall(x, limit), state_after_fall(y, limit)
        self._planes = [x, y]
        if self._half_play:
            self._turn_shafts()

    def _turn_shafts(self) -> None:
        for plane in (0, 1):
            wheel = self._wheel_angle(plane)
            self._shaft[plane] = shaft_angle(self._shaft[plane], wheel, self._half_play)

    def _wheel_angle(self, plane: int) -> float:
        theta, psi, _, _ = self._planes[plane]
        return wheel_angle(self._ratio, theta, psi, self._start_psi[plane])

    def _pushed(self, plane: int) -> Pair:
        """Return the generalised forces [N·m] on theta and psi of the active pushes."""
        self._pushes = [push for push in self._pushes if push.end_ns > self.time_ns]
        force_theta = force_psi = 0.0
        for push in self._pushes:
            if push.start_ns <= self.time_ns:
                force_theta, force_psi = add_push_forces(
                    force_theta, force_psi, push.force[plane], push.torque[plane],
                    self._planes[plane][1], self._physical.ball_radius, self._physical.body_height,
                )  # fmt: skip
        return force_theta, force_psi

    def _current(self, plane: int) -> float:
        """Return the motor current [A], (3.16)."""
        _, _, theta_dot, psi_dot = self._planes[plane]
        return motor_current(
            self._voltage[plane],
            theta_dot,
            psi_dot,
            self._back_emf,
            self._physical.motor_resistance,
        )

    def _supply_current(self, duties: tuple[int, int]) -> float:
        return supply_current(duties[0], duties[1], self._current(0), self._current(1))

    def truth(self) -> GroundTruth:
        """Return the current state of the robot."""
        ratio, radius = self._ratio, self._physical.ball_radius
        (_, psi_x, theta_dot_x, psi_dot_x), (_, psi_y, theta_dot_y, psi_dot_y) = self._planes
        kt = self._physical.torque_constant
        volts: float = _FLOAT32.unpack(_FLOAT32.pack(self._battery.voltage))[0]
        return GroundTruth(
            self.time_ns,
            self._motor_angle(),
            (ratio * (theta_dot_x - psi_dot_x), ratio * (theta_dot_y - psi_dot_y)),
            (kt * self._current(0), kt * self._current(1)),
            (psi_x, psi_y),
            (psi_dot_x, psi_dot_y),
            self._position(),
            (radius * theta_dot_x, radius * theta_dot_y),
            volts,
            tuple(self._steps),
        )

    def _measured_state(self) -> MeasuredState:
        x, y = self._planes
        return MeasuredState(self._motor_angle(), (x[3], y[3]), self._position())

    def _motor_angle(self) -> Pair:
        if self._half_play:
            return self._shaft[0], self._shaft[1]
        return self._wheel_angle(0), self._wheel_angle(1)

    def _position(self) -> Pair:
        x, y = self._planes
        return ball_position(self._start, self._physical.ball_radius, x[0], y[0])

    def save_state(self) -> PlantState:
        """Return the present state."""
        (x, y), (shaft_x, shaft_y) = self._planes, self._shaft
        return PlantState(
            self.time_ns,
            (x, y),
            (shaft_x, shaft_y),
            self._voltage,
            self._battery.charge,
            self._battery.voltage,
            tuple(self._pushes),
            self.fallen,
            self.stopped,
            self._contact.save_state() if self._contact else None,
            self._delayed_duty.save_state() if self._delayed_duty else None,
            tuple(self._steps),
        )

    def restore_state(self, state: PlantState) -> None:
        """Continue from a state of a plant with the same parameters, start and floor."""
        self.time_ns = state.time_ns
        self._planes, self._shaft = list(state.planes), list(state.shaft)
        self._voltage = state.voltage
        self._battery.charge, self._battery.voltage = state.charge, state.battery_voltage
        self._pushes = list(state.pushes)
        self.fallen, self.stopped = state.fallen, state.stopped
        if self._contact and state.contact:
            self._contact.restore_state(state.contact)
        if self._delayed_duty and state.duties:
            self._delayed_duty.restore_state(state.duties)
        self._steps = deque(state.steps, maxlen=len(state.steps))
