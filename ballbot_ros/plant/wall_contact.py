"""Contact of the robot with walls."""

from __future__ import annotations

from typing import NamedTuple, Protocol

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


def planes_at_wall(after: Planes, stopped: Planes, y_suffices: bool, x_suffices: bool) -> Planes:
    """Return the planes at the end of a step that would end in a wall.

    Parameters
    ----------
    after : tuple of PlaneState
        The planes after the step if there were no walls.
    stopped : tuple of PlaneState
        The same planes, each stopped by :func:`state_after_impact`.
    y_suffices, x_suffices : bool
        Whether the body is free if this plane alone is stopped; y comes first.
    """
    if y_suffices:
        return after[0], stopped[1]
    if x_suffices:
        return stopped[0], after[1]
    return stopped


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
        stopped = (
            state_after_impact(before[0], after[0], self._mass, self._linear),
            state_after_impact(before[1], after[1], self._mass, self._linear),
        )
        planes = planes_at_wall(
            after,
            stopped,
            not self._floor.blocked(self._position((after[0], stopped[1]))),
            not self._floor.blocked(self._position((stopped[0], after[1]))),
        )
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
