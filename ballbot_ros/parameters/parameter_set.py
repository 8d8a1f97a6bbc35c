"""The nodes, their parameters, and a set of values that are checked when they are set.

The ROS declarations, the validation of parameter files, ``config/ballbot.yaml`` and
the page of parameters on the documentation site are all derived from :data:`TABLE`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import TypeVar

from ballbot_ros.errors import did_you_mean, similar
from ballbot_ros.parameters.controller import ControllerParameters, is_own
from ballbot_ros.parameters.nodes import (
    DEVICES,
    BrickLinkParameters,
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
    ParameterError,
    Value,
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
    BrickLinkParameters,
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

COMMON_PERIOD_NS = math.lcm(*DRIVER_PERIODS_NS.values())
"""At its multiples, every driver has a sample [ns]."""

DRIVERS = tuple(DRIVER_PERIODS_NS)
"""The participants that answer the plant's true state."""

ROBOT_CLASSES: tuple[type[NodeParameters], ...] = (PlantParameters, *DEVICES, ControllerParameters)
"""The nodes whose parameters the motion of a robot depends on."""

SIMULATED = frozenset(cls.node for cls in ROBOT_CLASSES)
"""Nodes whose parameters are needed to replay a run."""

PLAYER = PlayerParameters.node
VIEWER = ViewerParameters.node
VISUALIZER = VisualizerParameters.node
SUPERVISOR = SupervisorParameters.node
BRICK_LINK = BrickLinkParameters.node

OPTIONAL_NODES = tuple(cls.node for cls in OPTIONAL_CLASSES)
"""Nodes that a run does not need."""

ALL_NODES = NODES + OPTIONAL_NODES

EXECUTABLES = tuple(node for node in ALL_NODES if node != SUPERVISOR)
"""Nodes that are programs; the supervisor is part of ``ballbot run --viewer``."""

TABLE = table(PARTICIPANTS + OPTIONAL_CLASSES)
"""Every parameter of every node, with one row for a shared parameter."""

PATHS = frozenset(row.name for row in TABLE if row.is_path)
"""Parameters that are, or may be, paths of files or folders."""

SHARED_PARAMETERS = {
    row.name: row.nodes
    for row in TABLE
    if len(set(row.nodes) & set(NODES)) > 1 and row.name != 'scenario'
}
"""Parameters on which participants of a run must agree, and their roles. A scenario is not among
them: it may be given only to the plant, for its pushes, or only to the gamepad, for its sticks."""

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


_Node = TypeVar('_Node', bound=NodeParameters)


class ParameterSet:
    """A value for every parameter of every node; unset ones have their defaults.

    The controller's own parameters (:data:`~ballbot_ros.parameters.controller.OWN_PREFIXES`) depend
    on its class. They are kept as given until :meth:`declare_own`, which checks them. Another set
    is what to begin with.
    """

    def __init__(self, other: ParameterSet | None = None) -> None:
        self._values: dict[tuple[str, str], Value] = {}
        self._given_own: dict[str, tuple[object, str]] = {}
        self._own: dict[str, Parameter] | None = None
        self._class = ''
        if other is not None:
            self.update(other)

    def __iter__(self) -> Iterator[tuple[str, str, Value]]:
        """Yield node, name and value of all parameters that were set."""
        for (node, name), value in self._values.items():
            yield node, name, value

    def set(self, node: str, name: str, value: object, where: str = '') -> None:
        """Set `name` of `node`, or for ``'/**'`` of every node that has it.

        It raises ParameterError if the node or the parameter is unknown, or the value is not
        allowed; the message begins with `where`, such as a file and line, or an option.
        """
        prefix = f'{where}: ' if where else ''
        if is_own(name) and node in ('/**', CONTROLLER):
            self._set_own(name, value, prefix)
            return
        if node == '/**':
            nodes = [known for known in ALL_NODES if name in parameters_of(known)]
            if not nodes:
                raise ParameterError(f'{prefix}no node has a parameter {name!r}')
        elif node in ALL_NODES:
            nodes = [node]
        else:
            hint = did_you_mean(node, ALL_NODES)
            known = ', '.join(ALL_NODES)
            raise ParameterError(f'{prefix}unknown node {node!r}{hint}; known: {known}')
        for each in nodes:
            row = parameters_of(each).get(name)
            if row is None:
                hint = suggest(name, parameters_of(each))
                if each == CONTROLLER and not hint.startswith('did'):
                    hint += "; the names of those of another controller's class begin with user."
                raise ParameterError(f'{prefix}{each} has no parameter {name!r}; {hint}')
            checked = row.check(value, f'{prefix}{each}.')
            # Set a shared parameter in all nodes that share it: they must agree on its value.
            for sharer in row.nodes:
                self._values[sharer, name] = checked

    def _set_own(self, name: str, value: object, prefix: str) -> None:
        if self._own is None:
            self._given_own[name] = (value, prefix)
            return
        row = self._own.get(name)
        if row is None:
            group = name.partition('.')[0]
            alike = [each for each in self._own if each.startswith(f'{group}.')]
            hint = suggest(name, alike) if alike else f'it has no {group} parameters'
            raise ParameterError(
                f'{prefix}the {CONTROLLER} {self._class} has no parameter {name!r}; {hint}'
            )
        self._values[CONTROLLER, name] = row.check(value, f'{prefix}{CONTROLLER}.')

    def declare_own(self, class_name: str, rows: Iterable[Parameter]) -> None:
        """Declare the parameters of the controller's class; check values so far as :meth:`set`."""
        self._class = class_name
        self._own = {row.name: row for row in rows}
        given, self._given_own = self._given_own, {}
        for name, (value, prefix) in given.items():
            self._set_own(name, value, prefix)

    def drop_designed(self) -> None:
        """Forget what is designed, so that it is designed again."""
        for row in (self._own or {}).values():
            if row.is_designed:
                self._values.pop((CONTROLLER, row.name), None)

    def drop_own(self, class_name: str) -> None:
        """Forget the controller's own parameters: this class has none."""
        self._given_own.clear()
        self.declare_own(class_name, ())

    @property
    def undeclared(self) -> dict[str, object]:
        """The controller's own parameters as given, if its class is not known."""
        return {name: value for name, (value, _) in self._given_own.items()}

    def is_set(self, node: str, name: str) -> bool:
        """Return whether a parameter was set, rather than left at its default."""
        return (node, name) in self._values

    def update(self, other: ParameterSet) -> None:
        """Apply everything that was set in `other`."""
        self._values.update(other._values)
        self._given_own.update(other._given_own)
        if other._own is not None:
            self.declare_own(other._class, other._own.values())
        elif self._own is not None:
            self.declare_own(self._class, self._own.values())

    def of(self, cls: type[_Node]) -> _Node:
        """Return the parameters of the node whose parameter class is `cls`."""
        given = {name: value for (node, name), value in self._values.items() if node == cls.node}
        if cls.node == CONTROLLER:
            defaults = {row.name: row.default for row in (self._own or {}).values()}
            given = {**defaults, **given}
        return cls().with_values(given)

    def of_node(self, node: str) -> NodeParameters:
        """Return the parameters of a node by its name."""
        return self.of(CLASSES[node])
