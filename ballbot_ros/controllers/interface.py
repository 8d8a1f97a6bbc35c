"""The interface of control programs to nodes and the closed loop."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, SupportsFloat

from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.text_enum import TextEnum
from ballbot_ros.robot.brick.brick import DeviceInputs, DeviceOutputs


class OperatingState(TextEnum):
    """State of figure 7-1, in the words of the topic ``operating_state``."""

    CALIBRATION = 'calibration'
    BALANCE = 'balance'
    REMOTE = 'remote'
    FORWARD = 'forward'
    RIGHTWARD = 'rightward'
    BACKWARD = 'backward'
    OUT_OF_CONTROL = 'out_of_control'


class PlaneEstimates(Protocol):
    """One plane's estimates and references [deg, deg/s]."""

    @property
    def theta(self) -> SupportsFloat: ...  # noqa: D102
    @property
    def psi(self) -> SupportsFloat: ...  # noqa: D102
    @property
    def theta_dot(self) -> SupportsFloat: ...  # noqa: D102
    @property
    def psi_dot(self) -> SupportsFloat: ...  # noqa: D102
    @property
    def theta_ref(self) -> SupportsFloat: ...  # noqa: D102
    @property
    def theta_ref_dot(self) -> SupportsFloat: ...  # noqa: D102


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

    def retune(self, parameters: ControllerParameters) -> None:
        """Take over parameters that change during a run, from the next tick on.

        Real numbers glide to their new values, see :class:`~ballbot_ros.controllers.glide.Glide`.

        Parameters
        ----------
        parameters : ControllerParameters
            Those of the run, with other values for some.
        """

    def tick(self, elapsed_ms: int, systick_ms: int, inputs: DeviceInputs) -> DeviceOutputs:
        """Run the tasks due `elapsed_ms` after the start on the inputs of that time."""

    def run(self, tasks: Sequence[str], systick_ms: int, inputs: DeviceInputs) -> DeviceOutputs:
        """Run the tasks with these names, in this order, on the inputs of a tick."""
