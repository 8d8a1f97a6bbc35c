"""An episode: the robot from the start of a run on, with held duties and observations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ballbot_ros.controllers.controller import Duty, next_readings
from ballbot_ros.controllers.policy import DRIVING_NAMES, DeviceObserver, ObserverState
from ballbot_ros.engine.closed_loop import Robot
from ballbot_ros.engine.plant import SavedPlant
from ballbot_ros.lab.environments.configuration import Commands, commanded_scenario, release_s
from ballbot_ros.parameters import GYRO, PLANT, ControllerParameters, ParameterSet
from ballbot_ros.parameters.timing import MILLISECOND_NS
from ballbot_ros.robot.plant.ground_truth import GroundTruth, Pair


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


MOTORS_OFF: Duty = (0, 0)


class Episode:
    """The robot under the duties of a policy, in the order of the node graph.

    At each tick the devices are sampled, and then the duty acts. The episode begins when the gyros
    are calibrated; until then the robot is held still, with the motors off.

    Parameters
    ----------
    drives : bool
        Whether the observation of the devices has distance and commanded speed.

    Attributes
    ----------
    start : Start
        What differs from other episodes.
    truth : GroundTruth
        The present true state.
    observer : DeviceObserver
        Makes the observations of the devices.

    Raises
    ------
    BallbotError
        If the map can't be read, or the robot can't start there.
    """

    def __init__(self, parameters: ParameterSet, start: Start, *, drives: bool) -> None:
        self.start = start
        values = ParameterSet()
        values.update(parameters)
        values.set(GYRO, 'seed', start.seed)
        values.set(PLANT, 'start_pitch_x', start.pitch[0])
        values.set(PLANT, 'start_pitch_y', start.pitch[1])
        settings = values.of(ControllerParameters)
        self._robot = Robot(values, commanded_scenario(start.commands, release_s(settings)))
        self._plant = self._robot.plant
        self.observer = DeviceObserver(settings, drives=drives)
        self.truth: GroundTruth = self._plant.truth()

    def hold(self) -> None:
        """Let the robot be held until the gyros are calibrated, the time of the first action."""
        self._sample()
        while not self.observer.calibrated:
            self._plant.tick(*MOTORS_OFF)
            self._sample()

    def step(self, duty: Duty, ticks: int) -> None:
        """Apply a duty for a number of ticks; a wall hit ends them."""
        plant = self._plant
        for _ in range(ticks):
            plant.tick(*duty)
            self._sample()
            if plant.stopped:
                return

    @property
    def terminated(self) -> bool:
        """Whether the robot has fallen, or hit a wall."""
        return self._plant.fallen or self._plant.stopped

    def save_state(self) -> EpisodeState:
        """Return the present state."""
        return EpisodeState(self.start, self._plant.save_state(), self.observer.save_state())

    def restore_state(self, state: EpisodeState) -> None:
        """Continue from a state of an episode with the same parameters and start."""
        self._plant.restore_state(state.plant)
        self.observer.restore_state(state.observer)
        self.truth = self._plant.truth()

    def _sample(self) -> None:
        self.truth = truth = self._plant.truth()
        elapsed_ms = (truth.stamp_ns - self._robot.start_ns) // MILLISECOND_NS
        inputs = self._robot.sample()
        self.observer.update(next_readings(self.observer.readings, elapsed_ms, inputs))


Floats = NDArray[np.float64]

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


def device_quantities(duration: float, full_rate: float, *, drives: bool) -> tuple[Component, ...]:
    """Return the components of the observation of the devices."""
    all_of_them = (
        *pair('rate_{}_deg_per_s', RATE_DEG_PER_S),
        *pair('encoder_{}_deg', ENCODER_DEG_PER_S * duration),
        Component('battery_v', 0.0, 15.0),
        Component('distance_cm', 0.0, 255.0),
        *pair('commanded_rate_{}_deg_per_s', full_rate),
    )
    assert tuple(each.name for each in all_of_them) == DRIVING_NAMES
    return all_of_them if drives else all_of_them[:5]


def state_quantities(duration: float) -> tuple[Component, ...]:
    """Return the components of :func:`state_of`."""
    return (
        *pair('position_{}_m', SPEED_M_PER_S * duration),
        *pair('velocity_{}_m_per_s', 10.0),
        *pair('pitch_{}_rad', 1.5),
        *pair('pitch_rate_{}_rad_per_s', 100.0),
        Component('battery_v', 0.0, 15.0),
    )


def state_of(truth: GroundTruth, start: tuple[float, float]) -> tuple[float, ...]:
    """Return the true state; the position is the one from the start [m]."""
    return (
        truth.position[0] - start[0],
        truth.position[1] - start[1],
        *truth.velocity,
        *truth.psi,
        *truth.psi_rate,
        truth.battery_voltage,
    )


def box(quantities: tuple[Component, ...]) -> spaces.Box[np.float64]:
    """Return the space of a vector."""
    low, high = (np.array([getattr(each, end) for each in quantities]) for end in ('low', 'high'))
    return spaces.Box(low, high, dtype=np.float64)
