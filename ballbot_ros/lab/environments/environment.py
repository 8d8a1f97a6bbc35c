"""The environments of one robot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from ballbot_ros.errors import EnvironmentConfigurationError, importing, short_repr
from ballbot_ros.lab.environments.configuration import BALANCE, DRIVE, Task
from ballbot_ros.lab.environments.episode import EnvironmentState, new_episode
from ballbot_ros.lab.environments.setup import DEVICES, Setup, checked_action
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.parameters.files import Parameters
from ballbot_ros.parameters.timing import TICK_MS
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.plant.ground_truth import Pair

if TYPE_CHECKING:
    from ballbot_ros.viewer.render import Painter

Info = dict[str, Any]


class BallbotEnv(gymnasium.Env[Floats, NDArray[np.float32]]):
    """The robot as an environment: its duties are the action. See docs/learning.md.

    Parameters
    ----------
    observation : str
        ``'devices'``: what the brick measures; ``'state'``: the true state.
    step_ms : int
        Period of the actions [ms], 4 or 20; in between the duty is held.
    duration : float or None
        Time after which an episode is truncated [s]; None for that of the task.
    profile : str or None
        Device profile, ``'ideal'`` or ``'hardware'``; None for ``'ideal'``.
    parameters : mapping or path-like or None
        Values that override the profile: by ``node.param``, such as
        ``{'plant_sim.body_mass': 0.7}``, or a parameter file.
    render_mode : str or None
        ``'rgb_array'``: `render` returns a picture, drawn by a headless browser.

    Attributes
    ----------
    observation_names, state_names : tuple of str
        Names, with units, of the components of an observation and of ``info['state']``.

    Raises
    ------
    BallbotError
        If an argument is not valid; the message is one line.
    """

    metadata: dict[str, Any] = {'render_modes': ['rgb_array']}  # noqa: RUF012 (Gymnasium's)
    task: ClassVar[Task]

    def __init__(
        self,
        observation: str = DEVICES,
        step_ms: int = TICK_MS,
        duration: float | None = None,
        profile: str | None = None,
        parameters: Parameters | None = None,
        render_mode: str | None = None,
    ) -> None:
        if render_mode not in (None, 'rgb_array'):
            mode = short_repr(render_mode)
            raise EnvironmentConfigurationError(f"render_mode: {mode} is not None or 'rgb_array'")
        self.render_mode = render_mode
        self._painter: Painter | None = None
        setup = Setup(self.task, observation, step_ms, duration, profile, parameters)
        self._setup, self.step_ms, self.duration = setup, setup.step_ms, setup.duration
        self.metadata = {**self.metadata, 'render_fps': 1000 // self.step_ms}
        self.state_names = tuple(each.name for each in setup.state_components)
        self.observation_names = tuple(each.name for each in setup.components)
        self.observation_space = setup.space
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self._episode = new_episode(setup)
        self._has_begun, self._over, self._steps = False, True, 0

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Floats, Info]:
        """Begin an episode: the robot is held until the gyros are calibrated, and let go.

        Parameters
        ----------
        seed : int or None
            Seed of the random numbers of this and the next episodes, also of the device noise and
            jitter.
        options : mapping or None
            A start that is not random: ``start_pitch_x``, ``start_pitch_y`` [rad], the ``seed`` of
            the device noise and, to drive, ``commands``.

        Returns
        -------
        observation : ndarray
            The first observation.
        info : dict
            ``time_s``, ``state``, and the start as `options` take it, such as ``seed``.

        Raises
        ------
        BallbotError
            If an option is not valid.
        """
        given = self._setup.checked_options(options)
        super().reset(seed=seed)
        self._episode.begin(self._setup.start(self.np_random, given))
        self._steps = 0
        self._has_begun, self._over = True, False
        return self._observation(), self._info()

    def step(self, action: object) -> tuple[Floats, float, bool, bool, Info]:
        """Apply the duty of an action for a step.

        Parameters
        ----------
        action : array_like, shape (2,)
            Shares of full duty for planes x and y. Values beyond ±1 count as ±1; the duty is
            rounded to whole percents, halves up.

        Returns
        -------
        observation : ndarray
            At the end of the step.
        reward : float
            0 ... 1.
        terminated : bool
            Whether the robot has fallen, or hit a wall.
        truncated : bool
            Whether the episode has lasted for `duration`.
        info : dict
            ``time_s`` from the release, the true ``state``, ``duty_percent``, and the parts of the
            reward.

        Raises
        ------
        gymnasium.error.ResetNeeded
            Before the first reset, and after the end of an episode.
        gymnasium.error.InvalidAction
            If the action is not two finite numbers.
        """
        if self._over:
            raise ResetNeeded('the episode is over, or none has begun: call reset')
        episode = self._episode
        episode.step(checked_action(action))
        self._steps += 1
        terminated = episode.is_over
        truncated = self._steps >= self._setup.steps
        self._over = terminated or truncated
        reward, parts = self._setup.reward(episode.measured, episode.true, episode.duty)
        info = self._info()
        info['duty_percent'] = np.array(episode.duty)
        info.update(parts)
        return self._observation(), reward, terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the robot, of shape (528, 960, 3); None without a `render_mode`."""
        if self.render_mode is None:
            return None
        self._require_start()
        if self._painter is None:
            # Imported only here: it takes seconds, and few episodes are drawn.
            with importing('film'):
                from ballbot_ros.viewer.render import Painter, present_frames

            plant = self._setup.parameters.of(PlantParameters)
            self._painter = Painter(present_frames(plant, self._pose))
        return self._painter.picture()

    def _pose(self) -> tuple[Pair, Pair]:
        """Return position [m] and pitch [rad]."""
        plant = self._setup.parameters.of(PlantParameters)
        x, y, _, _, *pitch = self._episode.true[:6]
        return (plant.start_position_x + x, plant.start_position_y + y), (pitch[0], pitch[1])

    def _require_start(self) -> None:
        if not self._has_begun:
            raise ResetNeeded('no episode has begun: call reset')

    def close(self) -> None:
        """Close the browser that has drawn the pictures, if any."""
        if self._painter:
            self._painter.close()
            self._painter = None

    def save_state(self) -> EnvironmentState:
        """Return the present state of the episode and of the random numbers; it can be pickled.

        Raises
        ------
        gymnasium.error.ResetNeeded
            Before the first reset.
        """
        self._require_start()
        return EnvironmentState(
            self._setup.fingerprint,
            self._episode.save_state(),
            self._steps,
            self._over,
            self.np_random.bit_generator.state,
        )

    def restore_state(self, state: EnvironmentState) -> tuple[Floats, Info]:
        """Continue from a saved state, also of another process.

        Returns
        -------
        observation : ndarray
            The last one before the state was saved.
        info : dict
            As that of `reset`.

        Raises
        ------
        EnvironmentConfigurationError
            If it is not the state of an environment with the same arguments.
        """
        self._check_state(state)
        self.np_random.bit_generator.state = state.generator
        self._episode.restore_state(state.episode)
        self._has_begun, self._steps, self._over = True, state.steps, state.over
        return self._observation(), self._info()

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy or another process needs; compiled code and browser stay here."""
        saved = self._episode.save_state() if self._has_begun else None
        return {**vars(self), '_episode': saved, '_painter': None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._episode = new_episode(self._setup)
        if saved := state['_episode']:
            self._episode.restore_state(saved)

    def _check_state(self, state: object) -> None:
        if not isinstance(state, EnvironmentState):
            raise EnvironmentConfigurationError(
                f'{short_repr(state)} is not a state that save_state returned'
            )
        own_configuration = self._setup.fingerprint
        if len(state.configuration) != len(own_configuration):
            raise EnvironmentConfigurationError('the state is that of another version')
        for (name, value), (_, own) in zip(state.configuration, own_configuration, strict=True):
            if value != own:
                raise EnvironmentConfigurationError(
                    f'the state is that of another environment: {name} is {short_repr(value)} '
                    f'there, {short_repr(own)} here'
                )

    def _observation(self) -> Floats:
        episode = self._episode
        observation = np.array(self._setup.observation(episode.measured, episode.true))
        self._setup.bound(observation)
        return observation

    def _info(self) -> Info:
        info: Info = {
            'time_s': self._steps * self.step_ms / 1000.0,
            'state': np.array(self._episode.true),
        }
        if self._steps == 0:
            info.update(self._setup.info_of(self._episode.start))
        return info


class BalanceEnv(BallbotEnv):
    """``ballbot_ros/Balance-v0``: balance on the spot, with little duty."""

    task: ClassVar[Task] = BALANCE


class DriveEnv(BallbotEnv):
    """``ballbot_ros/Drive-v0``: follow a commanded speed that changes every 3 s."""

    task: ClassVar[Task] = DRIVE
