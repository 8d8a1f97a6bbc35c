"""Learned policies as controllers: an observation of the devices in, an action out.

The environments of :mod:`ballbot_ros.environments` compute observations and duties by the same
functions, so a policy gives the same duties there and here, bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple

from ballbot_ros.controllers.controller import (
    MAX_DUTY,
    Duty,
    LawController,
    P,
    Readings,
    known_distance,
)
from ballbot_ros.controllers.driving import DrivingConstants, commanded_rate, driving_constants
from ballbot_ros.controllers.interface import OperatingState
from ballbot_ros.errors import short_repr
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.timing import TICK_MS
from ballbot_ros.robot.brick.brick import NO_SAMPLE, Inputs
from ballbot_ros.robot.brick.sensors import NO_ECHO_CM, quantise
from ballbot_ros.robot.compiler_hints import compiled_as, completed

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

PolicyOnNumbers = Callable[[Any, Any, Observation], tuple[Any, Sequence[float]]]
"""Returns the next state and the action for constants, a state and an observation."""


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
    """Return the state after the samples of a tick; ``time_start`` is over if `is_calibrated`."""
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


def observation_of(
    state: ObserverState, settings: DrivingConstants | ControllerParameters
) -> DrivingObservation:
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


def duty_of_numbers(action: Sequence[float]) -> Duty:
    """Return :func:`duty_of` for an action of two numbers."""
    x, y = action
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ValueError('the action is not two finite numbers')
    return percent(x), percent(y)


@compiled_as(duty_of_numbers)
def duty_of(action: Sequence[float]) -> Duty:
    """Return the duty [%] of an action: each share of full duty is limited to ±1 and rounded.

    It rounds to the nearest whole number, halves up. It raises ValueError if the action is not two
    finite numbers.
    """
    try:
        x, y = map(float, action)
        return duty_of_numbers((x, y))
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f'the action {short_repr(action)} is not two finite numbers') from None


def percent(share: float) -> int:
    """Return the duty [%] of a share of full duty."""
    return quantise(MAX_DUTY * max(-1.0, min(1.0, share)))


class PolicyConstants(NamedTuple):
    """The constants of a policy's law; `own` are those of the policy."""

    driving: DrivingConstants
    ticks: int
    own: Any


class PolicyState(NamedTuple):
    """The state of a policy's law.

    Attributes
    ----------
    duty_x, duty_y : int
        The duty that is held [%].
    waits : int
        Number of ticks until the next action.
    own : Any
        That of the policy.
    """

    observer: ObserverState
    duty_x: int
    duty_y: int
    waits: int
    own: Any


def _law(
    constants: PolicyConstants, state: PolicyState, readings: Readings
) -> tuple[PolicyState, Duty]:
    """Return the next state and the duty, with which `policy` acts every few ticks."""
    p = constants.driving
    (gyro_x, gyro_y), (revolution_x, revolution_y) = readings.gyro, readings.revolutions
    vertical, horizontal = readings.sticks
    inputs = Inputs(
        gyro_x, gyro_y, revolution_x, revolution_y, readings.distance_cm, readings.battery_mv,
        vertical, horizontal,
    )  # fmt: skip
    observer = observer_tick(state.observer, inputs, readings.elapsed_ms >= p.time_start)
    _, duty_x, duty_y, waits, own = state
    if observer.is_calibrated:
        if waits == 0:
            own, action = policy(constants.own, own, observation_of(observer, p)[:OBSERVED])
            duty_x, duty_y = duty_of(action)
            observer = observed(observer)
            waits = constants.ticks
        waits -= 1
    return PolicyState(observer, duty_x, duty_y, waits, own), (duty_x, duty_y)


OBSERVED = len(DRIVING_NAMES)
"""Length of the observation; another one takes its place in the law of a class."""


def policy(constants: Any, act: Policy, observation: Observation) -> tuple[Policy, Sequence[float]]:
    """Let the state, any function, act: the policy of a class without one on numbers."""
    return act, act(observation)


class PolicyController(LawController[P]):
    """A controller that runs a policy: subclass it, and set `policy` or implement `make_policy`.

    The motors are off until the gyros are calibrated. The policy then acts every `step_ms`; in
    between the duty is held. A policy that is a function on numbers is compiled in studies. Its
    constants and its initial state are those of :class:`LawController`.

    Attributes
    ----------
    policy : callable
        ``policy(constants, state, observation) -> (state, action)``.
    step_ms : int
        Period of the actions [ms], a multiple of 4.
    drives : bool
        Whether the policy gets the observation of :data:`DRIVING_NAMES`.
    """

    policy: ClassVar[PolicyOnNumbers] = policy
    step_ms: ClassVar[int] = TICK_MS
    drives: ClassVar[bool] = False

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        names = DRIVING_NAMES if cls.drives else DEVICE_NAMES
        cls.law = completed(_law, 'policy', cls.policy, OBSERVED=len(names))

    def make_policy(self) -> Policy:
        """Return the policy for a run, in its initial state, as a function of observations only.

        Override it for a policy that is no function on numbers.
        """
        act, constants = type(self).policy, self.in_force.own
        state = self.initial_state(constants)

        def acts(observation: Observation) -> Sequence[float]:
            nonlocal state
            state, action = act(constants, state, observation)
            return action

        return acts

    def start(self) -> None:
        """Start with the motors off."""
        step_ms = self.step_ms
        if not isinstance(step_ms, int) or step_ms < TICK_MS or step_ms % TICK_MS:
            raise ValueError(f'step_ms: {step_ms!r} is not a multiple of {TICK_MS}')
        self._set_constants()
        is_on_numbers = type(self).policy is not policy
        own = self.initial_state(self.in_force.own) if is_on_numbers else self.make_policy()
        self.state = PolicyState(NOTHING_OBSERVED, 0, 0, 0, own)
        self.operating_state = OperatingState.CALIBRATION

    def _set_constants(self) -> None:
        super()._set_constants()
        self.in_force = PolicyConstants(
            driving_constants(self.settings), self.step_ms // TICK_MS, self.in_force
        )

    def report(self, before: PolicyState, readings: Readings) -> None:
        """Publish the operating state."""
        if self.state.observer.is_calibrated:
            self.operating_state = OperatingState.REMOTE if self.drives else OperatingState.BALANCE
