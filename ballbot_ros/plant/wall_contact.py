"""Contact of the robot with walls."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from ballbot_ros.plant.ground_truth import Pair
from ballbot_ros.plant.integration import PlaneState
from ballbot_ros.plant.model import MassMatrix, PhysicalParameters, impulse_ratio, mass_matrix
from ballbot_ros.timing import SLOW_PERIOD_NS

Planes = tuple[PlaneState, PlaneState]


class Floor(Protocol):
    """The floor's free space; positions of the ball's centre [m] in plane signs."""

    def blocked(self, position: Pair) -> bool:
        """Return whether the body can't be at a position."""
        ...

    def touching(self, position: Pair) -> tuple[str, ...]:
        """Return the parts of the body that would be in a wall."""
        ...


class WallHit(NamedTuple):
    """The start of a contact with a wall, at a sim time [ns].

    The ball's centre was stopped at `position` [m] in plane signs; `parts` of the body would have
    been in the wall.
    """

    time_ns: int
    position: Pair
    parts: tuple[str, ...]

    def __str__(self) -> str:
        """Return one line for the log, in the axes of ``map``."""
        x, y = round(self.position[0], 2) + 0.0, round(-self.position[1], 2) + 0.0
        return (
            f'wall hit at sim time {self.time_ns * 1e-9:.3f} s: ball at x {x:.2f} m, y {y:.2f} m '
            f'(map), {", ".join(self.parts)}'
        )


class ContactState(NamedTuple):
    """Everything in a :class:`WallContact` that changes with time.

    `since_sample` tells whether there was a contact since the last multiple of 20 ms.
    """

    since_sample: bool
    in_contact: bool
    newest: WallHit | None


def state_after_impact(
    before: PlaneState, after: PlaneState, mass: MassMatrix, linear: bool
) -> PlaneState:
    """Return the state of a plane stopped by an inelastic impulse at the ball's centre.

    The impulse acts on theta alone, so the second row of M Δ(theta', psi') = (impulse, 0) couples
    the jump of psi' to that of theta'. A wall can't pull: a plane that has reversed within the step
    keeps its velocity. The states are `before` the step, and `after` it if there were no wall.
    """
    theta, psi, theta_dot, psi_dot = after
    if (theta > before[0]) == (theta_dot > 0.0):
        psi_dot += theta_dot * impulse_ratio(mass, 0.0 if linear else psi)
        theta_dot = 0.0
    return before[0], psi, theta_dot, psi_dot


def stop_at_walls(
    is_blocked: Callable[[Any, Pair], bool],
    floor: Any,
    start: Pair,
    radius: float,
    mass: MassMatrix,
    linear: bool,
    before: Planes,
    after: Planes,
) -> Planes:
    """Return the planes at the end of a step that would end in a wall.

    The one that must stop is stopped: y if that is enough, else x, else both.

    Parameters
    ----------
    is_blocked : callable
        Takes the floor and a position, and returns whether the body can't be there.
    start : tuple of float
        Position of the ball [m] where both theta are zero.
    radius : float
        Radius of the ball [m].
    before, after : tuple of PlaneState
        The planes before the step, and after it if there were no walls.
    """
    x, y = after
    stopped_x = state_after_impact(before[0], x, mass, linear)
    stopped_y = state_after_impact(before[1], y, mass, linear)
    if not is_blocked(floor, ball_position(start, radius, x[0], stopped_y[0])):
        return x, stopped_y
    if not is_blocked(floor, ball_position(start, radius, stopped_x[0], y[0])):
        return stopped_x, y
    return stopped_x, stopped_y


def ball_position(start: Pair, radius: float, theta_x: float, theta_y: float) -> Pair:
    """Return the position of the ball [m] for its angles [rad] from `start` [m]."""
    return start[0] + radius * theta_x, start[1] + radius * theta_y


class WallContact:
    """Stops the planes, which follow the linear or the nonlinear model, at walls.

    The ball's position is `start` [m] where both theta are zero.

    Attributes
    ----------
    in_contact : bool
        Whether there was a contact in the 20 ms up to the last multiple of 20 ms.
    newest : WallHit or None
        The most recent hit; a lasting contact is one hit.
    """

    def __init__(
        self, floor: Floor, physical: PhysicalParameters, *, linear: bool, start: Pair
    ) -> None:
        self._floor = floor
        self._radius = physical.ball_radius
        self._mass = mass_matrix(physical)
        self._linear = linear
        self._start = start
        self._since_sample = False
        self.in_contact = False
        self.newest: WallHit | None = None

    def resolve(self, before: Planes, after: Planes, time_ns: int) -> Planes:
        """Return the planes at the end of a step [ns], stopped if the body would be in a wall.

        They are `before` the step, and `after` it if there were no walls.
        """
        attempted = self._position(after)
        if not self._floor.blocked(attempted):
            return after
        planes = stop_at_walls(
            type(self._floor).blocked, self._floor, self._start, self._radius,
            self._mass, self._linear, before, after,
        )  # fmt: skip
        if not (self.in_contact or self._since_sample):
            parts = self._floor.touching(attempted)
            self.newest = WallHit(time_ns, self._position(planes), parts)
        self._since_sample = True
        return planes

    def update_contact(self, time_ns: int) -> None:
        """At multiples of 20 ms, note whether there was a contact since the last one."""
        if time_ns % SLOW_PERIOD_NS == 0:
            self.in_contact, self._since_sample = self._since_sample, False

    def save_state(self) -> ContactState:
        """Return the present state."""
        return ContactState(self._since_sample, self.in_contact, self.newest)

    def restore_state(self, state: ContactState) -> None:
        """Continue from a state."""
        self._since_sample, self.in_contact, self.newest = state

    def _position(self, planes: Planes) -> Pair:
        return ball_position(self._start, self._radius, planes[0][0], planes[1][0])
