"""The interface of control programs to nodes and the closed loop."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import Protocol, SupportsFloat

from ballbot_ros.brick.brick import DeviceInputs, DeviceOutputs
from ballbot_ros.text_enum import TextEnum


class ControlMode(IntEnum):
    """Mode of the control program (section 7.6), with the values in its memory."""

    STOP = 0
    CALIBRATION = 1
    CONTROL = 2


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


class Program(Protocol):
    """A control program that a node or the closed loop can run."""

    @property
    def x(self) -> PlaneEstimates:
        """Plane x."""

    @property
    def y(self) -> PlaneEstimates:
        """Plane y."""

    @property
    def control_mode(self) -> ControlMode:
        """Whether the program calibrates, controls or has stopped the motors."""

    @property
    def operating_state(self) -> OperatingState:
        """The state of figure 7-1."""

    def tick(self, elapsed_ms: int, systick_ms: int, inputs: DeviceInputs) -> DeviceOutputs:
        """Run the tasks due `elapsed_ms` after the start on the inputs of that time."""

    def run(self, tasks: Sequence[str], systick_ms: int, inputs: DeviceInputs) -> DeviceOutputs:
        """Run the tasks with these names, in this order, on the inputs of a tick."""
