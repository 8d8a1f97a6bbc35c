"""Decides who takes part in a run.

A roll call of the plant asks every participant to announce itself. Free of ROS: the plant's node
passes in announcements, roll calls and the publishers in the graph, and acts on the
:class:`Readiness` that results.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from operator import attrgetter

from ballbot_ros.errors import one_line
from ballbot_ros.lockstep.participants import (
    ANSWER_CALLS,
    MAP_HASH,
    Announcement,
    LocalNode,
    Membership,
    Objection,
    Participant,
    Publisher,
    Strangers,
)
from ballbot_ros.parameters import CONTROLLER, DRIVERS, NODES, SHARED_PARAMETERS
from ballbot_ros.parameters.timing import SECOND_NS

_SHARED = {**SHARED_PARAMETERS, MAP_HASH: NODES}
"""Parameters that must have the same value in all participants with these roles."""


class ReadinessState(Enum):
    """Whether the run may continue."""

    COMPLETE = auto()
    WAITING = auto()
    REFUSED = auto()


@dataclass(frozen=True)
class Readiness:
    """Whether a run may continue, and if not, the reason."""

    state: ReadinessState
    reason: str = ''


@dataclass
class _Heard:
    """An announcement, and the number of roll calls made before it."""

    announcement: Announcement
    calls: int


@dataclass
class _Run:
    """The participants of a run."""

    name: str
    heard: dict[str, _Heard] = field(default_factory=dict)
    contests: dict[str, int] = field(default_factory=dict)
    members: dict[str, Participant] = field(default_factory=dict)
    history: list[Membership] = field(default_factory=list)
    objections: list[tuple[int, Objection]] = field(default_factory=list)
    problem: str = ''
    has_begun: bool = False


class Roster:
    """Decides whether all participants of a run, and no others, are present.

    Each role has one participant. If a second one announces itself, roll calls show which of the
    two are alive. If both are, the run is refused; if only the second is, it is the successor.
    That of a driver must be its equal; one in any other role starts from its initial state.

    :class:`Strangers` finds the publishers of nodes that take no part. `owners` are the roles that
    publish on each lockstep topic.
    """

    def __init__(self, owners: Mapping[str, Collection[str]]) -> None:
        self._plant: Participant | None = None
        self._required: tuple[str, ...] = ()
        self._owners = owners
        self._strangers = Strangers(owners)
        self._present: Mapping[str, LocalNode] = {}
        self._started: Collection[LocalNode] = ()
        self._calls = 0
        self._run = _Run('')

    def gather(self, run: str, plant: Participant, required: Collection[str]) -> None:
        """Start collecting the participants of a run, which begins with the `required` roles.

        The run fails if a participant in one of these roles, or the controller, can't continue.
        """
        self._plant, self._required = plant, tuple(required)
        self._run = _Run(run)
        self._strangers.begin()
        self._run.heard[plant.instance] = _Heard(Announcement(plant, run), self._calls)

    def confirm(self) -> None:
        """Begin the run with the participants that have joined; from now on all must stay."""
        self._run.has_begun = True

    def note_roll_call(self) -> None:
        """Count a roll call, which the plant itself answers, too."""
        self._calls += 1
        if self._plant:
            self._run.heard[self._plant.instance].calls = self._calls

    def on_announcement(self, announcement: Announcement) -> None:
        """Process an announcement; one for another run changes nothing."""
        run = self._run
        participant = announcement.participant
        if announcement.run != run.name or participant == self._plant:
            return
        if not any(participant.role in roles for roles in self._owners.values()):
            return
        known = run.heard.get(participant.instance)
        if known and known.announcement.participant != participant:
            run.problem = f'{participant} claims to be {known.announcement.participant}'
            return
        if run.members.get(participant.role) == participant:
            run.members[participant.role] = participant
        run.heard[participant.instance] = _Heard(announcement, self._calls)
        objection = announcement.objection
        if objection and objection.topic:
            self.add_objection(objection)
        # Ignore it if a participant that the run can do without can't continue.
        elif objection and participant.role in (*self._required, CONTROLLER):
            self.add_objection(Objection(objection.told_by(participant)))
        # A new claimant starts the contest again: one that answered before may have died since.
        if known is None and len(self._claimants(participant.role)) > 1:
            run.contests[participant.role] = self._calls

    def add_objection(self, objection: Objection) -> None:
        """Record an objection of a participant or of the plant itself."""
        if all(objection != known for _, known in self._run.objections):
            self._run.objections.append((self._calls, objection))

    def update_publishers(
        self, publishers: Mapping[str, Sequence[Publisher]], now_s: float
    ) -> None:
        """Update the publishers on the lockstep topics."""
        participants = [heard.announcement.participant for heard in self._run.heard.values()]
        self._strangers.update(publishers, participants, now_s)

    def update_local_nodes(
        self, present: Mapping[str, LocalNode], started: Collection[LocalNode]
    ) -> None:
        """Update the nodes on the plant's machine that must join the run or end before it begins.

        These are the participants `present` of any run, by instance, and those `started` together
        with the plant, which may not be present yet.
        """
        self._present, self._started = present, started

    def awaited_nodes(self) -> list[LocalNode]:
        """Return the nodes on the plant's machine that must still join the run or end."""
        heard = self._run.heard
        joined = {
            (each.announcement.participant.role, each.announcement.participant.process)
            for each in heard.values()
            if self._plant and each.announcement.participant.host == self._plant.host
        }
        awaited = {node for instance, node in self._present.items() if instance not in heard}
        return sorted(awaited.union(node for node in self._started if node not in joined))

    @property
    def suspected_topics(self) -> set[str]:
        """Topics with a publisher that belongs to no participant."""
        return self._strangers.topics

    def note_foreign_message(self, topic: str) -> None:
        """Note a message on a suspected topic that no participant can have sent."""
        self._strangers.note_message(topic, self._calls)

    def has_answered(self, role: str, stamp_ns: int) -> bool:
        """Return whether a participant has announced that it has sent a sample."""
        heard = self._heard_of(role)
        return heard is not None and heard.announcement.answered_ns >= stamp_ns

    def _heard_of(self, role: str) -> _Heard | None:
        """Return the newest announcement of the participant of a role."""
        member = self._run.members.get(role)
        return self._run.heard.get(member.instance) if member else None

    def readiness(self, now_ns: int) -> Readiness:
        """Return whether the run may continue; a successor takes part from `now_ns` on."""
        run = self._run
        problem = (
            run.problem
            or self._strangers.problem(self._calls, self._member_names())
            or self._resolve_contests()
            or self._admit(now_ns)
        )
        if not (problem or run.contests):
            problem = self._judge_objections() or self._disagreement()
        if problem:
            return Readiness(ReadinessState.REFUSED, problem)
        waits = [*self.absent(), *(f'a single {role}' for role in run.contests)]
        waits += [f'a roll call because {objection.text}' for _, objection in run.objections]
        self._strangers.time(self._calls, are_alone=not waits)
        waits += self._strangers.waits
        if waits:
            return Readiness(ReadinessState.WAITING, f'waiting for {", ".join(waits)}')
        return Readiness(ReadinessState.COMPLETE)

    def _member_names(self) -> set[str]:
        return {participant.node for participant in self._run.members.values()}

    def _claimants(self, role: str) -> list[_Heard]:
        heard = self._run.heard.values()
        return [each for each in heard if each.announcement.participant.role == role]

    def _resolve_contests(self) -> str:
        """Find out which claimants of a role are alive; return the problem, or ''."""
        run = self._run
        doubled: dict[str, list[Participant]] = {}
        for role, since in tuple(run.contests.items()):
            claimants = self._claimants(role)
            living = [each.announcement.participant for each in claimants if each.calls > since]
            if len(living) > 1:
                doubled[role] = living
            elif self._calls - since >= ANSWER_CALLS:
                # If none is alive, the role keeps its last participant, and the silence that
                # follows is attributed to it.
                for each in claimants:
                    if each.announcement.participant not in living:
                        del run.heard[each.announcement.participant.instance]
                del run.contests[role]
        if not doubled:
            return ''
        role, *others = doubled
        topic = next(topic for topic, roles in self._owners.items() if role in roles)
        both = ' and '.join(map(str, doubled[role][:2]))
        likewise = f'; likewise as {", ".join(others)}' if others else ''
        return f'two nodes publish on {topic!r} as {role}: {both}{likewise}'

    def _admit(self, now_ns: int) -> str:
        """Assign a participant to each role; return the problem with a successor, or ''."""
        run = self._run
        for instance, heard in run.heard.items():
            participant = heard.announcement.participant
            role, known = participant.role, run.members.get(participant.role)
            if role in run.contests or (known and known.instance == instance):
                continue
            if not run.has_begun:
                run.history = [each for each in run.history if each.participant != known]
            elif known and role in DRIVERS and not _are_equal(known, participant):
                return f'{participant} replaces {known} with another program or other parameters'
            is_successor = known is not None and run.has_begun
            run.members[role] = participant
            run.history.append(Membership(participant, now_ns, is_successor))
        return ''

    @property
    def fatal_objection(self) -> str:
        """Why a participant can't continue; '' if all can."""
        texts = (each.text for _, each in self._run.objections if not each.topic)
        return next(texts, '')

    def _judge_objections(self) -> str:
        """Return the oldest objection as a problem, once roll calls have shown who is alive."""
        run = self._run
        run.objections = [each for each in run.objections if not self._is_of_a_handover(each[1])]
        for calls, objection in run.objections:
            if not objection.topic:
                return objection.text
            if self._calls - calls < ANSWER_CALLS:
                continue
            stranger = self._strangers.explanation(objection.topic, self._member_names())
            if stranger is None:
                return self._unexplained(objection)
            if stranger:
                return stranger
        return ''

    def _disagreement(self) -> str:
        """Return the parameter on which two participants disagree, or ''."""
        for name, roles in _SHARED.items():
            if name == 'faults' and self._run.has_begun:
                continue  # each has been given its own
            members = self._run.members.values()
            tellers = [each for each in members if each.role in roles and name in each.parameters]
            tellers.sort(key=lambda each: each.node)
            for other in tellers[1:]:
                values = tellers[0].parameters[name], other.parameters[name]
                if values[0] != values[1]:
                    return (
                        f'{name} is {values[0]!r} in {tellers[0].node}, '
                        f'but {values[1]!r} in {other.node}'
                    )
        return ''

    def _unexplained(self, objection: Objection) -> str:
        """Return the text of an objection that no publisher in the graph explains."""
        roles = self._owners.get(objection.topic, ())
        senders = [str(self._run.members[role]) for role in roles if role in self._run.members]
        sent_by = f', sent by {senders[0]} or by a node that has left' if senders else ''
        return objection.text + sent_by

    def _is_of_a_handover(self, objection: Objection) -> bool:
        """Return whether both participants of a handover may have answered the same tick.

        Their answers may differ, since a gamepad's answer depends on when it is asked. The first
        one counts, so the objection is dropped.
        """
        roles = self._owners.get(objection.topic, ())
        return any(
            each.is_successor
            and each.participant.role in roles
            and objection.stamp_ns <= each.since_ns
            for each in self._run.history
        )

    def reported_failure(self, role: str) -> str:
        """Return why the participant of a role can't continue, or ''."""
        heard = self._heard_of(role)
        objection = heard.announcement.objection if heard else None
        return one_line(objection.text) if objection and not objection.topic else ''

    def stranger(self) -> str:
        """Return who may have sent samples in the place of participants, also if it left, or ''."""
        return self._strangers.former_problem(self._member_names())

    def missing(self) -> list[str]:
        """Return the required roles that have no participant in this run."""
        return [role for role in self._required if role not in self._run.members]

    def absent(self) -> list[str]:
        """Return the missing roles, and the nodes that must still join in other roles or end."""
        missing = self.missing()
        return missing + [str(node) for node in self.awaited_nodes() if node.role not in missing]

    def silences_s(
        self,
        since_call: int,
        due_ns: Mapping[str, int],
        silence_s: Callable[[Participant | None], float],
        *,
        heeds_awaited: bool = True,
    ) -> dict[str, float]:
        """Return the roles of silent participants, and the length of each silence [s].

        Parameters
        ----------
        since_call : int
            Number of the last roll call before the silence.
        due_ns : mapping of str to int
            The stamp that is due from each role whose answer is awaited [ns]; a role comes before
            the roles that depend on it.
        silence_s : callable
            Returns how much of the silence counts for a participant.
        heeds_awaited : bool
            Whether the samples that the controller awaits are those that the plant waits for.

        Returns
        -------
        dict of str to float
            The participants that have answered no roll call since then, each with its own
            silence. If all have answered, the participants whose newest sample is older than due,
            and those whose sample the controller awaits; some of these may be waiting for others.
        """
        found = {role: self._heard_of(role) for role in due_ns}
        silences_s = {role: silence_s(self._run.members.get(role)) for role in found}
        unheard = [role for role, heard in found.items() if not heard or heard.calls <= since_call]
        if unheard:
            return {role: silences_s[role] for role in unheard}
        awaited = [role for role in found if heeds_awaited and self._awaited_of(role)]
        lacking = [
            role for role in found if not self.has_answered(role, due_ns[role]) or role in awaited
        ]
        # What a starved controller awaits may be waiting in its own queue.
        heard_by = [CONTROLLER] if awaited and CONTROLLER in found else []
        lengths_s = [silences_s[role] for role in (*lacking, *heard_by)]
        return dict.fromkeys(lacking, min(lengths_s)) if lacking else {}

    def _awaited_of(self, role: str) -> dict[str, int | None]:
        """Return what the controller awaits of a role, as in :class:`Announcement`.

        What it announced before it became silent itself does not count.
        """
        heard = self._heard_of(CONTROLLER)
        if heard is None or self._calls - heard.calls >= ANSWER_CALLS:
            return {}
        return {
            topic: stamp_ns
            for topic, stamp_ns in heard.announcement.awaits.items()
            if role in self._owners.get(topic, ())
        }

    def wrong_stamp(self, role: str) -> str:
        """Return with which other stamp a role has sent a sample that is awaited, or ''."""
        texts = (wrong_stamp_text(*each) for each in self._awaited_of(role).items())
        return next(filter(None, texts), '')

    @property
    def calls(self) -> int:
        """Number of roll calls so far."""
        return self._calls

    @property
    def members(self) -> Mapping[str, Participant]:
        """The participant of each role."""
        return self._run.members

    @property
    def history(self) -> tuple[Membership, ...]:
        """All participants of this run, in the order of joining."""
        return tuple(self._run.history)

    @property
    def periodic_topics(self) -> tuple[str, ...]:
        """Topics with a message at each multiple of their period in this run."""
        return tuple(
            topic for participant in self._run.members.values() for topic in participant.topics
        )


def wrong_stamp_text(topic: str, stamp_ns: int | None) -> str:
    """Return the text for a sample with another stamp than the awaited one; '' for None."""
    if stamp_ns is None:
        return ''
    return f'its newest {topic!r} is stamped {stamp_ns / SECOND_NS:.3f} s'


def _are_equal(one: Participant, other: Participant) -> bool:
    identify = attrgetter('implementation', 'parameters_sha256')
    is_same = one.parameters.get('faults') == other.parameters.get('faults')
    return bool(is_same and identify(one) == identify(other))
