"""Changes of the controller's parameters at given times of a run, as its parameter `changes`."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from ballbot_ros.parameters.controller import ControllerParameters, is_own
from ballbot_ros.parameters.parameter import ParameterError, Value
from ballbot_ros.parameters.parameter_set import CONTROLLER, parameters_of, suggest
from ballbot_ros.parameters.timing import SECOND_NS, TICK_S
from ballbot_ros.parameters.yaml_document import parse_value


class TimedChange(NamedTuple):
    """Other values of the controller's parameters, by name, from a time of the run on [s]."""

    time: float
    values: Mapping[str, Value]


def parse_changes(text: str) -> tuple[TimedChange, ...]:
    """Return the changes in a text such as ``3.2 k_thetadot=300; 5 k_i=-0.008``.

    They are in order of time. Values of parameters that only the controller's class has are not
    checked yet. What belongs to another controller is left out, see :func:`parse_succession`.

    It raises ParameterError if the text is malformed, or a parameter can't change during a run.
    """
    found, after = _entries(text), parse_succession(text)
    times = (time for time in sorted(found) if not after or time != after.time)
    return tuple(TimedChange(time, found[time]) for time in times)


def parse_succession(text: str) -> TimedChange | None:
    """Return when another controller takes over, as in ``3.2 implementation=lqg``, if one does.

    The values are its `implementation`, and those of the parameters that only its class has.
    """
    times = [time for time, values in _entries(text).items() if IMPLEMENTATION in values]
    if not times:
        return None
    values = _entries(text)[times[0]]
    if len(times) > 1 or not all(name == IMPLEMENTATION or is_own(name) for name in values):
        raise ParameterError(
            f'{CONTROLLER}.changes: {text!r}: only one other {IMPLEMENTATION} can take over, and '
            'nothing else can change at that time'
        )
    return TimedChange(times[0], values)


IMPLEMENTATION = 'implementation'


def _entries(text: str) -> dict[float, dict[str, Value]]:
    """Return values by name, by the time at which they change [s]."""
    found: dict[float, dict[str, Value]] = {}
    for entry in filter(None, map(str.strip, text.split(';'))):
        time, _, assignment = entry.partition(' ')
        name, equals, value = assignment.strip().partition('=')
        try:
            at = float(time)
        except ValueError:
            at = math.nan
        if not (equals and 0.0 <= at < math.inf):
            raise ParameterError(
                f'{CONTROLLER}.changes: {entry!r} is not of the form TIME NAME=VALUE, such as '
                '3.2 k_thetadot=300'
            )
        where = f'{CONTROLLER}.changes: '
        found.setdefault(at, {})[name] = checked_change(name, parse_value(value), where)
    return found


def scheduled_at(text: object, time: float) -> list[tuple[str, Value]]:
    """Return names and values that change at a tick [s] by such a text; nothing if it is none."""
    try:
        entries = _entries(str(text))
    except ParameterError:  # as a controller of another package may announce
        return []
    due = [values for at, values in entries.items() if -TICK_S < at - time - _ROUNDING <= 0.0]
    return [item for values in due for item in values.items()]


_ROUNDING = 1e-6


def checked_change(name: str, value: object, where: str) -> Value:
    """Return the value of a parameter that may change during a run, in its type.

    It raises ParameterError, whose message begins with `where`, if it may not.
    """
    if name == IMPLEMENTATION and isinstance(value, str):
        return value
    if is_own(name):
        return tuple(value) if isinstance(value, list) else value  # type: ignore[return-value]
    rows = {row.name: row for row in parameters_of(CONTROLLER).values() if row.is_live}
    if name not in rows:
        raise ParameterError(
            f'{where}{CONTROLLER} has no parameter {name!r} that can change during a run; '
            f'{suggest(name, rows)}'
        )
    return rows[name].check(value, f'{where}{CONTROLLER}.')


def changes_text(changes: Iterable[TimedChange]) -> str:
    """Return changes as the text that :func:`parse_changes` reads, with all digits."""
    return '; '.join(
        f'{change.time!r} {name}={list(value) if isinstance(value, tuple) else value!r}'
        for change in changes
        for name, value in change.values.items()
    )


class PendingChanges:
    """Changes that are still to come: sim time [ns] and values by name, in order of time."""

    def __init__(self, changes: Iterable[tuple[int, Mapping[str, Value]]]) -> None:
        self._pending = deque(changes)

    @classmethod
    def of(cls, parameters: ControllerParameters, start_ns: int) -> PendingChanges:
        """Return those of a run that begins at sim time `start_ns`."""
        changes = parse_changes(parameters.changes)
        return cls((start_ns + round(each.time * SECOND_NS), each.values) for each in changes)

    def add(self, now_ns: int, values: Mapping[str, Value]) -> None:
        """Add a change that is due at once, at the tick at `now_ns` [ns]."""
        self._pending.appendleft((now_ns, values))

    @property
    def next_ns(self) -> int | None:
        """When the next one is due [ns]; None if there is none."""
        return self._pending[0][0] if self._pending else None

    def due(self, now_ns: int) -> dict[str, Value]:
        """Take the values that apply from the tick at `now_ns` on, by name."""
        values: dict[str, Value] = {}
        while self._pending and self._pending[0][0] <= now_ns:
            values |= self._pending.popleft()[1]
        return values
