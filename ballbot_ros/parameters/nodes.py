"""Parameters of the nodes, and those that several nodes share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from ballbot_ros.parameters.brick_time import LinkParameters
from ballbot_ros.parameters.parameter import (
    DriverParameters,
    NodeParameters,
    Subset,
    TakesEffect,
    dead_time,
    fault_list,
    live,
    path,
    quantity,
    setting,
)
from ballbot_ros.parameters.timing import SLOW_PERIOD_NS, TICK_NS

READ_ONLY = TakesEffect.READ_ONLY

LogContent = Literal['pitch', 'duties', 'duties_and_gyros']
"""What a log packet of the document's program has: the pitch, and each adds to the one before."""


@dataclass(frozen=True, kw_only=True)
class DeviceSeed:
    """The seed of the device noise and jitter."""

    seed: int = quantity(1, '1', (0, 2**63 - 1), 'seed of all device noise and jitter of the run')


@dataclass(frozen=True, kw_only=True)
class MapChoice:
    """The map that the robot drives on."""

    map: str = path('map (shipped name or image file); empty: unlimited floor', 'B.2')


@dataclass(frozen=True, kw_only=True)
class ScenarioChoice:
    """The scenario that a node takes part in."""

    scenario: str = path('scenario (name or file) for stick signals and pushes; empty: none', '5.1')
    live_from: float = quantity(
        0.0,
        's',
        (0.0, 1e6),
        'time of a run up to which it neither waits for the wall clock nor takes live sticks',
    )


@dataclass(frozen=True, kw_only=True)
class BrickFaults:
    """The faults of what is part of the brick, which concern its program, too."""

    faults: str = fault_list('motor_x, motor_y, battery, brick and tasks')


@dataclass(frozen=True, kw_only=True)
class LockstepChoice:
    """Whether the graph runs in lockstep."""

    lockstep: bool = setting(
        True,
        'true: each tick waits for its inputs; false: wall-clock timers, newest sample wins',
        takes_effect=READ_ONLY,
    )


@dataclass(frozen=True, kw_only=True)
class StickScale:
    """The meaning of a full stick."""

    k_thetadot: float = live(380.0, 'deg/s', (0.0, 1e4), 'speed reference gain (0.17 m/s)', '7.7')
    gp_max: int = quantity(100, '%', (1, 127), 'largest stick value', '5.1')


@dataclass(frozen=True, kw_only=True)
class BallRadius:
    """The size of the ball."""

    ball_radius: float = quantity(0.026, 'm', (1e-3, 1.0), 'spherical wheel radius Rs', '3.1')


@dataclass(frozen=True, kw_only=True)
class Radii(BallRadius):
    """The sizes of the rolling parts."""

    wheel_radius: float = quantity(
        0.021, 'm', (1e-3, 1.0), 'motor wheel (rubber tire) radius Rw', '3.1'
    )


@dataclass(frozen=True, kw_only=True)
class BodyDepth:
    """The extent of the body in x."""

    body_depth: float = quantity(0.135, 'm', (0.0, 10.0), 'body depth D, along x', '3.1')


@dataclass(frozen=True, kw_only=True)
class Dimensions(Radii, BodyDepth, Subset):
    """All lengths that determine the robot's shape."""

    wheel_width: float = quantity(
        0.022, 'm', (0.0, 1.0), 'motor wheel height (width of the tire) Lw', '3.1'
    )
    body_width: float = quantity(0.135, 'm', (0.0, 10.0), 'body width W, along y', '3.1')
    body_height: float = quantity(
        0.17, 'm', (1e-3, 10.0), 'distance L from the ball centre to the body centre', '3.1'
    )


@dataclass(frozen=True, kw_only=True)
class Masses:
    """The masses of the robot's parts."""

    ball_mass: float = quantity(0.013, 'kg', (1e-06, 100.0), 'spherical wheel mass Ms', '3.1')
    wheel_mass: float = quantity(0.015, 'kg', (0.0, 100.0), 'motor wheel mass Mw', '3.1')
    body_mass: float = quantity(0.682, 'kg', (1e-06, 100.0), 'body mass Mb', '3.1')


@dataclass(frozen=True, kw_only=True)
class DeviceParameters(DeviceSeed, DriverParameters):
    """The parameters that the driver of each device has.

    Each driver declares its own dead time and faults: declared here, they would be one value for
    all of them.
    """

    delay: int
    delay_jitter: int
    faults: str


@dataclass(frozen=True, kw_only=True)
class GyroParameters(DeviceParameters, LinkParameters):
    """The parameters of ``gyro_driver``."""

    node: ClassVar[str] = 'gyro_driver'
    period_ns: ClassVar[int] = TICK_NS

    delay: int = dead_time('age of the samples')
    delay_jitter: int = dead_time('largest random addition to the delay')
    faults: str = fault_list('gyro_x and gyro_y')
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
    faults: str = fault_list('encoder_x and encoder_y')


@dataclass(frozen=True, kw_only=True)
class SonarParameters(DeviceParameters, MapChoice, BodyDepth):
    """The parameters of ``sonar_driver``."""

    node: ClassVar[str] = 'sonar_driver'
    period_ns: ClassVar[int] = SLOW_PERIOD_NS

    delay: int = dead_time('age of the samples')
    delay_jitter: int = dead_time('largest random addition to the delay')
    faults: str = fault_list('sonar')
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
        0.0, 'rad', (0.0, 3.0), 'opening of the sound cone; 0: a single ray'
    )
    cone_rays: int = quantity(
        7, '1', (1, 99), 'rays of the cone, an odd number; the nearest echo counts'
    )


DEVICES: tuple[type[DeviceParameters], ...] = (GyroParameters, EncoderParameters, SonarParameters)
"""The parameter classes of the devices' drivers, one for each device."""


SHARE = (0.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class DrivingInputs(BallRadius, StickScale, NodeParameters):
    """The inputs that drive the robot by hand."""

    device: str = setting(
        'any', 'gamepad to read directly: any, its number, or part of its name; empty: none'
    )
    keyboard: bool = setting(False, 'true: the arrow keys of the terminal drive')
    require_enable_button: bool = setting(
        False, 'true: the sticks of joy and gamepad only work while the enable button is pressed'
    )
    enable_button: int = quantity(9, '1', (0, 63), 'enable button; 9 is the left shoulder')
    enable_turbo_button: int = quantity(
        -1, '1', (-1, 63), 'button for the turbo scales, which also enables; -1: none'
    )
    deadzone: float = quantity(0.05, '1', (0.0, 0.95), 'neutral share of an axis around its centre')
    axis_forward: int = quantity(1, '1', (-1, 63), 'axis that drives forward; -1: none')
    axis_rightward: int = quantity(2, '1', (-1, 63), 'axis that drives rightward; -1: none')
    scale_forward: float = quantity(1.0, '1', SHARE, 'share of the full stick at a full axis')
    scale_rightward: float = quantity(1.0, '1', SHARE, 'share of the full stick at a full axis')
    scale_forward_turbo: float = quantity(
        1.0, '1', SHARE, 'share of the full stick at a full axis, turbo button'
    )
    scale_rightward_turbo: float = quantity(
        1.0, '1', SHARE, 'share of the full stick at a full axis, turbo button'
    )
    invert_forward: bool = setting(False, 'true: the forward axis is reversed')
    invert_rightward: bool = setting(False, 'true: the rightward axis is reversed')


@dataclass(frozen=True, kw_only=True)
class GamepadParameters(
    DrivingInputs, ScenarioChoice, LockstepChoice, DeviceSeed, DriverParameters
):
    """The parameters of ``gamepad_teleop``."""

    node: ClassVar[str] = 'gamepad_teleop'
    period_ns: ClassVar[int] = SLOW_PERIOD_NS

    faults: str = fault_list('gamepad')


@dataclass(frozen=True, kw_only=True)
class LogFormat(Radii, Subset):
    """What the numbers in a packet of the data log mean."""

    lsb: float = quantity(
        2.0**-10, 'deg', (1e-09, 1000.0), 'value of one bit of the logged pitch', '7.4'
    )
    log_content: LogContent = setting(
        'pitch',
        "content of the document's log packets: the pitch; also the duties, in data 1 and 2; also "
        'the gyro readings, in ADC S3 and S4',
    )


@dataclass(frozen=True, kw_only=True)
class BrickLinkParameters(LogFormat, DrivingInputs):
    """The parameters of ``brick_link``."""

    node: ClassVar[str] = 'brick_link'

    address: str = setting(
        '', 'Bluetooth address of the brick; empty: use serial_port', takes_effect=READ_ONLY
    )
    serial_port: str = path(
        'serial device or socket that leads to the brick; empty: use address',
        takes_effect=READ_ONLY,
    )
    output: str = path('recording to write; empty: none', takes_effect=READ_ONLY)
    attachments: str = path(
        'folder whose files are attached to the recording; empty: none', takes_effect=READ_ONLY
    )


@dataclass(frozen=True, kw_only=True)
class RecorderParameters(NodeParameters):
    """The parameters of ``recorder``."""

    node: ClassVar[str] = 'recorder'

    output: str = path('file to write; empty: a new one under runs/', takes_effect=READ_ONLY)
    attachments: str = path(
        'folder whose files are attached to the recording; empty: none', takes_effect=READ_ONLY
    )


@dataclass(frozen=True, kw_only=True)
class PlayerParameters(NodeParameters):
    """The parameters of ``player``."""

    node: ClassVar[str] = 'player'

    file: str = path('recording to play', takes_effect=READ_ONLY)
    rate: float = live(1.0, '1', (0.01, 100.0), 'speed in multiples of real time')
    start: float = quantity(
        0.0, 's', (0.0, 1e9), 'start, counted from the first message', takes_effect=READ_ONLY
    )
    loop: bool = setting(False, 'true: restarts at the end', takes_effect=READ_ONLY)
    topics: str = setting(
        '', 'topics to play, separated by commas; empty: all', takes_effect=READ_ONLY
    )


@dataclass(frozen=True, kw_only=True)
class ViewerParameters(Dimensions, MapChoice, NodeParameters):
    """The parameters of ``viewer``."""

    node: ClassVar[str] = 'viewer'

    host: str = setting(
        '127.0.0.1',
        'address that serves the page: all who reach it can watch, those with the token can steer',
        takes_effect=READ_ONLY,
    )
    port: int = quantity(
        -1,
        '1',
        (-1, 65535),
        'port of the page; -1: 8080, or the next free one; 0: any free one',
        takes_effect=READ_ONLY,
    )


@dataclass(frozen=True, kw_only=True)
class VisualizerParameters(Dimensions, Masses, NodeParameters):
    """The parameters of ``robot_visualizer``."""

    node: ClassVar[str] = 'robot_visualizer'

    rate: float = quantity(
        30.0,
        'Hz',
        (1.0, 250.0),
        'maximum rate of markers, transforms and odometry',
        takes_effect=READ_ONLY,
    )


@dataclass(frozen=True, kw_only=True)
class SupervisorParameters(NodeParameters):
    """The parameters of ``supervisor``."""

    node: ClassVar[str] = 'supervisor'

    scenario: str = path(
        'scenario (name or file) that supervisor/start begins, or @T, the last run from T s on',
        takes_effect=TakesEffect.IMMEDIATELY,
    )
