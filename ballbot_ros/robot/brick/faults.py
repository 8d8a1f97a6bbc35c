"""Faults of devices, motors, battery, gamepad link and brick: what there is, as words and values.

A fault acts at the boundary of its component: on a reading, a commanded duty, the battery's
voltage, a packet of the gamepad or the run of the program. What it does is in
:mod:`~ballbot_ros.robot.brick.fault_effects`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from ballbot_ros.errors import did_you_mean
from ballbot_ros.parameters import (
    MAX_DELAY_MS,
    ControllerParameters,
    EncoderParameters,
    GamepadParameters,
    GyroParameters,
    NodeParameters,
    Parameter,
    ParameterError,
    PlantParameters,
    SonarParameters,
)

TASKS, OWN_TASK = ('task_init', 'task_ts1', 'task_ts2', 'task_ts3', 'task_lcd'), 'tick'
"""The tasks of the document's program, by their numbers in the kernel, and that of another one."""

COMPONENTS = (
    'gyro_x', 'gyro_y', 'encoder_x', 'encoder_y', 'sonar', 'motor_x', 'motor_y', 'battery',
    'gamepad', 'brick', *TASKS, OWN_TASK,
)  # fmt: skip

TYPES = (
    'off', 'stuck', 'garbage', 'wrong', 'slow', 'delayed', 'intermittent', 'weak', 'reversed',
    'sag', 'brown-out', 'restart',
)  # fmt: skip


class Effect(NamedTuple):
    """What a type of fault does to a kind of component, and its amount if it has one."""

    meaning: str
    amount: Parameter | None = None


def _amount(default: float, unit: str, low: float, high: float) -> Parameter:
    return Parameter((), 'amount', default, '', unit=unit, bounds=(low, high))


def _of_sensor(nothing: str, wrong: Parameter, slow_ms: int) -> Mapping[str, Effect]:
    return {
        'off': Effect(nothing),
        'stuck': Effect('the last reading before the fault'),
        'garbage': Effect('a random reading within the range of the device'),
        'wrong': Effect('the reading plus the amount', wrong),
        'slow': Effect('a new reading only once in the amount', _amount(slow_ms, 'ms', 4, 60_000)),
        'delayed': Effect('older by the amount', _amount(50, 'ms', 1, MAX_DELAY_MS)),
        'intermittent': Effect('off in half of the slots of 0.1 s, by the seed'),
    }


EFFECTS: Mapping[str, Mapping[str, Effect]] = {
    'gyro': _of_sensor('reads 0', _amount(30.0, 'deg/s', -1023.0, 1023.0), 20),
    'encoder': _of_sensor('reads 0', _amount(30.0, 'deg', -1e6, 1e6), 20),
    'sonar': _of_sensor('no echo (255)', _amount(-20.0, 'cm', -255.0, 255.0), 200),
    'motor': {
        'off': Effect('duty 0'),
        'stuck': Effect('the last duty before the fault'),
        'weak': Effect('that share of the duty, rounded towards 0', _amount(0.5, '1', 0.0, 1.0)),
        'reversed': Effect('the opposite duty'),
    },
    'battery': {
        'sag': Effect('a voltage lower by the amount', _amount(1.0, 'V', 0.0, 12.0)),
        'brown-out': Effect('no voltage, and a brick that is off; then the program starts anew'),
    },
    'gamepad': {
        'off': Effect('the last packet before the fault stays'),
        'delayed': Effect('packets arrive later by the amount', _amount(100, 'ms', 1, 10_000)),
        'intermittent': Effect('no packet in half of the slots of 0.1 s, by the seed'),
    },
    'brick': {'restart': Effect('STOP, and RUN after the duration, by default at once')},
    'task': {'slow': Effect('jobs take longer by the amount', _amount(1000, 'µs', 1, 1_000_000))},
}
"""What each kind of component can have: every pair that is not here is refused."""

WORDS = {
    name: Parameter((), name, known[0], '', choices=known)
    for name, known in (('component', COMPONENTS), ('type', TYPES))
}
TIMES = {
    name: Parameter((), name, 0.0, '', unit='s', bounds=(0.0, 1e6)) for name in ('time', 'duration')
}
FORM = 'COMPONENT TYPE [time=S] [duration=S] [amount=A]'


def kind_of_component(component: str) -> str:
    """Return the kind of a component, a key of :data:`EFFECTS`."""
    is_task = component in (*TASKS, OWN_TASK)
    return 'task' if is_task else component.removesuffix('_x').removesuffix('_y')


KINDS = tuple(f'{each} {word}' for each in COMPONENTS for word in EFFECTS[kind_of_component(each)])
"""Every component with each type that it can have."""


@dataclass(frozen=True)
class Fault:
    """A fault of a component; ParameterError, without a place, if there is no such fault.

    Attributes
    ----------
    component, type : str
        Of `COMPONENTS` and `TYPES`.
    time : float
        Its onset, from the start of the run [s].
    duration : float or None
        None for the rest of the run; a restart then takes no time [s].
    amount : float or None
        In the unit of its :class:`Effect`; None for the default, or if it has no amount.
    """

    component: str
    type: str
    time: float = 0.0
    duration: float | None = None
    amount: float | None = None

    def __post_init__(self) -> None:
        for word, known in ((self.component, COMPONENTS), (self.type, TYPES)):
            if word not in known:
                hint = did_you_mean(str(word), known)
                raise ParameterError(f'{word!r} is not one of {", ".join(known)}{hint}')
        where = f'{self.component} {self.type}: '
        effects = EFFECTS[kind_of_component(self.component)]
        if self.type not in effects:
            others = ', '.join(kind for kind, each in EFFECTS.items() if self.type in each)
            raise ParameterError(
                f'{where}only {others} can have this; {self.component} has {", ".join(effects)}'
            )
        for name in (*TIMES, 'amount'):
            value, row = getattr(self, name), self.rows.get(name)
            if row is None and value is not None:
                raise ParameterError(f'{where}has no amount')
            if row is not None and (value is not None or name == 'time'):
                row.check(value, where)
        if self.duration == 0.0 and self.type != 'restart':
            raise ParameterError(f'{where}must last longer than 0 s')

    @property
    def rows(self) -> dict[str, Parameter]:
        """What each of its fields may be."""
        amount = EFFECTS[kind_of_component(self.component)][self.type].amount
        return {**WORDS, **TIMES, **({'amount': amount} if amount else {})}

    @property
    def end(self) -> float:
        """Time of its end [s], infinite if it lasts for the rest of the run."""
        rest = 0.0 if self.type == 'restart' else math.inf
        return self.time + (rest if self.duration is None else self.duration)

    @property
    def strength(self) -> float:
        """Its amount, given or by default; 0 if it has none."""
        row: Any = self.rows.get('amount')
        return float(row.default if self.amount is None else self.amount) if row else 0.0

    def __str__(self) -> str:
        """Return the entry of a text as :func:`parse_faults` reads it."""
        values = {'time': self.time or None, 'duration': self.duration, 'amount': self.amount}
        given = [f'{name}={float(x)!r}' for name, x in values.items() if x is not None]
        return ' '.join((self.component, self.type, *(each.removesuffix('.0') for each in given)))


def parse_faults(text: str) -> tuple[Fault, ...]:
    """Return the faults of a text, such as ``gyro_x stuck time=3 duration=2; gyro_y off time=8``.

    ParameterError if it is not valid; the message is one line without a place.
    """
    return tuple(map(parse_fault, text.split(';'))) if text.strip() else ()


def parse_fault(entry: str) -> Fault:
    """Return the fault of an entry of such a text; ParameterError as there."""
    try:
        component, kind, *others = entry.split()
        values = {name: float(x) for name, _, x in (each.partition('=') for each in others)}
    except ValueError:
        values = {'': 0.0}
    if not {*values} <= {*TIMES, 'amount'} or len(values) < len(others):
        raise ParameterError(f'{entry.strip()!r} is not {FORM}')
    return Fault(component, kind, **values)


NODES: Mapping[type[NodeParameters], Sequence[str]] = {
    GyroParameters: ('gyro',),
    EncoderParameters: ('encoder',),
    SonarParameters: ('sonar',),
    GamepadParameters: ('gamepad',),
    PlantParameters: ('motor', 'battery', 'brick', 'task'),
    ControllerParameters: ('motor', 'battery', 'brick', 'task'),
}
"""The nodes with a parameter ``faults``, and the kinds of components that each has.

Plant and controller share theirs: a brown-out concerns both.
"""


def node_of(component: str) -> str:
    """Return the node that has a component, the plant's for the brick."""
    kind = kind_of_component(component)
    return next(cls.node for cls, kinds in NODES.items() if kind in kinds)


def fault_texts(faults: Iterable[Fault]) -> dict[str, str]:
    """Return the values of the parameter ``faults`` of all nodes that have components."""
    found: dict[str, list[str]] = {node_of(each): [] for each in COMPONENTS}
    for each in faults:
        found[node_of(each.component)].append(str(each))
    return {node: '; '.join(each) for node, each in found.items()}


def faults_of(parameters: NodeParameters, tasks: Collection[str] = COMPONENTS) -> tuple[Fault, ...]:
    """Return the faults of a node.

    ParameterError, on one line, if its text is not valid, or it can't have one of them. `tasks` are
    those of the controller, if they are known.
    """
    text: Any = parameters.values()['faults']
    try:
        faults = parse_faults(text)
        for each in faults:
            if problem := _problem(each, parameters, tasks):
                raise ParameterError(f'{each.component} {each.type}: {problem}')
    except ParameterError as error:
        raise ParameterError(f'{parameters.node}.faults: {error}') from None
    return faults


def _problem(fault: Fault, parameters: NodeParameters, tasks: Collection[str]) -> str:
    """Return why a node can't have a fault; '' if it can."""
    kind = kind_of_component(fault.component)
    if kind not in NODES[type(parameters)]:
        return f'belongs to {node_of(fault.component)}.faults'
    of_brick: Any = parameters
    if fault.type in ('restart', 'brown-out') and not of_brick.lockstep:
        return 'requires lockstep: true'
    if kind == 'task' and not of_brick.kernel:
        return 'requires kernel: true, since jobs take no time without'
    if kind == 'task' and fault.component not in tasks:
        return f'the controller has no such task; it has {", ".join(tasks)}'
    return ''


def performer_of(component: str) -> str:
    """Return the node that carries out the faults of a component, and takes them during a run."""
    is_task = kind_of_component(component) == 'task'
    return ControllerParameters.node if is_task else node_of(component)


def new_faults(before: str, after: str) -> list[Fault]:
    """Return the faults of a text that another lacks; none if one of them is not valid."""
    with suppress(ParameterError):
        known = parse_faults(before)
        return [each for each in parse_faults(after) if each not in known]
    return []


def performed_faults(texts: Mapping[str, str]) -> str:
    """Return the faults that nodes carry out, by the text of each, as one text."""
    faults = ((node, each) for node, text in texts.items() for each in parse_faults(text))
    return '; '.join(str(each) for node, each in faults if performer_of(each.component) == node)


def faults_from(earliest: float, text: str, parameters: NodeParameters) -> str:
    """Return the faults of a run as text, whose node is given another text from a time on [s].

    Faults without a time begin then. What acts and is not given ends; what has ended, or is another
    node's, stays. A run that has the result from its start is the same. ParameterError if it can't.
    """
    given = list(faults_of(parameters.with_values({'faults': text})))
    kept, changed = [], []
    for each in faults_of(parameters):
        if each in given:
            given.remove(each)
        elif each.end > earliest and performer_of(each.component) == parameters.node:
            changed.append(each)
            if each.time >= earliest:
                continue
            each = replace(each, duration=round(earliest - each.time, 9))
        kept.append(each)
    given = [each if each.time else replace(each, time=earliest) for each in given]
    for each in (*changed, *given):
        where, performer = f'{parameters.node}.faults: {each}: ', performer_of(each.component)
        if performer != parameters.node:
            raise ParameterError(f'{where}belongs to {performer}.faults')
        is_sensor = each.component != 'gamepad'
        if each.type in ('restart', 'brown-out') or (each.type == 'delayed' and is_sensor):
            raise ParameterError(f'{where}must be known at the start: make a branch with it')
        if each in given and each.time < earliest:
            raise ParameterError(f'{where}can begin only from {earliest:.9g} s on')
    return '; '.join(map(str, (*kept, *given)))


def all_faults(of: Callable[[type[Any]], NodeParameters]) -> tuple[Fault, ...]:
    """Return the faults of a run; `of` returns the parameters of a node, by their class."""
    found = {cls: faults_of(of(cls)) for cls in NODES}
    del found[ControllerParameters]  # the plant's are the same
    return tuple(each for faults in found.values() for each in faults)


def late_steps(faults: Iterable[Fault]) -> int:
    """Return by how much faults delay the samples of drivers at most [steps]."""
    late = 0
    for each in faults:
        if each.type == 'delayed' and each.component != 'gamepad':
            late += int(each.strength)
    return late
