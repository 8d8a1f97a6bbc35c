"""An episode: the robot from the start of a run on, with held duties and observations."""

from __future__ import annotations

from ballbot_ros.controllers.controller import Duty, next_readings
from ballbot_ros.controllers.policy import DeviceObserver
from ballbot_ros.environments.commands import scenario_of
from ballbot_ros.environments.configuration import release_s
from ballbot_ros.environments.state import EpisodeState, Start
from ballbot_ros.parameters import GYRO, PLANT, ControllerParameters, ParameterSet
from ballbot_ros.plant.ground_truth import GroundTruth
from ballbot_ros.simulation.robot import Robot
from ballbot_ros.timing import MILLISECOND_NS

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
        self._robot = Robot(values, scenario_of(start.commands, release_s(settings)))
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
