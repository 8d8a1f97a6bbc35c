"""The environments of many robots, which one call of compiled code moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ballbot_ros.errors import EnvironmentConfigurationError, short_repr
from ballbot_ros.lab.environments.configuration import BALANCE, DRIVE, Task
from ballbot_ros.lab.environments.episode import MovedRobots
from ballbot_ros.lab.environments.setup import DEVICES, Setup, checked_actions
from ballbot_ros.parameters.files import Parameters
from ballbot_ros.parameters.timing import TICK_MS
from ballbot_ros.robot.arithmetic import Floats

Mask = NDArray[np.bool_]
Infos = dict[str, Any]

RESET_MASK = 'reset_mask'

MOVED = ('duty', 'measured', 'true')
"""What the reward of a step depends on."""


class BallbotVectorEnv(VectorEnv[Floats, Any, NDArray[Any]]):
    """Robots as one environment; each is that of a :class:`BallbotEnv` with the same arguments.

    With the same seeds it returns what ``gymnasium.vector.SyncVectorEnv`` does, bit for bit.

    Parameters
    ----------
    num_envs : int
        Number of robots.
    observation, step_ms, duration, profile, parameters
        As in :class:`~ballbot_ros.lab.environments.environment.BallbotEnv`.
    autoreset_mode : gymnasium.vector.AutoresetMode or str
        When the next episode of a robot begins: with the step after its end (the default), in the
        step that ends it, or with a `reset` that has a ``reset_mask``.
    render_mode : None
        There are no pictures.

    Raises
    ------
    BallbotError
        If an argument is not valid, or numba is not installed; the message is one line.
    """

    task: ClassVar[Task]

    def __init__(
        self,
        num_envs: int = 1,
        observation: str = DEVICES,
        step_ms: int = TICK_MS,
        duration: float | None = None,
        profile: str | None = None,
        parameters: Parameters | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
    ) -> None:
        self.num_envs = _checked_count(num_envs)
        self._mode = _checked_mode(autoreset_mode)
        if render_mode is not None:
            raise EnvironmentConfigurationError(
                'render_mode: robots that are moved together have no pictures; use one environment '
                "or vectorization_mode='sync'"
            )
        self.render_mode = None
        setup = self._setup = Setup(self.task, observation, step_ms, duration, profile, parameters)
        self.metadata = {'render_modes': [], 'autoreset_mode': self._mode}
        self.single_observation_space = setup.space
        self.single_action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space = batch_space(setup.space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._robots = MovedRobots(setup, num_envs)
        self._rows = self._robots.rows
        self._generators: list[np.random.Generator | None] = [None] * num_envs
        self._steps = np.zeros(num_envs, np.int64)
        self._over = np.ones(num_envs, np.bool_)
        self._has_begun = False

    @property  # type: ignore[misc]
    def np_random(self) -> Any:
        """The random numbers of each robot."""
        return tuple(map(self._generator, range(self.num_envs)))

    def _generator(self, at: int) -> np.random.Generator:
        found = self._generators[at]
        if found is None:
            found, _ = seeding.np_random()
            self._generators[at] = found
        return found

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> tuple[Floats, Infos]:
        """Begin an episode of each robot, or of those in a mask.

        Parameters
        ----------
        seed : int or sequence of int or None
            Those of the robots; for a number they are this and the following ones.
        options : mapping or None
            As for one environment; also ``reset_mask``, an array of bool.

        Returns
        -------
        observations : ndarray
        infos : dict
            The infos of the robots in columns, each with a mask.
        """
        mask = np.ones(self.num_envs, np.bool_)
        if isinstance(options, Mapping) and RESET_MASK in options:
            mask = self._checked_mask(options[RESET_MASK])
            options = {name: value for name, value in options.items() if name != RESET_MASK}
        given = self._setup.checked_options(options)
        seeds = self._seeds(seed)
        for at in np.flatnonzero(mask).tolist():
            if seeds[at] is not None:
                self._generators[at], _ = seeding.np_random(seeds[at])
        infos: Infos = {}
        self._rows['ticks'] = 0
        self._begin(mask, given, infos)
        self._robots.move()
        self._has_begun = True
        self._over &= ~mask
        self._add(infos, mask)
        return self._observations(), infos

    def step(self, actions: object) -> tuple[Floats, Floats, Mask, Mask, Infos]:
        """Apply the duties of actions, of shape (num_envs, 2), for a step.

        Returns
        -------
        observations, rewards, terminated, truncated, infos
            Those of one environment in columns; the infos have masks. In a step in which an episode
            begins, the reward is 0 and the info that of the reset. An episode that begins in the
            step that ends another one leaves ``final_obs`` and ``final_info`` of that one.
        """
        begins = self._over.copy()
        if not self._has_begun or (begins.any() and self._mode is not AutoresetMode.NEXT_STEP):
            raise ResetNeeded('an episode is over, or none has begun: call reset')
        rows, infos, moves = self._rows, Infos(), ~begins
        rows['action'] = checked_actions(actions, self.num_envs)
        rows['ticks'] = self._setup.ticks
        self._begin(begins, {}, infos)
        self._robots.move()
        self._steps += moves
        terminated = rows['is_over'] & moves
        truncated = (self._steps >= self._setup.steps) & moves
        self._over = terminated | truncated
        duty, measured, true = (np.ascontiguousarray(rows[name].T) for name in MOVED)
        rewards, parts = self._setup.reward(tuple(measured), tuple(true), tuple(duty))
        rewards[begins] = 0.0
        self._add(infos, np.ones(self.num_envs, np.bool_))
        if moves.any():
            _note(infos, {'duty_percent': rows['duty'].copy(), **parts}, moves)
        observations = self._observations()
        if self._mode is AutoresetMode.SAME_STEP and self._over.any():
            observations, infos = self._begin_at_once(observations, infos)
        return observations, rewards, terminated, truncated, infos

    def _begin_at_once(self, final: Floats, final_infos: Infos) -> tuple[Floats, Infos]:
        """Let the next episodes begin in the step that has ended others."""
        over, others = self._over, ~self._over
        infos: Infos = {}
        self._rows['ticks'] = 0
        self._begin(over, {}, infos)
        self._robots.move()
        self._over = np.zeros(self.num_envs, np.bool_)
        self._add(infos, np.ones(self.num_envs, np.bool_))
        names = [name for name in final_infos if not name.startswith('_')]
        for name in names:
            if name not in ('time_s', 'state') and others.any():
                _note(infos, {name: final_infos[name]}, others)
        of_the_ended: Infos = {}
        _note(of_the_ended, {name: final_infos[name] for name in names}, over)
        observations = np.empty(self.num_envs, object)
        for at in np.flatnonzero(over).tolist():
            observations[at] = final[at]
        _note(infos, {'final_obs': observations}, over)
        infos['final_info'], infos['_final_info'] = of_the_ended, over.copy()
        return self._observations(), infos

    def _begin(self, mask: Mask, given: Mapping[str, object], infos: Infos) -> None:
        """Let robots begin an episode with the next move."""
        which = np.flatnonzero(mask).tolist()
        if not which:
            return
        columns: dict[str, NDArray[Any]] = {}
        for at in which:
            start = self._setup.start(self._generator(at), given)
            self._robots.begin(at, start)
            for name, value in self._setup.info_of(start).items():
                kind = object if isinstance(value, tuple) else type(value)
                columns.setdefault(name, np.zeros(self.num_envs, kind))[at] = value
        self._steps[mask] = 0
        _note(infos, columns, mask)

    def _add(self, infos: Infos, mask: Mask) -> None:
        columns = {
            'time_s': self._steps * self._setup.step_ms / 1000.0,
            'state': self._rows['true'].copy(),
        }
        _note(infos, columns, mask)

    def _observations(self) -> Floats:
        measured, true = self._rows['measured'], self._rows['true']
        columns = self._setup.observation(tuple(measured.T), tuple(true.T))
        observations = np.stack(columns, axis=1)
        self._setup.bound(observations)
        return observations

    def _seeds(self, seed: int | Sequence[int | None] | None) -> Sequence[int | None]:
        if isinstance(seed, int | np.integer):
            return [int(seed) + at for at in range(self.num_envs)]
        seeds = [None] * self.num_envs if seed is None else seed
        if not isinstance(seeds, Sequence) or len(seeds) != self.num_envs:
            raise EnvironmentConfigurationError(
                f'seed: {short_repr(seed)} is neither a number nor a list of {self.num_envs}'
            )
        return seeds

    def _checked_mask(self, mask: object) -> Mask:
        array = np.asarray(mask)
        if array.dtype != np.bool_ or array.shape != (self.num_envs,) or not array.any():
            raise EnvironmentConfigurationError(
                f'options: {RESET_MASK}: {short_repr(mask)} is no array of {self.num_envs} bool, '
                'some of them True'
            )
        return array


def _note(infos: Infos, columns: Mapping[str, NDArray[Any]], mask: Mask) -> None:
    """Add columns to the infos, with the mask of the robots that have them; zero elsewhere."""
    for name, column in columns.items():
        if not mask.all():
            column = column.copy()
            column[~mask] = None if column.dtype == object else 0
        infos[name], infos[f'_{name}'] = column, mask.copy()


def _checked_count(count: object) -> int:
    if not isinstance(count, int) or isinstance(count, bool) or count < 1:
        raise EnvironmentConfigurationError(
            f'num_envs: {short_repr(count)} is not a whole number from 1 on'
        )
    return count


def _checked_mode(mode: AutoresetMode | str) -> AutoresetMode:
    try:
        return AutoresetMode(mode)
    except ValueError:
        known = ', '.join(each.value for each in AutoresetMode)
        raise EnvironmentConfigurationError(
            f'autoreset_mode: {short_repr(mode)} is not one of {known}'
        ) from None


class BalanceVectorEnv(BallbotVectorEnv):
    """``ballbot_ros/Balance-v0`` with many robots."""

    task: ClassVar[Task] = BALANCE


class DriveVectorEnv(BallbotVectorEnv):
    """``ballbot_ros/Drive-v0`` with many robots."""

    task: ClassVar[Task] = DRIVE
