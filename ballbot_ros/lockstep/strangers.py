"""Publishers on the lockstep topics that belong to no participant of the run."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ballbot_ros.lockstep.participants import Participant

ANSWER_CALLS = 5
"""Roll calls after which a participant that has answered none of them counts as gone."""

GONE_S = 2.0
"""Time for which a departed publisher can still explain an objection."""

MAX_POLL_GAP_S = 0.5
"""Upper limit of the time counted between two looks at the graph: a publisher that leaves is
noticed only at the next look."""

NAME_S = 5.0
"""Time within which the middleware reports the node name of a publisher, if at all."""

LEASE_S = 21.0
"""Age from which a suspect counts as alive. The middleware's lease keeps a killed process in the
graph for 20 s; a publisher that stays longer was alive while the run waited for it to leave."""


class Publisher(NamedTuple):
    """A publisher in the graph; `node` is '' until its name is known."""

    gid: bytes
    node: str


@dataclass
class _Suspect:
    """A publisher that belongs to no participant."""

    topic: str
    node: str
    since_s: float
    last_seen_s: float
    heard_at_call: int | None = None

    @property
    def problem(self) -> str:
        name = self.node or 'an unnamed node'
        return f'{name} publishes on {self.topic!r}, but takes no part in the run'


class Strangers:
    """Finds the publishers of strangers.

    A publisher whose node has not announced itself is a suspect. It is a stranger as soon as one of
    its samples arrives, or if it outlasts the lease of a dead process. `owners` are the roles that
    publish on each lockstep topic.
    """

    def __init__(self, owners: Mapping[str, Collection[str]]) -> None:
        self._owners = owners
        self._publishers: dict[bytes, str] = {}
        self._first_seen_s: dict[bytes, float] = {}
        self._polled_at_s: float | None = None
        self._now_s = 0.0
        self.begin()

    def begin(self) -> None:
        """Start over with another run."""
        self._suspects: dict[bytes, _Suspect] = {}
        self._present: list[_Suspect] = []
        self._alone_since_s: float | None = None

    def update(
        self,
        publishers: Mapping[str, Sequence[Publisher]],
        participants: Collection[Participant],
        now_s: float,
    ) -> None:
        """Update the publishers on each topic; `now_s` is a time on a monotonic clock [s]."""
        if self._polled_at_s is not None:
            self._now_s += min(now_s - self._polled_at_s, MAX_POLL_GAP_S)
        self._polled_at_s = now_s
        there = set()
        for topic, found in publishers.items():
            gids = {publisher.gid for publisher in found}
            there |= gids
            for publisher in found:
                if publisher.gid in self._publishers:
                    continue
                if owner := self._owner(topic, publisher, gids, participants):
                    self._publishers[publisher.gid] = owner
                    self._suspects.pop(publisher.gid, None)
                    continue
                now = self._now_s
                since_s = self._first_seen_s.setdefault(publisher.gid, now)
                new = _Suspect(topic, '', since_s, now)
                suspect = self._suspects.setdefault(publisher.gid, new)
                suspect.node = publisher.node or suspect.node
                suspect.last_seen_s = now
        self._present = [each for gid, each in self._suspects.items() if gid in there]

    def _owner(
        self,
        topic: str,
        publisher: Publisher,
        gids: Collection[bytes],
        participants: Collection[Participant],
    ) -> str | None:
        """Return the instance that owns a publisher.

        Each instance has one publisher per topic, so a second one belongs to another instance.
        """
        taken = {self._publishers[gid] for gid in gids if gid in self._publishers}
        for participant in participants:
            if participant.guid_prefix:
                is_theirs = publisher.gid.hex().startswith(participant.guid_prefix)
            else:
                is_theirs = publisher.node == participant.node
            is_theirs = is_theirs and participant.role in self._owners[topic]
            if is_theirs and participant.instance not in taken:
                return participant.instance
        return None

    @property
    def topics(self) -> set[str]:
        """Topics with a suspect."""
        return {suspect.topic for suspect in self._present}

    @property
    def waits(self) -> list[str]:
        """What the run waits for because of the suspects."""
        return [
            f'{each.node or "a new node"} on {each.topic!r} to join the run or to leave'
            for each in self._present
        ]

    def note_message(self, topic: str, calls: int) -> None:
        """Note a message of a suspect, after some number of roll calls."""
        for suspect in self._present:
            if suspect.topic == topic and suspect.heard_at_call is None:
                suspect.heard_at_call = calls

    def time(self, calls: int, *, are_alone: bool) -> None:
        """Treat a suspect as a stranger if it outlasts the lease while nothing else is wrong."""
        if not (are_alone and self._present):
            self._alone_since_s = None
            return
        if self._alone_since_s is None:
            self._alone_since_s = self._now_s
        for suspect in self._present:
            if self._now_s - max(suspect.since_s, self._alone_since_s) > LEASE_S:
                self.note_message(suspect.topic, calls)

    def problem(self, calls: int, members: Collection[str]) -> str:
        """Return the problem with a stranger, once it can't be a node that is joining, or ''.

        A stranger has preferably none of the names of the members.
        """
        heard = [
            suspect
            for suspect in self._suspects.values()
            if suspect.heard_at_call is not None
            and calls - suspect.heard_at_call >= ANSWER_CALLS
            and self._can_be_named(suspect)
        ]
        return _likeliest(heard, members).problem if heard else ''

    def explanation(self, topic: str, members: Collection[str]) -> str | None:
        """Return who may have sent a foreign message: '' if it has no name yet, None if nobody."""
        found = [
            each for each in self._suspects.values() if self._now_s - each.last_seen_s <= GONE_S
        ]
        if not found:
            return None
        suspect = _likeliest([each for each in found if each.topic == topic] or found, members)
        return suspect.problem if self._can_be_named(suspect) else ''

    def former_problem(self, members: Collection[str]) -> str:
        """Return the problem with a publisher that was or is a suspect in this run, or ''."""
        found = list(self._suspects.values())
        return _likeliest(found, members).problem if found else ''

    def _can_be_named(self, suspect: _Suspect) -> bool:
        return bool(suspect.node) or self._now_s - suspect.since_s > NAME_S


def _likeliest(suspects: Sequence[_Suspect], members: Collection[str]) -> _Suspect:
    """Return the most likely suspect: preferably one with a name, and not a participant's."""
    return min(suspects, key=lambda suspect: (not suspect.node, suspect.node in members))
