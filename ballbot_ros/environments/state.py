"""The start and the saved state of an episode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from ballbot_ros.controllers.policy import ObserverState
from ballbot_ros.engine.plant import SavedPlant
from ballbot_ros.environments.commands import Commands
from ballbot_ros.plant.ground_truth import Pair


class Start(NamedTuple):
    """What differs between the episodes of an environment.

    Attributes
    ----------
    seed : int
        Seed of the device noise and jitter: the parameter ``gyro_driver.seed``.
    pitch : tuple of float
        Body pitch [rad] of planes x and y, in which the robot is held.
    commands : tuple of Command
        The commanded speeds.
    """

    seed: int
    pitch: Pair
    commands: Commands = ()


class EpisodeState(NamedTuple):
    """Everything in an episode that changes with time."""

    start: Start
    plant: SavedPlant
    observer: ObserverState


@dataclass(frozen=True)
class EnvironmentState:
    """The state of an environment: pass it to ``restore_state``.

    It can be pickled. Its content is not part of the interface.
    """

    configuration: tuple[tuple[str, object], ...]
    episode: EpisodeState
    steps: int
    over: bool
    observation: tuple[float, ...]
    generator: Mapping[str, Any]
