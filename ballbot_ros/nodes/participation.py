"""A node's part in the runs of the plant: joining them, announcing itself, and objecting."""

from __future__ import annotations

import hashlib
import json
import os
import socket
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from uuid import uuid4

from ballbot_ros import __version__
from ballbot_ros.controllers.loading import public_reference
from ballbot_ros.lockstep.lockstep import RunIdentity
from ballbot_ros.lockstep.participants import MAP_HASH, Objection, Participant, RunMember
from ballbot_ros.nodes.base import AnyNode
from ballbot_ros.nodes.graph_observer import guid_prefix
from ballbot_ros.nodes.presence import Presence
from ballbot_ros.parameters import PATHS, NodeParameters, Value
from ballbot_ros.recording.messages.conversions import time_ns
from ballbot_ros.recording.messages.message_types import Header
from ballbot_ros.recording.messages.participation import encode_announcement
from ballbot_ros.recording.messages.topics import PARTICIPANTS, ROLL_CALL, periodic_topics
from ballbot_ros.robot.world.floor_map import read_map_file


def participant_of(node: AnyNode) -> Participant:
    """Return a node of this package as a participant, without its parameters."""
    instance = uuid4().hex
    return Participant(
        role=node.role,
        node=node.get_fully_qualified_name(),
        host=socket.gethostname(),
        process=os.getpid(),
        instance=instance,
        implementation=f'ballbot_ros {__version__} {node.program}',
        parameters_sha256='',
        guid_prefix=guid_prefix(node, instance),
        topics=tuple(topic.name for topic in periodic_topics(node.role)),
    )


def with_parameters(
    participant: Participant,
    parameters: NodeParameters,
    further: Mapping[str, object] | None = None,
) -> Participant:
    """Return a participant with the parameters of a run, and further values to announce.

    Paths on this machine stay private: only file names are announced.
    """
    values = parameters.values()
    text = json.dumps(values, sort_keys=True, default=list)
    announced = {name: _public(name, value) for name, value in values.items()}
    if image := str(values.get('map', '')):
        announced[MAP_HASH] = hashlib.sha256(read_map_file(image)).hexdigest()
    return replace(
        participant,
        parameters_sha256=hashlib.sha256(text.encode()).hexdigest(),
        parameters={**announced, **(further or {})},
    )


def _public(name: str, value: Value) -> Value:
    if name == 'implementation':
        return public_reference(str(value))
    return Path(str(value)).name if name in PATHS else value


class Participation:
    """Joins every run that a plant announces, and answers its roll calls.

    Parameters
    ----------
    on_run : callable, optional
        Called with each new run before the node joins it.
    on_call : callable, optional
        Called after each answered roll call.
    """

    def __init__(
        self,
        node: AnyNode,
        on_run: Callable[[RunIdentity], None] = lambda run: None,
        on_call: Callable[[], None] = lambda: None,
    ) -> None:
        self._node = node
        self._on_new_run, self._on_call = on_run, on_call
        self._member = RunMember(participant_of(node))
        presence = Presence(
            node.context.get_domain_id(),
            node.get_namespace(),
            node.role,
            self._member.participant.instance,
        )
        node.on_destroy.callback(presence.close)
        self._publisher = node.output(PARTICIPANTS)
        self.includes = self._member.includes
        node.awaits = 'a run'
        node.subscribe(ROLL_CALL, self._on_roll_call)

    def raise_objection(self, objection: Objection) -> None:
        """Tell the plant that a sample can't belong to its run, or that the node can't continue."""
        if self._member.objects(objection):
            self._announce()

    def _on_roll_call(self, header: Header) -> None:
        run = RunIdentity(header.frame_id, time_ns(header.stamp))
        if run != self._member.run:
            self._join(run)
        self._announce()
        self._on_call()

    def _join(self, run: RunIdentity) -> None:
        member = self._member
        if member.join(run):
            self._node.recreate_publishers(exclude=PARTICIPANTS)
        self._node.now_ns = 0
        self._node.apply_parameters()
        member.participant = with_parameters(
            member.participant, self._node.parameters, self._node.announced_values()
        )
        self._node.get_logger().info(f'takes part in run {run.number}')
        self._on_new_run(run)

    def _announce(self) -> None:
        announcement = self._member.announcement(self._node.now_ns, self._node.awaited())
        if announcement:
            self._publisher.publish(encode_announcement(announcement))
