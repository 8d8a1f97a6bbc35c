"""The base class of the environments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import InvalidAction, ResetNeeded
from numpy.typing import NDArray

from ballbot_ros.controllers.controller import Duty
from ballbot_ros.controllers.policy import duty_of
from ballbot_ros.engine.closed_loop import Robot
from ballbot_ros.errors import EnvironmentConfigurationError, importing_viewer, short_repr
from ballbot_ros.lab.environments.configuration import (
    Commands,
    check_hold,
    check_step,
    checked_commands,
    fingerprint,
    parameters_of_environment,
    steps_of,
)
from ballbot_ros.lab.environments.episode import (
    Component,
    EnvironmentState,
    Episode,
    EpisodeState,
    Floats,
    Start,
    box,
    device_quantities,
    state_of,
    state_quantities,
)
from ballbot_ros.parameters import GYRO, PLANT, ControllerParameters, PlantParameters, parameters_of
from ballbot_ros.parameters.files import Parameters, plain_value
from ballbot_ros.parameters.timing import TICK_MS

if TYPE_CHECKING:
    from ballbot_ros.viewer.render import Painter

DEVICES, STATE = 'devices', 'state'
OBSERVATIONS = (DEVICES, STATE)
MAX_SEED = 2**63 - 1

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
    step_ms : int
        As above.
    duration : float
        As above.

    Raises
    ------
    BallbotError
        If an argument is not valid; the message is one line.
    """

    metadata: dict[str, Any] = {'render_modes': ['rgb_array']}  # noqa: RUF012 (Gymnasium's)
    task: ClassVar[str]
    default_duration: ClassVar[float]
    largest_pitch: ClassVar[float]
    """Largest random pitch at the start, in each plane [rad]."""

    drives: ClassVar[bool] = False

    def __init__(
        self,
        observation: str = DEVICES,
        step_ms: int = TICK_MS,
        duration: float | None = None,
        profile: str | None = None,
        parameters: Parameters | None = None,
        render_mode: str | None = None,
    ) -> None:
        if not isinstance(observation, str) or observation not in OBSERVATIONS:
            raise EnvironmentConfigurationError(
                f'observation: {short_repr(observation)} is not {" or ".join(OBSERVATIONS)}'
            )
        if render_mode not in (None, 'rgb_array'):
            mode = short_repr(render_mode)
            raise EnvironmentConfigurationError(f"render_mode: {mode} is not None or 'rgb_array'")
        self.render_mode = render_mode
        self._painter: Painter | None = None
        self.step_ms = check_step(step_ms)
        self.metadata = {**self.metadata, 'render_fps': 1000 // self.step_ms}
        given = self.default_duration if duration is None else duration
        self._steps_of_episode = steps_of(given, self.step_ms)
        self.duration = float(given)
        self._observes_state = observation == STATE
        self._parameters = parameters_of_environment(profile, parameters)
        check_hold(self._parameters)
        plant = self._parameters.of(PlantParameters)
        self._start_position = (plant.start_position_x, plant.start_position_y)
        self._settings = self._parameters.of(ControllerParameters)
        self._configuration = (
            ('task', self.task),
            ('observation', observation),
            ('step_ms', self.step_ms),
            ('duration', self.duration),
            *fingerprint(self._parameters),
        )
        state = state_quantities(self.duration)
        self.state_names = tuple(each.name for each in state)
        quantities = self._quantities(state)
        self.observation_names = tuple(each.name for each in quantities)
        space = box(quantities)
        self.observation_space, self._low, self._high = space, space.low, space.high
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self._episode: Episode | None = None
        self._observation: tuple[float, ...] = ()
        self._steps = 0
        self._over = True
        Robot(self._parameters)  # checks map and start position

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
        given = self._checked_options({} if options is None else options)
        super().reset(seed=seed)
        start = self._start(given)
        self._episode = Episode(self._parameters, start, drives=self.drives)
        self._episode.hold()
        self._steps = 0
        self._over = False
        self._observation = self._observe(self._episode)
        return self._bounded(), self._info(self._episode)

    def step(self, action: Any) -> tuple[Floats, float, bool, bool, Info]:
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
        if self._episode is None or self._over:
            raise ResetNeeded('the episode is over, or none has begun: call reset')
        duty = duty_of(_checked(action))
        episode = self._episode
        episode.step(duty, self.step_ms // TICK_MS)
        self._steps += 1
        self._observation = self._observe(episode)
        terminated = episode.terminated
        truncated = self._steps >= self._steps_of_episode
        self._over = terminated or truncated
        reward, parts = self._reward(episode, duty)
        info = self._info(episode)
        info['duty_percent'] = np.array(duty)
        info.update(parts)
        return self._bounded(), reward, terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the robot, of shape (528, 960, 3); None without a `render_mode`."""
        if self.render_mode is None:
            return None
        if self._episode is None:
            raise ResetNeeded('no episode has begun: call reset')
        if self._painter is None:
            # Imported only here: it takes seconds, and few episodes are drawn.
            with importing_viewer():
                from ballbot_ros.viewer.render import Painter, present_frames

            plant = self._parameters.of(PlantParameters)
            self._painter = Painter(present_frames(plant, lambda: self._truth))
        self._truth = self._episode.truth
        return self._painter.picture()

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
        if self._episode is None:
            raise ResetNeeded('no episode has begun: call reset')
        return EnvironmentState(
            self._configuration,
            self._episode.save_state(),
            self._steps,
            self._over,
            self._observation,
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
        self._episode = self._restored(state.episode)
        self._steps, self._over = state.steps, state.over
        self._observation = state.observation
        return self._bounded(), self._info(self._episode)

    def _restored(self, state: EpisodeState) -> Episode:
        """Return the present episode, or a new one with the same start, in a saved state."""
        episode = self._episode
        if episode is None or episode.start != state.start:
            episode = Episode(self._parameters, state.start, drives=self.drives)
        episode.restore_state(state)
        return episode

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy or another process needs; devices and browser can't be pickled."""
        saved = self._episode.save_state() if self._episode else None
        return {**vars(self), '_episode': saved, '_painter': None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update({**state, '_episode': None})
        if saved := state['_episode']:
            self._episode = self._restored(saved)

    def _check_state(self, state: object) -> None:
        if not isinstance(state, EnvironmentState):
            raise EnvironmentConfigurationError(
                f'{short_repr(state)} is not a state that save_state returned'
            )
        if len(state.configuration) != len(self._configuration):
            raise EnvironmentConfigurationError('the state is that of another version')
        for (name, value), (_, own) in zip(state.configuration, self._configuration, strict=True):
            if value != own:
                raise EnvironmentConfigurationError(
                    f'the state is that of another environment: {name} is {short_repr(value)} '
                    f'there, {short_repr(own)} here'
                )

    def _quantities(self, state: tuple[Component, ...]) -> tuple[Component, ...]:
        """Return the components of the observation, for those of the true state."""
        if self._observes_state:
            return state
        return device_quantities(self.duration, self._settings.k_thetadot, drives=self.drives)

    def _observe(self, episode: Episode) -> tuple[float, ...]:
        """Return the components of the observation."""
        if self._observes_state:
            return self._state(episode)
        return episode.observer.observe()

    def _reward(self, episode: Episode, duty: Duty) -> tuple[float, dict[str, float]]:
        """Return the reward of a step, and its parts by the names that they have in the info."""
        raise NotImplementedError

    def _commands(self) -> Commands:
        """Return random commands for an episode."""
        return ()

    def _state(self, episode: Episode) -> tuple[float, ...]:
        return state_of(episode.truth, self._start_position)

    def _bounded(self) -> Floats:
        """Return the observation within its bounds, as a saturated device would report it."""
        observation = np.array(self._observation)
        np.maximum(observation, self._low, out=observation)
        np.minimum(observation, self._high, out=observation)
        return observation

    def _info(self, episode: Episode) -> Info:
        info: Info = {
            'time_s': self._steps * self.step_ms / 1000.0,
            'state': np.array(self._state(episode)),
        }
        if self._steps == 0:
            start = episode.start
            info['seed'] = start.seed
            info['start_pitch_x'], info['start_pitch_y'] = start.pitch
            if self.drives:
                info['commands'] = start.commands
        return info

    def _checked_options(self, options: object) -> dict[str, Any]:
        """Return the options of a reset; refuse those that are not valid."""
        if not isinstance(options, Mapping):
            raise EnvironmentConfigurationError(f'options: {short_repr(options)} are no mapping')
        nodes = {'start_pitch_x': PLANT, 'start_pitch_y': PLANT, 'seed': GYRO}
        known = (*nodes, *(['commands'] if self.drives else []))
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

    def _start(self, given: Mapping[str, Any]) -> Start:
        """Draw a start, and replace what is given."""
        generator = self.np_random
        seed = int(generator.integers(MAX_SEED, endpoint=True))
        limit = self.largest_pitch
        x, y = generator.uniform(-limit, limit, 2).tolist()
        commands = self._commands()
        return Start(
            given.get('seed', seed),
            (given.get('start_pitch_x', x), given.get('start_pitch_y', y)),
            given.get('commands', commands),
        )


def _checked(action: Any) -> list[float]:
    """Return an action as two finite numbers."""
    try:
        array = np.asarray(action)
        is_number = array.dtype.kind in 'iuf' and array.shape == (2,)
    except (TypeError, ValueError, OverflowError):
        is_number = False
    if not is_number or not np.isfinite(array).all():
        raise InvalidAction(f'the action {short_repr(action)} is not two finite numbers')
    values: list[float] = array.astype(np.float64).tolist()
    return values
