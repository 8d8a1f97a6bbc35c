"""The interface of control programs, and how they take over new values without a jump."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeAlias

from ballbot_ros.parameters import ControllerParameters, Value
from ballbot_ros.parameters.parameter import TextEnum
from ballbot_ros.robot.brick.brick import DeviceInputs, DeviceOutputs
from ballbot_ros.robot.brick.job_times import JobTimes
from ballbot_ros.robot.brick.schedule import TaskTiming

if TYPE_CHECKING:
    from ballbot_ros.controllers.document.axis import PlaneValues


class OperatingState(TextEnum):
    """State of figure 7-1, in the words of the topic ``operating_state``."""

    CALIBRATION = 'calibration'
    BALANCE = 'balance'
    REMOTE = 'remote'
    FORWARD = 'forward'
    RIGHTWARD = 'rightward'
    BACKWARD = 'backward'
    OUT_OF_CONTROL = 'out_of_control'


OUT_OF_CONTROL = (OperatingState.CALIBRATION, OperatingState.OUT_OF_CONTROL)
"""States in which the estimates mean nothing."""

SAME_TICK, BUS_BUSY = 32, 64
"""Flags of :meth:`Program.run`, beyond the bits of the document's tasks: other tasks have run in
this tick before, so that its inputs are not new, and the outputs are those of all of them; the bus
of the sonar is still busy, so that there is no new reading."""


@dataclass
class Estimates:
    """One plane's estimates and references [deg, deg/s]; NaN for what is not estimated.

    Attributes
    ----------
    theta, psi, theta_dot, psi_dot : float
        Ball angle and body pitch [deg], and their rates [deg/s].
    theta_ref, theta_ref_dot : float
        Reference of the ball angle [deg], and its rate [deg/s].
    """

    theta: float = math.nan
    psi: float = math.nan
    theta_dot: float = math.nan
    psi_dot: float = math.nan
    theta_ref: float = math.nan
    theta_ref_dot: float = math.nan


PlaneEstimates: TypeAlias = 'Estimates | PlaneValues'
"""One plane's estimates and references [deg, deg/s]."""


class Program(Protocol):
    """A control program that a node or the closed loop can run."""

    @property
    def x(self) -> PlaneEstimates:
        """Plane x."""

    @property
    def y(self) -> PlaneEstimates:
        """Plane y."""

    @property
    def operating_state(self) -> OperatingState:
        """The state of figure 7-1."""

    @property
    def tasks(self) -> Sequence[TaskTiming]:
        """Its tasks."""

    def retune(self, parameters: ControllerParameters) -> None:
        """Take over the parameters of a run that change during it, from the next tick on.

        Real numbers glide to their new values, see :class:`Glide`.
        """

    def restart(self) -> None:
        """Forget all but the newest samples: STOP and RUN start the program anew."""

    def run(
        self, tasks: Sequence[str], systick_ms: int, inputs: DeviceInputs, flags: int = 0
    ) -> DeviceOutputs:
        """Run the tasks with these names, in this order, on the inputs of a tick.

        The flags are :data:`SAME_TICK` and :data:`BUS_BUSY`, if they apply.
        """

    def job_time(self, task: str, outputs: DeviceOutputs, times: JobTimes) -> float:
        """Return how long the job of a task takes that has just run with some outputs [µs]."""


GLIDE_TICKS = 125
"""Ticks in which a number reaches a new value: 0.5 s."""


class Glide:
    """Moves the real numbers among the parameters to new values, in equal steps of a tick each.

    A duty that depends on them moves as smoothly, whatever the errors are, and at the end nothing
    of the old values remains. Whole numbers, switches and texts have their new values at once. The
    values in effect are `parameters`; `is_moving` tells whether some are still on the way.
    """

    def __init__(self, parameters: ControllerParameters) -> None:
        self.parameters = self._start = self._target = parameters
        self.is_moving = False
        self._ticks = 0

    def move_to(self, parameters: ControllerParameters) -> None:
        """Begin to move to other values, from those in effect."""
        self._start, self._target = self.parameters, parameters
        self._ticks = 0
        self.is_moving = True

    def tick(self) -> ControllerParameters:
        """Return the values of the next tick."""
        self._ticks += 1
        if self._ticks < GLIDE_TICKS:
            start, share = self._start.values(), self._ticks / GLIDE_TICKS
            self.parameters = self._target.with_values(
                {
                    name: _between(start[name], value, share)
                    for name, value in self._target.values().items()
                    if value != start[name]
                }
            )
        else:
            self.parameters = self._target
        self.is_moving = self.parameters != self._target
        return self.parameters


def _between(start: Value, end: Value, share: float) -> Value:
    """Return a share of the way from one real number, or several, to others; else the end."""
    if isinstance(start, tuple) and isinstance(end, tuple):
        return tuple(a + share * (b - a) for a, b in zip(start, end, strict=True))
    if isinstance(start, float) and isinstance(end, float):
        return start + share * (end - start)
    return end
