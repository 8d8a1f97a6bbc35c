"""What parameters are identified from: the readings of a run, at equal steps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.identification.arrays import Floats
from ballbot_ros.identification.rounding import ROUNDING_DEVIATION, common_rounding
from ballbot_ros.parameters import ControllerParameters, PlantParameters
from ballbot_ros.timing import STEP_NS, STEPS_PER_TICK, TICK_S


def with_values(plant: PlantParameters, values: Mapping[str, Any]) -> PlantParameters:
    """Return parameters in which some values, by name, are replaced."""
    return replace(plant, **values)


class Quantity(Enum):
    """What a channel measures in each plane."""

    PITCH_RATE = auto()
    """[deg/s]"""
    PITCH = auto()
    """[deg]"""
    ESTIMATED_PITCH = auto()
    """The pitch as the controller estimates it [deg]: the integral of the gyro's reading less its
    offset, which is a low pass of the reading. It forgets the true pitch in the time `filter_s`."""
    SHAFT = auto()
    """Angle of the motor shaft [deg]."""
    POSITION = auto()
    """[m]"""


@dataclass(frozen=True)
class Channel:
    """A measured signal of both planes.

    Attributes
    ----------
    name, unit : str
    quantity : Quantity
        What it measures.
    noise : float
        Standard deviation of its error to begin with, in its unit. That of the truth is what the
        model of a segment leaves.
    is_rounded : bool
        Whether its readings are whole numbers.
    has_offset : bool
        Whether it has an unknown offset, constant for seconds.
    filter_s : float
        Of an estimated pitch, the time constant of the low pass [s].
    """

    name: str
    unit: str
    quantity: Quantity
    noise: float
    is_rounded: bool = False
    has_offset: bool = False
    filter_s: float = 0.0


GYRO = Channel('gyro', 'deg/s', Quantity.PITCH_RATE, 0.8, is_rounded=True, has_offset=True)
ENCODER = Channel('encoder', 'deg', Quantity.SHAFT, 0.3, is_rounded=True)
TRUE_PITCH_RATE = Channel('pitch rate', 'deg/s', Quantity.PITCH_RATE, 1e-3)
TRUE_PITCH = Channel('pitch', 'deg', Quantity.PITCH, 1e-4)
TRUE_POSITION = Channel('position', 'm', Quantity.POSITION, 1e-6)

LOGGED_ENCODER = Channel('encoder', 'deg', Quantity.SHAFT, 0.3)
"""In whole degrees. Read a few times a second, its rounding is like noise."""

LOGGED_PITCH = Channel(
    'estimated pitch', 'deg', Quantity.ESTIMATED_PITCH, 0.02, has_offset=True,
    filter_s=TICK_S / (1.0 - ControllerParameters().a_gd),
)  # fmt: skip

TRUE_BATTERY_V = 1e-6
"""Standard deviation of the battery voltage in the plant's topic [V], in single precision."""


@dataclass(frozen=True)
class Experiment:
    """The readings of a run, at equal steps of time.

    Attributes
    ----------
    name : str
    plant : PlantParameters
        What is known of the robot; the identified parameters replace its values.
    duty : ndarray, shape (n, 2), or None
        Duties [%] from each reading to the next, which are ticks then. None if they are not known:
        then each motor has an unknown voltage from each reading to the next.
    readings : mapping of Channel to ndarray, shape (n, 2)
        NaN where there is none.
    battery : ndarray, shape (n,)
        Battery voltage [V]; NaN where it was not measured.
    battery_count : float
        Resolution of its reading [V]; 0 if it is not rounded.
    usable : ndarray, shape (n,)
        Whether only the motors moved the robot, from this reading to the next.
    ages : mapping of Channel to int
        Dead time of each channel [steps].
    notes : tuple of str
        What a reader of the result should know.
    recorded : PlantParameters or None
        The parameters of the recorded robot, if they are known.
    steps_per_reading : int
        Number of steps that the plant is simulated with, from each reading to the next.
    step_s : float
        Length of such a step [s].
    """

    name: str
    plant: PlantParameters
    duty: NDArray[Any] | None
    readings: Mapping[Channel, Floats]
    battery: Floats
    battery_count: float
    usable: NDArray[np.bool_]
    ages: Mapping[Channel, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    recorded: PlantParameters | None = None
    steps_per_reading: int = STEPS_PER_TICK
    step_s: float = STEP_NS * 1e-9

    @property
    def reading_s(self) -> float:
        """Time from each reading to the next [s]."""
        return self.steps_per_reading * self.step_s

    @property
    def battery_error(self) -> float:
        """Standard deviation of the error of a battery reading [V].

        It is a whole count: the voltage changes slowly, so that readings round in the same way.
        """
        return self.battery_count or TRUE_BATTERY_V

    @property
    def battery_offset(self) -> float:
        """Standard deviation of the error that all battery readings have in common [V]."""
        if not self.battery_count:
            return TRUE_BATTERY_V
        spread = np.nanvar(self.battery / self.battery_count) - ROUNDING_DEVIATION**2
        return self.battery_count * common_rounding(math.sqrt(max(0.0, float(spread))))
