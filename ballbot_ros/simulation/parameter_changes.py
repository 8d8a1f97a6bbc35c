"""Parameters that somebody set during a run, so that it is not the run that was specified."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from ballbot_ros.errors import printable
from ballbot_ros.parameters import Value, value_text
from ballbot_ros.timing import SECOND_NS, TICK_NS

_MAX_LISTED = 3


class ParameterChange(NamedTuple):
    """Another value of a node's parameter, from a time on that counts from the run's start [s]."""

    time: float
    node: str
    name: str
    value: Value

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> ParameterChange:
        """Return a change from the JSON of a run."""
        value = content['value']
        value = tuple(value) if isinstance(value, list) else value
        return cls(content['time_s'], content['node'], content['parameter'], value)

    def as_json(self) -> dict[str, object]:
        """Return the change as JSON; a value that JSON does not have, such as NaN, is a text."""
        is_json = isinstance(self.value, str) or bool(np.isfinite(self.value).all())
        return {
            'time_s': self.time,
            'tick': self.tick,
            'node': self.node,
            'parameter': self.name,
            'value': self.value if is_json else value_text(self.value),
        }

    @property
    def tick(self) -> int:
        """The first tick with the new value, from 0."""
        return round(self.time * SECOND_NS / TICK_NS)

    def __str__(self) -> str:
        value = printable(value_text(self.value))
        name = printable(f'{self.node}.{self.name}')
        return f'{name} was set to {value} at {self.time:.3f} s (tick {self.tick})'


def changes_text(changes: Iterable[ParameterChange]) -> str:
    """Return the first changes of a run on one line; '' if there are none."""
    listed = [str(each) for each in islice(changes, _MAX_LISTED + 1)]
    return '; '.join([*listed[:_MAX_LISTED], *('…' for _ in listed[_MAX_LISTED:])])
