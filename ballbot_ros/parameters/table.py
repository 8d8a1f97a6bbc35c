"""The nodes, and the parameters of each.

The ROS declarations, the validation of parameter files, ``config/ballbot.yaml`` and
``docs/parameters.md`` are all derived from :data:`TABLE`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from ballbot_ros.errors import similar
from ballbot_ros.parameters.controller import ControllerParameters
from ballbot_ros.parameters.nodes import (
    DEVICES,
    GamepadParameters,
    GyroParameters,
    PlayerParameters,
    RecorderParameters,
    SonarParameters,
    SupervisorParameters,
    ViewerParameters,
    VisualizerParameters,
)
from ballbot_ros.parameters.parameter import (
    DriverParameters,
    NodeParameters,
    Parameter,
    table,
)
from ballbot_ros.parameters.plant import PlantParameters

PARTICIPANTS: tuple[type[NodeParameters], ...] = (
    PlantParameters,
    *DEVICES,
    ControllerParameters,
    GamepadParameters,
    RecorderParameters,
)
OPTIONAL_CLASSES: tuple[type[NodeParameters], ...] = (
    PlayerParameters,
    ViewerParameters,
    VisualizerParameters,
    SupervisorParameters,
)
CLASSES = {cls.node: cls for cls in PARTICIPANTS + OPTIONAL_CLASSES}
"""The class of each node's parameters, by node name."""

PLANT = PlantParameters.node
GYRO = GyroParameters.node
SONAR = SonarParameters.node
CONTROLLER = ControllerParameters.node
GAMEPAD = GamepadParameters.node
RECORDER = RecorderParameters.node

NODES = tuple(cls.node for cls in PARTICIPANTS)
"""The participants of a run."""

ROLES = tuple(node for node in NODES if node != PLANT)
"""The participants whose place another program may take: all but the plant, which owns the run."""

DRIVER_PERIODS_NS = {
    cls.node: cls.period_ns for cls in PARTICIPANTS if issubclass(cls, DriverParameters)
}
"""Sampling period of each driver in sim time [ns]."""

DRIVERS = tuple(DRIVER_PERIODS_NS)
"""The participants that answer the plant's true state."""

_SIMULATED: tuple[type[NodeParameters], ...] = (PlantParameters, *DEVICES, ControllerParameters)
SIMULATED = frozenset(cls.node for cls in _SIMULATED)
"""Nodes whose parameters are needed to replay a run."""

PLAYER = PlayerParameters.node
VIEWER = ViewerParameters.node
VISUALIZER = VisualizerParameters.node
SUPERVISOR = SupervisorParameters.node

OPTIONAL_NODES = tuple(cls.node for cls in OPTIONAL_CLASSES)
"""Nodes that a run does not need."""

ALL_NODES = NODES + OPTIONAL_NODES

EXECUTABLES = tuple(node for node in ALL_NODES if node != SUPERVISOR)
"""Nodes that are programs; the supervisor is part of ``ballbot run --viewer``."""

TABLE = table(PARTICIPANTS + OPTIONAL_CLASSES)
"""Every parameter of every node, with one row for a shared parameter."""

PATHS = frozenset(row.name for row in TABLE if row.is_path)
"""Parameters that are, or may be, paths of files or folders."""

SHARED_PARAMETERS = tuple(
    row.name for row in TABLE if len(set(row.nodes) & set(NODES)) > 1 and row.name != 'scenario'
)
"""Parameters on which the participants of a run must agree. A scenario is not among them: it may be
given only to the plant, for its pushes, or only to the gamepad, for its sticks."""

_BY_NODE: dict[str, dict[str, Parameter]] = {
    node: {row.name: row for row in TABLE if node in row.nodes} for node in ALL_NODES
}


def parameters_of(node: str) -> Mapping[str, Parameter]:
    """Return the parameters of `node`, by name."""
    return _BY_NODE[node]


def suggest(name: str, known: Iterable[str]) -> str:
    """Return a hint about a misspelt `name`, or all `known` names."""
    known = sorted(known)
    group, dot, rest = name.rpartition('.')
    alike = [each.removeprefix(group + dot) for each in known if each.startswith(group + dot)]
    if found := similar(rest, alike, group + dot):
        return f'did you mean {found}?'
    return f'it has {", ".join(known) or "none"}'
