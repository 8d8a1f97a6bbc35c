"""What the arguments of an environment determine: parameters, observation, start and reward."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from gymnasium.error import InvalidAction

from ballbot_ros.controllers.policy import DEVICE_NAMES, DRIVING_NAMES
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.errors import EnvironmentConfigurationError, short_repr
from ballbot_ros.lab.environments.configuration import (
    Commands,
    Numbers,
    Parts,
    Task,
    Vector,
    check_hold,
    check_step,
    checked_commands,
    fingerprint,
    parameters_of_environment,
    random_commands,
    release_s,
    steps_of,
    stick_signal,
)
from ballbot_ros.parameters import (
    GYRO,
    PLANT,
    ControllerParameters,
    ParameterSet,
    PlantParameters,
    SonarParameters,
    parameters_of,
)
from ballbot_ros.parameters.files import Parameters, plain_value
from ballbot_ros.parameters.timing import TICK_MS
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.plant.ground_truth import Pair
from ballbot_ros.robot.world.sonar_beam import check_rays
from ballbot_ros.robot.world.world import World

DEVICES, STATE = 'devices', 'state'
OBSERVATIONS = (DEVICES, STATE)
MAX_SEED = 2**63 - 1


class Start(NamedTuple):
    """What differs between the episodes of an environment.

    Attributes
    ----------
    seed : int
        Seed of the device noise and jitter: the parameter ``gyro_driver.seed``.
    pitch : tuple of float
        Body pitch [rad] of planes x and y, in which the robot is held.
    """

    seed: int
    pitch: Pair
    commands: Commands = ()


RATE_DEG_PER_S = 1023.0
"""The gyro reads 0 ... 1023 deg/s, and so its offset is."""

ENCODER_DEG_PER_S = 5000.0
SPEED_M_PER_S = 2.0
"""More than motors of any battery can reach; times the duration they bound angles and distances."""


class Component(NamedTuple):
    """A component of a vector: its name, which has the unit, and the largest and least value."""

    name: str
    low: float
    high: float


def pair(name: str, bound: float) -> tuple[Component, Component]:
    """Return the quantity of planes x and y; the name has a place for the plane."""
    return Component(name.format('x'), -bound, bound), Component(name.format('y'), -bound, bound)


class Setup:
    """An environment's arguments, checked, and what follows from them.

    Attributes
    ----------
    observes_state : bool
        Whether the true state is observed, not the devices.
    step_ms, steps : int
        Period of the actions [ms], and their number in an episode.
    duration : float
        Time after which an episode is truncated [s].
    parameters : ParameterSet
        Those that all episodes have.
    """

    def __init__(
        self,
        task: Task,
        observation: object,
        step_ms: int,
        duration: float | None,
        profile: str | None,
        parameters: Parameters | None,
    ) -> None:
        """Check the arguments of :class:`~ballbot_ros.lab.environments.environment.BallbotEnv`.

        Raises
        ------
        BallbotError
            If one is not valid, the map can't be read, or the robot can't start there.
        """
        if not isinstance(observation, str) or observation not in OBSERVATIONS:
            raise EnvironmentConfigurationError(
                f'observation: {short_repr(observation)} is not {" or ".join(OBSERVATIONS)}'
            )
        self.task, self.observes_state = task, observation == STATE
        self.step_ms = check_step(step_ms)
        given = task.duration if duration is None else duration
        self.steps, self.duration = steps_of(given, self.step_ms), float(given)
        self.parameters = parameters_of_environment(profile, parameters)
        check_hold(self.parameters)
        check_rays(self.parameters.of(SonarParameters))
        World.of(self.parameters.of(PlantParameters))

    @cached_property
    def settings(self) -> ControllerParameters:
        """The parameters of the controller."""
        return self.parameters.of(ControllerParameters)

    @cached_property
    def held_ticks(self) -> int:
        """Number of ticks in which the robot is held, and the gyros are calibrated."""
        return round(release_s(self.settings) * 1000.0) // TICK_MS

    @property
    def ticks(self) -> int:
        """Number of ticks of a step."""
        return self.step_ms // TICK_MS

    @cached_property
    def fingerprint(self) -> tuple[tuple[str, object], ...]:
        """All that makes the states of two environments alike, by names."""
        return (
            ('task', self.task.name),
            ('observation', STATE if self.observes_state else DEVICES),
            ('step_ms', self.step_ms),
            ('duration', self.duration),
            *fingerprint(self.parameters),
        )

    @cached_property
    def state_components(self) -> tuple[Component, ...]:
        """Those of :data:`~ballbot_ros.engine.moved_robots.TrueState`."""
        return (
            *pair('position_{}_m', SPEED_M_PER_S * self.duration),
            *pair('velocity_{}_m_per_s', 10.0),
            *pair('pitch_{}_rad', 1.5),
            *pair('pitch_rate_{}_rad_per_s', 100.0),
            Component('battery_v', 0.0, 15.0),
        )

    @cached_property
    def components(self) -> tuple[Component, ...]:
        """Those of the observation."""
        full_rate = self.settings.k_thetadot
        if self.observes_state:
            speed = full_rate * self._metres_per_degree
            driving = pair('commanded_velocity_{}_m_per_s', speed) if self.task.drives else ()
            return (*self.state_components, *driving)
        components = (
            *pair('rate_{}_deg_per_s', RATE_DEG_PER_S),
            *pair('encoder_{}_deg', ENCODER_DEG_PER_S * self.duration),
            Component('battery_v', 0.0, 15.0),
            Component('distance_cm', 0.0, 255.0),
            *pair('commanded_rate_{}_deg_per_s', full_rate),
        )
        assert tuple(each.name for each in components) == DRIVING_NAMES
        return components if self.task.drives else components[: len(DEVICE_NAMES)]

    @cached_property
    def space(self) -> spaces.Box[np.float64]:
        """The space of the observations."""
        ends = ('low', 'high')
        low, high = (np.array([getattr(each, end) for each in self.components]) for end in ends)
        return spaces.Box(low, high, dtype=np.float64)

    @cached_property
    def _metres_per_degree(self) -> float:
        return math.radians(self.parameters.of(PlantParameters).ball_radius)

    def observation(self, measured: Vector, state: Vector) -> Vector:
        """Return the components of an observation, given that of the devices and the true state.

        The devices' are named by :data:`~ballbot_ros.controllers.policy.DRIVING_NAMES`.
        """
        if not self.observes_state:
            return measured[: len(self.components)]
        return (*state, *self._commanded(measured)) if self.task.drives else state

    def bound(self, observations: Floats) -> None:
        """Limit observations to their bounds, as a saturated device would report them."""
        np.maximum(observations, self.space.low, out=observations)
        np.minimum(observations, self.space.high, out=observations)

    def reward(self, measured: Vector, state: Vector, duty: Vector) -> tuple[Numbers, Parts]:
        """Return the reward of a step, and its parts by the names that they have in the info."""
        return self.task.reward(state, self._commanded(measured), duty)

    def _commanded(self, measured: Vector) -> Vector:
        x, y = measured[-2:]
        return x * self._metres_per_degree, y * self._metres_per_degree

    def checked_options(self, options: object) -> dict[str, Any]:
        """Return the options of a reset; refuse those that are not valid."""
        if options is None:
            return {}
        if not isinstance(options, Mapping):
            raise EnvironmentConfigurationError(f'options: {short_repr(options)} are no mapping')
        nodes = {'start_pitch_x': PLANT, 'start_pitch_y': PLANT, 'seed': GYRO}
        known = (*nodes, *(['commands'] if self.task.drives else []))
        if unknown := [name for name in options if name not in known]:
            raise EnvironmentConfigurationError(
                f'options: unknown {short_repr(unknown[0])}; known: {", ".join(known)}'
            )
        return {
            name: parameters_of(nodes[name])[name].check(plain_value(value), 'options: ')
            if name in nodes
            else checked_commands(value)
            for name, value in options.items()
        }

    def start(self, generator: np.random.Generator, given: Mapping[str, Any]) -> Start:
        """Draw a start, and replace what is given."""
        seed = int(generator.integers(MAX_SEED, endpoint=True))
        limit = self.task.largest_pitch
        x, y = generator.uniform(-limit, limit, 2).tolist()
        commands = random_commands(generator, self.duration) if self.task.drives else ()
        return Start(
            given.get('seed', seed),
            (given.get('start_pitch_x', x), given.get('start_pitch_y', y)),
            given.get('commands', commands),
        )

    def info_of(self, start: Start) -> dict[str, Any]:
        """Return a start as the options of a reset take it."""
        info: dict[str, Any] = {
            'seed': start.seed,
            'start_pitch_x': start.pitch[0],
            'start_pitch_y': start.pitch[1],
        }
        return {**info, 'commands': start.commands} if self.task.drives else info

    def parameters_at(self, start: Start) -> ParameterSet:
        """Return the parameters of an episode."""
        values = ParameterSet(self.parameters)
        values.set(GYRO, 'seed', start.seed)
        values.set(PLANT, 'start_pitch_x', start.pitch[0])
        values.set(PLANT, 'start_pitch_y', start.pitch[1])
        return values

    def scenario(self, start: Start) -> Scenario:
        """Return the sticks that give the commands of an episode."""
        commands, release = start.commands, release_s(self.settings)
        return Scenario(
            vertical=stick_signal(((each.time_s, -each.x_percent) for each in commands), release),
            horizontal=stick_signal(((each.time_s, each.y_percent) for each in commands), release),
        )


def checked_action(action: object) -> list[float]:
    """Return an action as two finite numbers.

    Raises
    ------
    gymnasium.error.InvalidAction
        If it is something else; the message is one line.
    """
    array = _numbers(action, (2,))
    values: list[float] = [] if array is None else array.tolist()
    if not values or not all(map(math.isfinite, values)):
        raise InvalidAction(f'the action {short_repr(action)} is not two finite numbers')
    return values


def checked_actions(actions: object, count: int) -> Floats:
    """Return the actions of robots as :func:`checked_action` does that of one."""
    array = _numbers(actions, (count, 2))
    if array is None or not np.isfinite(array).all():
        raise InvalidAction(
            f'the action {short_repr(actions)} is not two finite numbers for each of {count} robots'
        )
    return array


def _numbers(action: object, shape: tuple[int, ...]) -> Floats | None:
    try:
        array = np.asarray(action)
    except (TypeError, ValueError, OverflowError):
        return None
    return array if array.dtype.kind in 'iuf' and array.shape == shape else None
