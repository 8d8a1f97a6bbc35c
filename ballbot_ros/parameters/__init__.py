"""The parameters of each node, their checks, and the files and pages generated from them."""

from ballbot_ros.parameters.controller import ControllerParameters, Implementation
from ballbot_ros.parameters.devices import (
    DEVICES,
    EncoderParameters,
    GyroParameters,
    SonarParameters,
)
from ballbot_ros.parameters.parameter import (
    DriverParameters,
    NodeParameters,
    Parameter,
    ParameterError,
    Subset,
    TakesEffect,
    Value,
)
from ballbot_ros.parameters.parameter_set import ParameterSet
from ballbot_ros.parameters.plant import PlantParameters
from ballbot_ros.parameters.shared import Dimensions
from ballbot_ros.parameters.table import (
    ALL_NODES,
    CONTROLLER,
    DRIVER_PERIODS_NS,
    DRIVERS,
    EXECUTABLES,
    GAMEPAD,
    GYRO,
    NODES,
    OPTIONAL_NODES,
    PATHS,
    PLANT,
    PLAYER,
    RECORDER,
    SHARED_PARAMETERS,
    SIMULATED,
    SONAR,
    SUPERVISOR,
    TABLE,
    VIEWER,
    VISUALIZER,
    parameters_of,
    suggest_names,
)
from ballbot_ros.parameters.teleop import GamepadParameters
from ballbot_ros.parameters.tools import (
    PlayerParameters,
    RecorderParameters,
    SupervisorParameters,
    ViewerParameters,
    VisualizerParameters,
)

__all__ = [
    'ALL_NODES', 'CONTROLLER', 'DEVICES', 'DRIVERS', 'DRIVER_PERIODS_NS', 'EXECUTABLES',
    'GAMEPAD', 'GYRO', 'NODES', 'OPTIONAL_NODES', 'PATHS', 'PLANT', 'PLAYER', 'RECORDER',
    'SHARED_PARAMETERS', 'SIMULATED', 'SONAR', 'SUPERVISOR', 'TABLE', 'VIEWER', 'VISUALIZER',
    'ControllerParameters', 'Dimensions', 'DriverParameters', 'EncoderParameters',
    'GamepadParameters', 'GyroParameters', 'Implementation', 'NodeParameters', 'Parameter',
    'ParameterError', 'ParameterSet', 'PlantParameters', 'PlayerParameters', 'RecorderParameters',
    'SonarParameters', 'Subset', 'SupervisorParameters', 'TakesEffect', 'Value', 'ViewerParameters',
    'VisualizerParameters', 'parameters_of', 'suggest_names',
]  # fmt: skip
