"""Learned policies as controllers: an observation of the devices in, an action out.

The environments of :mod:`ballbot_ros.environments` compute observations and duties by the same
functions, so a policy gives the same duties there and here, bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import ClassVar, NamedTuple

from ballbot_ros.controllers.controller import (
    MAX_DUTY,
    Controller,
    Duty,
    P,
    Readings,
    known_distance,
)
from ballbot_ros.controllers.driving import commanded_rate
from ballbot_ros.controllers.interface import OperatingState
from ballbot_ros.errors import short_repr
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.timing import TICK_MS
from ballbot_ros.robot.brick.brick import NO_SAMPLE, Inputs
from ballbot_ros.robot.brick.sensors import NO_ECHO_CM, quantise

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

DrivingObservation = tuple[float, float, float, float, float, float, float, float]
"""That of :data:`DRIVING_NAMES`; it begins with that of :data:`DEVICE_NAMES`."""

Policy = Callable[[Observation], Sequence[float]]
"""Returns the action for an observation: the shares of full duty of planes x and y, -1 ... 1."""


class ObserverState(NamedTuple):
    """What observations of the devices are made of; angles in degrees, rates in deg/s.

    Attributes
    ----------
    is_calibrated : bool
        Whether the offsets of the gyros are known; from then on there are observations.
    offset_x, offset_y : float
        The mean of the gyros' readings in the first ``time_start``, in which the robot is held.
    sum_x, sum_y, ticks : int
        Sums of the gyros' readings since the previous observation, and their number.
    revolution_x, revolution_y, battery_mv, distance_cm, vertical, horizontal : int
        The newest readings of the other devices.
    """

    is_calibrated: bool
    offset_x: float
    offset_y: float
    sum_x: int
    sum_y: int
    ticks: int
    revolution_x: int
    revolution_y: int
    battery_mv: int
    distance_cm: int
    vertical: int
    horizontal: int


NOTHING_OBSERVED = ObserverState(False, 0.0, 0.0, 0, 0, 0, 0, 0, 0, NO_ECHO_CM, 0, 0)
"""The state before the first tick."""


def observer_tick(state: ObserverState, inputs: Inputs, is_calibrated: bool) -> ObserverState:
    """Return the state after the samples of a tick.

    Parameters
    ----------
    is_calibrated : bool
        Whether ``time_start`` is over.
    """
    (
        was_calibrated, offset_x, offset_y, sum_x, sum_y, ticks,
        _, _, battery_mv, distance_cm, vertical, horizontal,
    ) = state  # fmt: skip
    is_calibrated = was_calibrated or (is_calibrated and ticks > 0)
    if is_calibrated and not was_calibrated:
        offset_x, offset_y = sum_x / ticks, sum_y / ticks
        sum_x = sum_y = ticks = 0
    if inputs.battery_mv != NO_SAMPLE:
        battery_mv = inputs.battery_mv
    if inputs.sonar_cm != NO_SAMPLE:
        distance_cm = known_distance(inputs.sonar_cm)
    if inputs.vertical != NO_SAMPLE:
        vertical, horizontal = inputs.vertical, inputs.horizontal
    return ObserverState(
        is_calibrated, offset_x, offset_y,
        sum_x + inputs.gyro_x, sum_y + inputs.gyro_y, ticks + 1,
        inputs.revolution_x, inputs.revolution_y, battery_mv, distance_cm, vertical, horizontal,
    )  # fmt: skip


def observation_of(state: ObserverState, settings: ControllerParameters) -> DrivingObservation:
    """Return the observation of the ticks since the previous one, at least one.

    A rate is the mean of the gyro's readings in them, minus its offset. The settings give the speed
    at full stick.
    """
    return (
        state.sum_x / state.ticks - state.offset_x,
        state.sum_y / state.ticks - state.offset_y,
        float(state.revolution_x),
        float(state.revolution_y),
        state.battery_mv / 1000.0,
        float(state.distance_cm),
        commanded_rate(-state.vertical, settings),
        commanded_rate(state.horizontal, settings),
    )


def observed(state: ObserverState) -> ObserverState:
    """Return the state after an observation."""
    return ObserverState(
        state.is_calibrated, state.offset_x, state.offset_y, 0, 0, 0,
        state.revolution_x, state.revolution_y, state.battery_mv, state.distance_cm,
        state.vertical, state.horizontal,
    )  # fmt: skip


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
    return percent(x), percent(y)


def percent(share: float) -> int:
    """Return the duty [%] of a share of full duty."""
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
        self._observer = NOTHING_OBSERVED
        self._wait_ticks = 0
        self._duty: Duty = (0, 0)
        self.operating_state = OperatingState.CALIBRATION

    def tick(self, readings: Readings) -> Duty:
        """Return the duties for the readings."""
        settings = self.settings
        state = self._observer = observer_tick(
            self._observer,
            Inputs(
                *readings.gyro, *readings.revolutions, readings.distance_cm, readings.battery_mv,
                *readings.sticks,
            ),
            readings.elapsed_ms >= settings.time_start,
        )  # fmt: skip
        if not state.is_calibrated:
            return self._duty
        if self._wait_ticks == 0:
            self.operating_state = OperatingState.REMOTE if self.drives else OperatingState.BALANCE
            observation = observation_of(state, settings)
            known = DRIVING_NAMES if self.drives else DEVICE_NAMES
            self._duty = duty_of(self._policy(observation[: len(known)]))
            self._observer = observed(state)
            self._wait_ticks = self.step_ms // TICK_MS
        self._wait_ticks -= 1
        return self._duty
