"""A control program as the nodes and the closed loop see it, whatever computes it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from ballbot_ros.brick.brick import DeviceInputs, DeviceOutputs

CALIBRATING, OUT_OF_CONTROL = 'calibration', 'out_of_control'
DRIVE_STATES = (
    CALIBRATING, 'balance', 'remote', 'forward', 'rightward', 'backward', OUT_OF_CONTROL,
)  # fmt: skip
"""The words for the states of figure 7-1, as the topic ``operating_state`` has them."""


class Estimates(Protocol):
    """One plane's estimates and references [deg, deg/s]."""

    @property
    def theta(self) -> Any: ...  # noqa: D102
    @property
    def psi(self) -> Any: ...  # noqa: D102
    @property
    def theta_dot(self) -> Any: ...  # noqa: D102
    @property
    def psi_dot(self) -> Any: ...  # noqa: D102
    @property
    def theta_ref(self) -> Any: ...  # noqa: D102
    @property
    def theta_ref_dot(self) -> Any: ...  # noqa: D102


class Program(Protocol):
    """A control program as a node or the closed loop runs it."""

    @property
    def x(self) -> Estimates:
        """Plane x."""

    @property
    def y(self) -> Estimates:
        """Plane y."""

    @property
    def operating_state(self) -> int:
        """``STOP``, ``CALIBRATION`` or ``CONTROL``."""

    @property
    def drive_state(self) -> str:
        """The state of figure 7-1, one of :data:`DRIVE_STATES`."""

    def tick(self, elapsed_ms: int, systick_ms: int, inputs: DeviceInputs) -> DeviceOutputs:
        """Run the tasks due `elapsed_ms` after the start on the inputs of that time."""

    def run(self, tasks: Sequence[str], systick_ms: int, inputs: DeviceInputs) -> DeviceOutputs:
        """Run the tasks with these names, in this order, on the inputs of a tick."""
