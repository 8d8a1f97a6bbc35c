"""Contact of the robot with walls."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

from ballbot_ros.plant.ground_truth import Pair
from ballbot_ros.plant.integration import PlaneState
from ballbot_ros.plant.model import MassMatrix, impulse_ratio

Planes = tuple[PlaneState, PlaneState]


class Floor(Protocol):
    """The floor's free space; positions of the ball's centre [m] in plane signs."""

    @property
    def walls_as_numbers(self) -> tuple[Any, Any]:
        """The walls as in :class:`~ballbot_ros.world.world.Footprint`."""
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
