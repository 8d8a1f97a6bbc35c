"""A parameter: its default, unit, bounds and meaning, declared as a field of a dataclass.

Plant and recording values are SI; the parameters of the brick and its devices are in the brick's
own units, as the `unit` of each says. Sections and equations are those of Yamamoto, *NXT Ballbot
Model-Based Design* (2009).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import Field, dataclass, field, fields, replace
from enum import Enum
from typing import Any, ClassVar, Literal, TypeVar, cast, get_args, get_origin, get_type_hints

from ballbot_ros.errors import BallbotError, short_repr


class TextEnum(str, Enum):
    """Members are strings and print as their values, in messages, files and JSON."""

    __str__ = str.__str__


Value = bool | int | float | str | tuple[float, ...]
_Value = TypeVar('_Value', bound=Value)
_Node = TypeVar('_Node', bound='NodeParameters')
_Bounds = tuple[float, float]


def value_text(value: Value) -> str:
    """Return the value of a parameter as text."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return ', '.join(map(value_text, value))
    return f'{value:.9g}' if isinstance(value, float) else str(value)


MAX_DELAY_MS = 100
"""Longest dead time, and largest jitter [ms]."""

MAX_DESIGNED = 10_000
"""Largest number of designed values in one parameter."""


NOT_DESIGNED = (
    'not designed: the commands run and drive and the launch file design it; for a node alone, '
    'the command design --controller prints a parameter file'
)


class ParameterError(BallbotError):
    """An unknown parameter, or a value of the wrong type or out of bounds."""


class TakesEffect(Enum):
    """When a new value takes effect in a running node."""

    IMMEDIATELY = 'at once'
    NEXT_RUN = 'next run'
    THIS_RUN = 'at once, and only in the present run'
    READ_ONLY = 'never'


@dataclass(frozen=True)
class Parameter:
    """One parameter, of one node or of several that share its value.

    Attributes
    ----------
    nodes : tuple of str
        The nodes that declare it; usually one.
    default : bool, int, float, str or tuple of float
        Default of the ``ideal`` profile; its type is the parameter's type.
    unit : str
        ``'1'`` for a pure number, empty for text and switches.
    bounds : tuple of float or None
        Inclusive lower and upper bound of a number, or of each element of an array.
    or_zero : bool
        Whether 0 is allowed outside the bounds, with a special meaning.
    is_path : bool
        Whether the value is, or may be, the path of a file or folder.
    choices : tuple
        Allowed words for a text, or values for an integer; empty for any.
    takes_effect : TakesEffect
        When a new value takes effect in a running node; never for a read-only parameter.
    is_designed : bool
        Whether it is an array of any length that is designed when a run is composed, unless it is
        set. Its default is empty, and not allowed in a run.
    """

    nodes: tuple[str, ...]
    name: str
    default: Value
    description: str
    source: str = ''
    unit: str = ''
    bounds: tuple[float, float] | None = None
    or_zero: bool = False
    is_path: bool = False
    choices: tuple[str | int, ...] = ()
    takes_effect: TakesEffect = TakesEffect.NEXT_RUN
    is_designed: bool = False

    @property
    def is_live(self) -> bool:
        """Whether a new value takes effect in a running node immediately."""
        return self.takes_effect is TakesEffect.IMMEDIATELY

    @property
    def hint(self) -> str:
        """Its description, with the unit if it has one."""
        return f'{self.description} [{self.unit}]' if self.unit else self.description

    def check(self, value: object, where: str) -> Value:
        """Return `value` in the parameter's own type; raise ParameterError if it is not allowed."""
        name = f'{where}{self.name}'
        if isinstance(self.default, tuple):
            lengths = (len(self.default),) if self.default else range(1, MAX_DESIGNED + 1)
            if not isinstance(value, list | tuple) or len(value) not in lengths:
                count = len(self.default) or f'1 … {MAX_DESIGNED}'
                raise ParameterError(
                    f'{name}: {short_repr(value)} is not a list of {count} numbers'
                )
            return tuple(self._number(item, name) for item in value)
        if isinstance(self.default, bool):
            if not isinstance(value, bool):
                raise ParameterError(f'{name}: {short_repr(value)} is not true or false')
            return value
        if isinstance(self.default, str):
            if not isinstance(value, str):
                raise ParameterError(f'{name}: {short_repr(value)} is not text')
            if not _is_utf8(value):
                raise ParameterError(f'{name}: {short_repr(value)} is not UTF-8')
            return str.__str__(self._choice(value, name))  # exactly a str, also of an Enum
        if isinstance(self.default, int):
            if isinstance(value, float) and value.is_integer():
                value = int(value)
            if isinstance(value, bool) or not isinstance(value, int):
                raise ParameterError(f'{name}: {short_repr(value)} is not a whole number')
            return int(self._choice(value, name) if self.choices else self._number(value, name))
        return float(self._number(value, name))

    def _choice(self, value: object, name: str) -> Any:
        if self.choices and value not in self.choices:
            raise ParameterError(
                f'{name}: {short_repr(value)} is not one of {self.choices_text}{self._spaced_unit}'
            )
        return value

    @property
    def choices_text(self) -> str:
        """The choices as text."""
        return ', '.join(map(str, self.choices))

    @property
    def bounds_text(self) -> str:
        """The bounds as text, without the unit."""
        if not self.bounds:
            return ''
        low, high = self.bounds
        return f'{"0 or " if self.or_zero else ""}{low:g} … {high:g}'

    @property
    def _spaced_unit(self) -> str:
        return '' if self.unit in ('', '1') else f' {self.unit}'

    def _number(self, value: object, name: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ParameterError(f'{name}: {short_repr(value)} is not a number')
        low, high = self.bounds or (-math.inf, math.inf)
        if not self.bounds and not math.isfinite(value):
            raise ParameterError(f'{name}: {value!r} is not finite')
        if not (low <= value <= high or (self.or_zero and value == 0)):
            raise ParameterError(
                f'{name}: {short_repr(value)} is not within {self.bounds_text}{self._spaced_unit}'
            )
        return value if isinstance(self.default, int) else float(value)


def _is_utf8(text: str) -> bool:
    """Return whether ROS can carry a text: valid UTF-8 without NUL."""
    return not any(each == '\0' or '\ud800' <= each <= '\udfff' for each in text)


@dataclass(frozen=True, kw_only=True)
class NodeParameters:
    """The parameters of a node. Each node has a subclass, with a field for each parameter."""

    node: ClassVar[str]
    """Name of the node."""

    def values(self) -> dict[str, Value]:
        """Return the value of each parameter, by name."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    def with_values(self: _Node, values: Mapping[str, Value]) -> _Node:
        """Return these parameters with other values for some, by name."""
        return replace(self, **values)


@dataclass(frozen=True, kw_only=True)
class DriverParameters(NodeParameters):
    """The parameters of a driver: a node that answers the plant's true state in every run."""

    period_ns: ClassVar[int]
    """Sampling period: the driver answers at each multiple of it in sim time [ns]."""


_Subset = TypeVar('_Subset', bound='Subset')


class Subset:
    """A dataclass with a subset of a node's parameters."""

    @classmethod
    def from_parameters(cls: type[_Subset], parameters: NodeParameters) -> _Subset:
        """Return the subset: for each field, the node's parameter of that name."""
        return cls(**{each.name: getattr(parameters, each.name) for each in fields(cls)})  # type: ignore[arg-type]


def quantity(
    default: _Value,
    unit: str,
    bounds: _Bounds | None,
    description: str,
    source: str = 'project',
    *,
    or_zero: bool = False,
    takes_effect: TakesEffect = TakesEffect.NEXT_RUN,
) -> _Value:
    """Declare a number, or several of a kind; for the arguments see :class:`Parameter`."""
    return _declared(
        default, description, source, takes_effect, unit=unit, bounds=bounds, or_zero=or_zero
    )


def live(
    default: _Value, unit: str, bounds: _Bounds, description: str, source: str = 'project'
) -> _Value:
    """Declare a number whose new value takes effect in a running node at once."""
    at_once = TakesEffect.IMMEDIATELY
    return _declared(default, description, source, at_once, unit=unit, bounds=bounds)


def dead_time(description: str) -> int:
    """Declare a dead time in whole physics steps, or its jitter."""
    return quantity(0, 'ms', (0, MAX_DELAY_MS), description)


def fault_list(components: str) -> str:
    """Declare the faults of some components."""
    text = f'faults of {components}, see docs/scenarios.md; empty: none'
    return setting('', text, takes_effect=TakesEffect.THIS_RUN)


def setting(
    default: _Value,
    description: str,
    source: str = 'project',
    *,
    takes_effect: TakesEffect = TakesEffect.NEXT_RUN,
) -> _Value:
    """Declare a switch or a text; a field of a Literal type is a choice among its values."""
    return _declared(default, description, source, takes_effect)


def designed(
    unit: str,
    bounds: _Bounds | None,
    description: str,
    *,
    takes_effect: TakesEffect = TakesEffect.NEXT_RUN,
) -> tuple[float, ...]:
    """Declare numbers that are designed once, when a run is composed, unless they are set."""
    return _declared((), description, '', takes_effect, unit=unit, bounds=bounds, is_designed=True)


def path(
    description: str, source: str = 'project', *, takes_effect: TakesEffect = TakesEffect.NEXT_RUN
) -> str:
    """Declare the path of a file or folder, or the name of a shipped one; empty by default."""
    return _declared('', description, source, takes_effect, is_path=True)


def _declared(
    default: _Value, description: str, source: str, takes_effect: TakesEffect, **others: object
) -> _Value:
    given = {'description': description, 'source': source, 'takes_effect': takes_effect}
    return field(default=default, metadata={**given, **others})


def table(classes: tuple[type[NodeParameters], ...]) -> tuple[Parameter, ...]:
    """Return the parameters of all nodes, with one row for a shared parameter."""
    rows = {}
    for cls in classes:
        for each in declared_in(cls):
            declaration = _fields(cls)[each.name]
            nodes = tuple(c.node for c in classes if _fields(c).get(each.name) is declaration)
            rows[nodes, each.name] = replace(each, nodes=nodes)
    return tuple(rows.values())


def declared_in(cls: type, node: str = '', prefix: str = '') -> Iterator[Parameter]:
    """Yield the parameters that the fields of a dataclass declare, for a node.

    A prefix is put before the name of each field.
    """
    types = get_type_hints(cls)
    for each in _fields(cls).values():
        kind = types[each.name]
        default = cast(Value, each.default)
        if kind is float and isinstance(default, int):
            default = float(default)
        choices = get_args(kind) if get_origin(kind) is Literal else ()
        yield Parameter((node,), prefix + each.name, default, choices=choices, **each.metadata)


def _fields(cls: Any) -> dict[str, Field[object]]:
    """Return the fields of a dataclass that declare parameters, by name."""
    return {each.name: each for each in fields(cls) if each.metadata}
