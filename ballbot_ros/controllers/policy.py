"""Learned policies as controllers: an observation of the devices in, an action out.

The environments of :mod:`ballbot_ros.environments` compute observations and duties by the same
functions, so a policy gives the same duties there and here, bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import ClassVar, NamedTuple

from ballbot_ros.controllers.controller import MAX_DUTY, NO_READINGS, Controller, Duty, P, Readings
from ballbot_ros.controllers.driving import commanded_rate
from ballbot_ros.controllers.interface import OperatingState
from ballbot_ros.errors import short_repr
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.timing import TICK_MS
from ballbot_ros.robot.brick.sensors import quantise

DEVICE_NAMES = (
    'rate_x_deg_per_s',
    'rate_y_deg_per_s',
    'encoder_x_deg',
    'encoder_y_deg',
    'battery_v',
)
"""Names of the observation of the devices."""

DRIVING_NAMES = (
    *DEVICE_NAMES, 'distance_cm', 'commanded_rate_x_deg_per_s', 'commanded_rate_y_deg_per_s',
)  # fmt: skip
"""The same with what is needed to drive."""

Observation = tuple[float, ...]
"""An observation of the devices: :data:`DEVICE_NAMES` or :data:`DRIVING_NAMES`."""

Policy = Callable[[Observation], Sequence[float]]
"""Returns the action for an observation: the shares of full duty of planes x and y, -1 ... 1."""


class ObserverState(NamedTuple):
    """Everything in a :class:`DeviceObserver` that changes with time."""

    calibrated: bool
    offset_x: float
    offset_y: float
    sum_x: int
    sum_y: int
    ticks: int
    readings: Readings


class DeviceObserver:
    """Makes observations of the readings of a run.

    Pass the readings of every tick to :meth:`update`. A rate is the mean of the gyro's readings
    since the previous observation, minus its offset: the mean of the readings in the first
    ``time_start``, in which the robot is held still.

    Parameters
    ----------
    settings : ControllerParameters
        Gives the calibration time and the speed at full stick.
    drives : bool
        Whether the observations are those of :data:`DRIVING_NAMES`.

    Attributes
    ----------
    calibrated : bool
        Whether the offsets are known; from then on there are observations.
    readings : Readings
        Those of the newest tick.
    """

    def __init__(self, settings: ControllerParameters, *, drives: bool = False) -> None:
        self._settings = settings
        self._drives = drives
        self.calibrated = False
        self._offset_x = self._offset_y = 0.0
        self._sum_x = self._sum_y = self._ticks = 0
        self.readings = NO_READINGS

    def update(self, readings: Readings) -> None:
        """Take the readings of a tick."""
        if not self.calibrated and self._ticks and readings.elapsed_ms >= self._settings.time_start:
            self._offset_x = self._sum_x / self._ticks
            self._offset_y = self._sum_y / self._ticks
            self._sum_x = self._sum_y = self._ticks = 0
            self.calibrated = True
        gyro_x, gyro_y = readings.gyro
        self._sum_x += gyro_x
        self._sum_y += gyro_y
        self._ticks += 1
        self.readings = readings

    def observe(self) -> Observation:
        """Return the observation of the ticks since the previous one, at least one."""
        readings = self.readings
        observation = (
            self._sum_x / self._ticks - self._offset_x,
            self._sum_y / self._ticks - self._offset_y,
            float(readings.revolutions[0]),
            float(readings.revolutions[1]),
            readings.battery_mv / 1000.0,
        )
        self._sum_x = self._sum_y = self._ticks = 0
        if not self._drives:
            return observation
        return (*observation, float(readings.distance_cm), *self.commanded_rates)

    @property
    def commanded_rates(self) -> tuple[float, float]:
        """Ball rates [deg/s] of planes x and y that the sticks command."""
        vertical, horizontal = self.readings.sticks
        settings = self._settings
        return commanded_rate(-vertical, settings), commanded_rate(horizontal, settings)

    def save_state(self) -> ObserverState:
        """Return the present state."""
        return ObserverState(
            self.calibrated, self._offset_x, self._offset_y,
            self._sum_x, self._sum_y, self._ticks, self.readings,
        )  # fmt: skip

    def restore_state(self, state: ObserverState) -> None:
        """Continue from a state."""
        (
            self.calibrated, self._offset_x, self._offset_y,
            self._sum_x, self._sum_y, self._ticks, self.readings,
        ) = state  # fmt: skip


def duty_of(action: Sequence[float]) -> Duty:
    """Return the duty [%] of an action: each share of full duty is limited to ±1 and rounded.

    It rounds to the nearest whole number, halves up. It raises ValueError if the action is not two
    finite numbers.
    """
    try:
        x, y = map(float, action)
    except (TypeError, ValueError, OverflowError):
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ValueError(f'the action {short_repr(action)} is not two finite numbers')
    return _percent(x), _percent(y)


def _percent(share: float) -> int:
    return quantise(MAX_DUTY * max(-1.0, min(1.0, share)))


class PolicyController(Controller[P]):
    """A controller that runs a policy: subclass it, and implement :meth:`make_policy`.

    The motors are off until the gyros are calibrated. The policy then acts every `step_ms`; in
    between the duty is held.

    Attributes
    ----------
    step_ms : int
        Period of the actions [ms], a multiple of 4.
    drives : bool
        Whether the policy gets the observation of :data:`DRIVING_NAMES`.
    """

    step_ms: ClassVar[int] = TICK_MS
    drives: ClassVar[bool] = False

    def make_policy(self) -> Policy:
        """Return the policy for a run, in its initial state."""
        raise NotImplementedError

    def start(self) -> None:
        """Start with the motors off."""
        step_ms = self.step_ms
        if not isinstance(step_ms, int) or step_ms < TICK_MS or step_ms % TICK_MS:
            raise ValueError(f'step_ms: {step_ms!r} is not a multiple of {TICK_MS}')
        self._policy = self.make_policy()
        self._observer = DeviceObserver(self.settings, drives=self.drives)
        self._wait_ticks = 0
        self._duty: Duty = (0, 0)
        self.operating_state = OperatingState.CALIBRATION

    def tick(self, readings: Readings) -> Duty:
        """Return the duties for the readings."""
        observer = self._observer
        observer.update(readings)
        if not observer.calibrated:
            return self._duty
        if self._wait_ticks == 0:
            self.operating_state = OperatingState.REMOTE if self.drives else OperatingState.BALANCE
            self._duty = duty_of(self._policy(observer.observe()))
            self._wait_ticks = self.step_ms // TICK_MS
        self._wait_ticks -= 1
        return self._duty
