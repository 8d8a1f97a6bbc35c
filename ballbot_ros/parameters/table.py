"""The nodes, and the parameters of each.

The ROS declarations, the validation of parameter files, ``config/ballbot.yaml`` and
``docs/parameters.md`` are all made from :data:`TABLE`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from difflib import get_close_matches

from ballbot_ros.parameters.controller import ControllerParameters
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
    table,
)
from ballbot_ros.parameters.plant import PlantParameters
from ballbot_ros.parameters.teleop import GamepadParameters
from ballbot_ros.parameters.tools import (
    PlayerParameters,
    RecorderParameters,
    SupervisorParameters,
    ViewerParameters,
    VisualizerParameters,
)

PARTICIPANTS: tuple[type[NodeParameters], ...] = (
    PlantParameters,
    *DEVICES,
    ControllerParameters,
    GamepadParameters,
    RecorderParameters,
)
TOOLS: tuple[type[NodeParameters], ...] = (
    PlayerParameters,
    ViewerParameters,
    VisualizerParameters,
    SupervisorParameters,
)
CLASSES = {cls.node: cls for cls in PARTICIPANTS + TOOLS}
"""The parameters of each node, by its name."""

PLANT = PlantParameters.node
GYRO = GyroParameters.node
ENCODER = EncoderParameters.node
SONAR = SonarParameters.node
CONTROLLER = ControllerParameters.node
GAMEPAD = GamepadParameters.node
RECORDER = RecorderParameters.node

NODES = tuple(cls.node for cls in PARTICIPANTS)
"""The participants of a run."""

DRIVER_PERIODS_NS = {
    cls.node: cls.period_ns for cls in PARTICIPANTS if issubclass(cls, DriverParameters)
}
"""Sampling period of each driver in sim time [ns]."""

DRIVERS = tuple(DRIVER_PERIODS_NS)
"""The participants that answer the plant's truth."""

_SIMULATED: tuple[type[NodeParameters], ...] = (PlantParameters, *DEVICES, ControllerParameters)
SIMULATED = frozenset(cls.node for cls in _SIMULATED if fields(cls))
"""Nodes without whose parameters a run can't be made again."""

PLAYER = PlayerParameters.node
VIEWER = ViewerParameters.node
VISUALIZER = VisualizerParameters.node
SUPERVISOR = SupervisorParameters.node

OPTIONAL_NODES = tuple(cls.node for cls in TOOLS)
"""Nodes that a run does without."""

ALL_NODES = NODES + OPTIONAL_NODES

EXECUTABLES = tuple(node for node in ALL_NODES if node != SUPERVISOR)
"""Nodes that are programs; the supervisor is a part of ``ballbot run --viewer``."""

TABLE = table(PARTICIPANTS + TOOLS)
"""Every parameter of every node; what several share is one row."""

PATHS = frozenset(row.name for row in TABLE if row.is_path)
"""Parameters that name, or may name, a file or folder."""

AGREED = tuple(
    row.name for row in TABLE if len(set(row.nodes) & set(NODES)) > 1 and row.name != 'scenario'
)
"""Parameters that the participants of a run have to agree on. A scenario may be given to the plant
for its pushes, or to the gamepad for its sticks, alone."""

_BY_NODE: dict[str, dict[str, Parameter]] = {
    node: {row.name: row for row in TABLE if node in row.nodes} for node in ALL_NODES
}


def parameters_of(node: str) -> Mapping[str, Parameter]:
    """Return the rows that `node` declares, by name."""
    return _BY_NODE[node]


def nearest(name: str, node: str) -> str:
    """Return a hint at what `name` may have meant, or what `node` has."""
    known = sorted(_BY_NODE[node])
    close = get_close_matches(name, known)
    if close:
        return f'did you mean {" or ".join(close)}?'
    return f'it has {", ".join(known) or "none"}'
