"""Parameters of the drivers of the brick's devices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from ballbot_ros.parameters.parameter import DriverParameters, dead_time, quantity, setting
from ballbot_ros.parameters.shared import BodyDepth, DeviceSeed, MapChoice
from ballbot_ros.timing import SLOW_PERIOD_NS, TICK_NS


@dataclass(frozen=True, kw_only=True)
class DeviceParameters(DeviceSeed, DriverParameters):
    """The parameters that the driver of each device has.

    Each driver declares its own dead time: declared here, it would be one value for all of them.
    """

    delay: int
    delay_jitter: int


@dataclass(frozen=True, kw_only=True)
class GyroParameters(DeviceParameters):
    """The parameters of ``gyro_driver``."""

    node: ClassVar[str] = 'gyro_driver'
    period_ns: ClassVar[int] = TICK_NS

    delay: int = dead_time('age of the samples')
    delay_jitter: int = dead_time('largest random addition to the delay')
    zero_rate_offset_x: float = quantity(
        600.0, 'deg/s', (0.0, 1023.0), 'reading at rest, gyro S1 (x)', 'facts'
    )
    zero_rate_offset_y: float = quantity(
        600.0, 'deg/s', (0.0, 1023.0), 'reading at rest, gyro S2 (y)', 'facts'
    )
    noise: float = quantity(0.0, 'deg/s', (0.0, 100.0), 'standard deviation of the noise', '2.2')
    drift: float = quantity(
        0.0, 'deg/s', (0.0, 50.0), 'amplitude of the slow drift of the offset', '2.2'
    )
    drift_period: float = quantity(300.0, 's', (1.0, 1e6), 'period of the drift', '2.2')
    rate_limit: float = quantity(
        360.0, 'deg/s', (1.0, 1e4), 'largest rate that the gyro measures', 'facts'
    )


@dataclass(frozen=True, kw_only=True)
class EncoderParameters(DeviceParameters):
    """The parameters of ``encoder_driver``: an encoder only counts degrees."""

    node: ClassVar[str] = 'encoder_driver'
    period_ns: ClassVar[int] = TICK_NS

    delay: int = dead_time('age of the samples')
    delay_jitter: int = dead_time('largest random addition to the delay')


@dataclass(frozen=True, kw_only=True)
class SonarParameters(DeviceParameters, MapChoice, BodyDepth):
    """The parameters of ``sonar_driver``."""

    node: ClassVar[str] = 'sonar_driver'
    period_ns: ClassVar[int] = SLOW_PERIOD_NS

    delay: int = dead_time('age of the samples')
    delay_jitter: int = dead_time('largest random addition to the delay')
    noise_cm: float = quantity(0.0, 'cm', (0.0, 50.0), 'largest error of a distance', 'facts')
    dropout_probability: float = quantity(
        0.0, '1', (0.0, 1.0), 'share of missed echoes (255)', 'facts'
    )
    max_range_cm: float = quantity(
        255.0, 'cm', (1.0, 255.0), 'distance from which on no echo returns', 'facts'
    )
    min_range_cm: float = quantity(
        0.0, 'cm', (0.0, 255.0), 'distance below which half of the echoes are missed', 'facts'
    )
    distance_model: Literal['exact', 'stepped'] = setting(
        'exact', 'distance along a ray: exactly, or in steps of 1 cm', 'B.3'
    )
    cone_angle: float = quantity(
        0.0, 'rad', (0.0, 3.0), 'opening of the sound cone; 0: a single ray', 'project'
    )
    cone_rays: int = quantity(
        7, '1', (1, 99), 'rays of the cone, an odd number; the nearest echo counts', 'project'
    )


DEVICES: tuple[type[DeviceParameters], ...] = (GyroParameters, EncoderParameters, SonarParameters)
"""The parameter classes of the devices' drivers, one for each device."""
