"""The devices: what each measures, and where the brick reads it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeAlias, TypeVar

from ballbot_ros.brick.encoder import Encoder
from ballbot_ros.brick.gyro import Gyro
from ballbot_ros.brick.sonar import Sonar
from ballbot_ros.parameters import (
    DriverParameters,
    EncoderParameters,
    GyroParameters,
    SonarParameters,
)
from ballbot_ros.plant.truth import GroundTruth, Pair
from ballbot_ros.world.sonar_beam import SonarBeam

P = TypeVar('P', bound=DriverParameters)
"""The parameters of a device's driver."""

Measured = TypeVar('Measured')
"""What a device measures, in SI."""

Reading = TypeVar('Reading')
"""What it gives, in the brick's integers."""

Read: TypeAlias = Callable[[Measured, int], Reading]
"""Returns the reading of what is measured at a stamp [ns]."""


@dataclass(frozen=True)
class Device(Generic[P, Measured, Reading]):
    """A device of the brick.

    Attributes
    ----------
    parameters : type
        The parameters of its driver.
    field : str
        Field of :class:`~ballbot_ros.brick.brick.DeviceInputs` that has its readings.
    measured : callable
        Returns what it measures of a :class:`~ballbot_ros.plant.truth.GroundTruth`.
    make : callable
        Makes one from its parameters, and returns what reads it. A reading is a function of what
        is measured and of the stamp, whatever was read before. Raises BallbotError if the
        parameters can't act together.
    """

    parameters: type[P]
    field: str
    measured: Callable[[GroundTruth], Measured]
    make: Callable[[P], Read[Measured, Reading]]

    @property
    def period_ns(self) -> int:
        """The sim time from one sample to the next [ns]."""
        return self.parameters.period_ns


def _gyro(parameters: GyroParameters) -> Read[Pair, tuple[int, int]]:
    return Gyro(parameters).read


def _encoder(parameters: EncoderParameters) -> Read[Pair, tuple[int, int]]:
    return Encoder().read


def _sonar(parameters: SonarParameters) -> Read[Pair, int]:
    sonar, beam = Sonar(parameters), SonarBeam(parameters)
    return lambda position, stamp_ns: sonar.read(beam.distance_m(position), stamp_ns)


GYRO_DEVICE = Device(GyroParameters, 'gyro', lambda truth: truth.psi_rate, _gyro)
ENCODER_DEVICE = Device(EncoderParameters, 'revolutions', lambda truth: truth.motor_angle, _encoder)
SONAR_DEVICE = Device(SonarParameters, 'sonar_cm', lambda truth: truth.position, _sonar)

AnyDevice: TypeAlias = Device[Any, Any, Any]
"""A device of any kind."""

DEVICES: tuple[AnyDevice, ...] = (GYRO_DEVICE, ENCODER_DEVICE, SONAR_DEVICE)
