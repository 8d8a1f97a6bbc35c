"""What can vary from run to run of a study, by its name."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, replace

from ballbot_ros.controllers.controller_program import own_rows
from ballbot_ros.engine.rows import ROBOT_CLASSES, robot_parameter
from ballbot_ros.errors import StudyError
from ballbot_ros.lab.studies.distributions import Distribution
from ballbot_ros.lab.studies.events import EventPart, event_parameter, event_part, is_event
from ballbot_ros.parameters import (
    CONTROLLER,
    PLANT,
    SONAR,
    Parameter,
    ParameterSet,
    is_own,
    parameters_of,
    suggest,
)
from ballbot_ros.run.spec import RunSpec

SEED = f'{PLANT}.seed'
DURATION = f'{PLANT}.duration'
CONE_RAYS = f'{SONAR}.cone_rays'

WITHOUT_EFFECT = frozenset(
    {
        'lockstep', 'real_time_factor', 'timeout', 'startup_timeout', 'on_timeout',
        'require_recorder', 'rejoin', 'push_duration', 'lsb', 'log_count', 'sound_freq',
        'sound_dur', 'sound_volume', 'tone_gain',
    }
)  # fmt: skip
"""Parameters on which the motion of a run does not depend: pace, graph, sound and log."""

_ROBOT_NODES = frozenset(cls.node for cls in ROBOT_CLASSES)
_SAME_IN_ALL = frozenset(
    name
    for node in _ROBOT_NODES
    for name, each in parameters_of(node).items()
    if isinstance(each.default, str) and not each.choices
)
"""Texts, which can't vary."""


@dataclass(frozen=True)
class Variable:
    """A number, switch or word that varies from run to run.

    Attributes
    ----------
    name : str
        ``node.param``, ``push.NUMBER.field`` or ``stick.STICK.SEGMENT.field``.
    parameter : Parameter
        Its type, unit and bounds; it has the variable's name.
    part : EventPart or None
        The part of pushes and sticks that it is; None for a node's parameter.
    """

    name: str
    parameter: Parameter
    distribution: Distribution
    part: EventPart | None = None

    @property
    def unit(self) -> str:
        """Its unit; '1' for a pure number, empty for text and switches."""
        return self.parameter.unit


def find_variable(name: str, spec: RunSpec) -> tuple[Parameter, EventPart | None]:
    """Return the parameter of a variable, and the part of pushes and sticks that it is, or None.

    The parameter has the variable's name.

    Raises
    ------
    BallbotError
        If there is no such variable, or it has no effect; the message is one line without a place.
    """
    if is_event(name):
        part = event_part(name, spec.scenario)
        return event_parameter(name, part), part
    node, _, rest = name.partition('.')
    if node == CONTROLLER and is_own(rest):
        return replace(_own_parameter(rest, spec), name=name), None
    parameter = replace(robot_parameter(name), name=name)
    if rest in WITHOUT_EFFECT:
        raise StudyError(f'{name} cannot vary: the motion of a run does not depend on it')
    if isinstance(parameter.default, tuple):
        last = len(parameter.default)
        raise StudyError(f'{name} cannot vary as a whole; its elements can: {name}.1 … {last}')
    return parameter, None


def _own_parameter(name: str, spec: RunSpec) -> Parameter:
    if spec.controller is None:
        raise StudyError(f"{CONTROLLER}.{name}: the document's controller has no such parameter")
    rows = {row.name: row for row in own_rows(spec.controller)}
    row = rows.get(name)
    if row is None:
        raise StudyError(f'{CONTROLLER} has no parameter {name!r}; {suggest(name, rows)}')
    if row.is_designed or isinstance(row.default, tuple):
        raise StudyError(f'{CONTROLLER}.{name} cannot vary: it is a list of numbers')
    if any(each.is_designed for each in rows.values()):
        raise StudyError(
            f'{CONTROLLER}.{name} cannot vary: the gains of this controller are designed once for '
            'all runs of a study'
        )
    return row


def identity(name: str, parameter: Parameter) -> Hashable:
    """Return what two variables have in common if they are the same parameter."""
    return (parameter.nodes, name.partition('.')[2]) if parameter.nodes else name


def fixed_identities(parameters: ParameterSet) -> frozenset[Hashable]:
    """Return the identities of the parameters of robots that are set."""
    fixed: set[Hashable] = set()
    for node, name, value in parameters:
        if node not in _ROBOT_NODES or name in _SAME_IN_ALL:
            continue
        target = f'{node}.{name}'
        names = [target]
        if isinstance(value, tuple):
            names += [f'{target}.{number}' for number in range(1, len(value) + 1)]
        fixed |= {identity(each, robot_parameter(each)) for each in names}
    fixed |= {((CONTROLLER,), name) for name in parameters.undeclared}
    return frozenset(fixed)
