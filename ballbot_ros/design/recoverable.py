"""The states from which the motors can catch the robot at all, whatever the controller.

The upright robot has one unstable pole p. Its motion z = w·x grows as ``z' = p z + (w·b) v``, with
the left eigenvector w of p. The voltage v is bounded, so z can be brought back if and only if
``p |z| < |w·b| v_max``: beyond that, it grows even under full duty. The other poles do not grow and
set no limit. So the states that can be recovered are a strip between two parallel planes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbot_ros.design.state_feedback import DesignError
from ballbot_ros.parameters import ParameterSet, PlantParameters
from ballbot_ros.plant.actuator import motor_voltage
from ballbot_ros.plant.model import Matrix, PhysicalParameters, state_space


@dataclass(frozen=True)
class RecoverableStates:
    """The states of a plane that some controller can bring back, by the linear model.

    Attributes
    ----------
    rate : float
        The unstable pole [1/s].
    direction : ndarray, shape (4,)
        Factors of theta, psi [rad] and their rates [rad/s]; their sum is 1 or -1 at the limit.
    """

    rate: float
    direction: Matrix

    def share(self, states: Matrix) -> Matrix:
        """Return how much of what can be recovered the states (..., 4) take; 1 at the limit."""
        share: Matrix = np.abs(states @ self.direction)
        return share


def recoverable_states(parameters: ParameterSet) -> RecoverableStates:
    """Return the states that can be recovered with the battery's voltage at the start.

    Raises
    ------
    DesignError
        If the robot has not exactly one unstable pole, or its motors can't move it.
    """
    plant = parameters.of(PlantParameters)
    a, b = state_space(PhysicalParameters.from_parameters(plant))
    values, vectors = np.linalg.eig(a.T)
    unstable = np.flatnonzero(values.real > 0.0)
    if len(unstable) != 1:
        raise DesignError(f'the robot has {len(unstable)} unstable poles instead of 1')
    rate, direction = values[unstable[0]].real, vectors[:, unstable[0]].real
    volts = motor_voltage(
        100, plant.battery_voltage, plant.dead_zone, plant.voltage_slope, plant.voltage_offset
    )
    limit = abs(direction @ b[:, 0]) * volts / rate
    if not limit:
        raise DesignError('the motors cannot move the robot')
    # The sign of an eigenvector is arbitrary.
    return RecoverableStates(float(rate), direction / limit * np.sign(direction[1]))
