"""The table of devices: what each one measures, and which field of the brick holds it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeAlias, TypeVar

from ballbot_ros.brick.dead_time import DeadTime
from ballbot_ros.brick.encoder import Encoder
from ballbot_ros.brick.gyro import Gyro
from ballbot_ros.brick.sonar import Sonar
from ballbot_ros.parameters import (
    DeviceParameters,
    EncoderParameters,
    GyroParameters,
    SonarParameters,
)
from ballbot_ros.plant.ground_truth import GroundTruth, MeasuredState, Pair
from ballbot_ros.world.sonar_beam import SonarBeam

P = TypeVar('P', bound=DeviceParameters)
"""Parameters of a device's driver."""

Measured = TypeVar('Measured')
"""The measured quantity, in SI."""

Reading = TypeVar('Reading')
"""The reading, in the brick's integers."""

Read: TypeAlias = Callable[[Measured, int], Reading]
"""Returns the reading of a quantity at a stamp [ns]."""

TrueState: TypeAlias = GroundTruth | MeasuredState
"""The present state, or that of an earlier step."""


@dataclass(frozen=True)
class Device(Generic[P, Measured, Reading]):
    """A device of the brick.

    Attributes
    ----------
    field : str
        Field of :class:`~ballbot_ros.brick.brick.DeviceInputs` that holds its readings.
    measured : callable
        Returns the measured quantity of a true state.
    make : callable
        Creates a device from its parameters and returns its read function. A reading depends only
        on the measured quantity and the stamp, never on earlier readings. Raises BallbotError if
        the parameters contradict each other.
    """

    parameters: type[P]
    field: str
    measured: Callable[[TrueState], Measured]
    make: Callable[[P], Read[Measured, Reading]]

    @property
    def period_ns(self) -> int:
        """Sampling period in sim time [ns]."""
        return self.parameters.period_ns

    def dead_time(self, parameters: P) -> DeadTime:
        """Return the dead time of the samples."""
        return DeadTime(
            self.parameters.node.removesuffix('_driver'), self.period_ns,
            parameters.delay, parameters.delay_jitter, parameters.seed,
        )  # fmt: skip

    def sampled(self, parameters: P) -> Callable[[GroundTruth], Measured]:
        """Return the function that measures the quantity of the sample at a tick."""
        dead_time, measured = self.dead_time(parameters), self.measured
        if not dead_time.longest:
            return measured
        return lambda truth: measured(truth.steps[-1 - dead_time.age(truth.stamp_ns)])


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
