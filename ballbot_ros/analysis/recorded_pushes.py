"""The pushes of a recorded run, from its scenario or from outside."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from ballbot_ros.analysis.interval import Interval, IntervalKind
from ballbot_ros.analysis.recorded_attachments import read_attachments
from ballbot_ros.analysis.recorded_runs import END_OF_TIME_NS
from ballbot_ros.messages.conversions import push_forces, stamp_ns
from ballbot_ros.messages.message_types import WrenchStamped
from ballbot_ros.messages.topics import ACCEPTED_PUSH
from ballbot_ros.plant.ground_truth import Pair, Push
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.scenario.scenario import Scenario
from ballbot_ros.timing import SECOND_NS

_DIRECTIONS = (
    'forward', 'forward left', 'left', 'backward left', 'backward', 'backward right', 'right',
    'forward right',
)  # fmt: skip
"""Names of directions, counterclockwise in steps of 45°."""


class PushPairs:
    """Makes pushes of the messages of ``plant/accepted_push``: one for the start, one for the end.

    Attributes
    ----------
    pushes : list of Push
        Those whose start and end have been added.
    """

    def __init__(self) -> None:
        self.pushes: list[Push] = []
        self._begun: dict[str, WrenchStamped] = {}

    def add(self, message: WrenchStamped) -> None:
        """Add a message; those of a push have the same frame_id."""
        start = self._begun.pop(message.header.frame_id, None)
        if start is None:
            self._begun[message.header.frame_id] = message
        else:
            self.pushes.append(Push(stamp_ns(start), stamp_ns(message), *push_forces(start)))


@dataclass(frozen=True)
class RecordedPush:
    """A push that acted on the robot.

    Attributes
    ----------
    start, end : float
        From the start of the run [s].
    force, torque : tuple of float
        On plane x, y, in plane signs [N], [N·m].
    is_external : bool
        Whether it came from outside, not from the scenario.
    """

    start: float
    end: float
    force: Pair
    torque: Pair
    is_external: bool

    def as_json(self) -> dict[str, object]:
        """Return the push with units in the keys."""
        return {
            'start_s': self.start,
            'end_s': self.end,
            'force_n': list(self.force),
            'torque_n_m': list(self.torque),
            'is_external': self.is_external,
        }

    @property
    def interval(self) -> Interval:
        """When it acted."""
        name = 'outside push' if self.is_external else 'push'
        return Interval(self.start, self.end, name, IntervalKind.PUSH, self.strength)

    @property
    def strength(self) -> str:
        """Force and torque as text, such as ``1 N forward``."""
        parts = [_force_text(self.force)] if any(self.force) else []
        if any(self.torque):
            x, y = (f'{each:.3g}'.replace('-', '−') for each in self.torque)
            parts.append(f'torque x {x}, y {y} N·m')
        return ', '.join(parts) or 'no force'


def external_push(content: Mapping[str, Any]) -> RecordedPush:
    """Return an outside push of the JSON of a run."""
    return RecordedPush(
        content['start_s'],
        content['end_s'],
        tuple(content['force_n']),
        tuple(content['torque_n_m']),
        is_external=True,
    )


def scheduled_pushes(scenario: Scenario) -> tuple[RecordedPush, ...]:
    """Return the pushes of a scenario."""
    pushes = scenario.pushes_from(0)
    return recorded_pushes(pushes, pushes, 0)


def _force_text(force: Pair) -> str:
    forward, rightward = force
    eighth = round(math.atan2(-rightward, forward) / math.radians(45.0)) % len(_DIRECTIONS)
    return f'{math.hypot(forward, rightward):.3g} N {_DIRECTIONS[eighth]}'


def recorded_pushes(
    pushes: Iterable[Push], scheduled: Sequence[Push], start_ns: int
) -> tuple[RecordedPush, ...]:
    """Return the pushes of a run that begins at `start_ns` [ns], in the order of their times.

    Those that are not among the `scheduled` ones of its scenario came from outside.
    """
    expected = Counter(map(_identity, scheduled))
    found = []
    for push in pushes:
        is_external = not expected[_identity(push)]
        expected[_identity(push)] -= not is_external
        start, end = ((each - start_ns) / SECOND_NS for each in (push.start_ns, push.end_ns))
        found.append(RecordedPush(start, end, push.force, push.torque, is_external))
    return tuple(sorted(found, key=lambda push: push.start))


def _identity(push: Push) -> tuple[float, ...]:
    return push.start_ns, push.end_ns, *push.force, *push.torque


def outside_pushes_in(reader: RecordingReader, runs_ns: Sequence[int]) -> list[RecordedPush]:
    """Return the pushes from outside in a recording whose runs begin at these stamps [ns]."""
    name, topics = ACCEPTED_PUSH.resolved(), reader.topics()
    if name not in topics or topics[name].type_name != ACCEPTED_PUSH.type_name:
        return []
    pairs = PushPairs()
    for _, _, message in reader.messages([name]):
        pairs.add(message)
    scenario = read_attachments(reader).scenario or Scenario()
    found: list[RecordedPush] = []
    for start_ns, next_ns in pairwise([*sorted(runs_ns), END_OF_TIME_NS]):
        acted = [push for push in pairs.pushes if start_ns <= push.start_ns < next_ns]
        found += recorded_pushes(acted, scenario.pushes_from(start_ns), start_ns)
    return [push for push in found if push.is_external]


def outside_pushes(pushes: Iterable[RecordedPush]) -> str:
    """Return a sentence about the pushes from outside; '' if there are none."""
    external = [push for push in pushes if push.is_external]
    if not external:
        return ''
    if len(external) == 1:
        return f'An outside push was part of the run: {_when(external[0])}.'
    return f'{len(external)} outside pushes were part of the run: {_listed(external)}.'


_MAX_LISTED = 3


def _listed(pushes: Sequence[RecordedPush]) -> str:
    listed = '; '.join(map(_when, pushes[:_MAX_LISTED]))
    return f'{listed}; …' if len(pushes) > _MAX_LISTED else listed


def _when(push: RecordedPush) -> str:
    return f'{push.strength}, {push.start:.3f} s to {push.end:.3f} s'
