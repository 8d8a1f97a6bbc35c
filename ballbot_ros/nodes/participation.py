"""A node's part in the runs of the plant, and what it observes of the other nodes."""

from __future__ import annotations

import hashlib
import json
import os
import socket
import time
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from uuid import uuid4

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo
from std_msgs.msg import Header as HeaderMessage

from ballbot_ros import __version__
from ballbot_ros.controllers.codegen.implementation import public_changes
from ballbot_ros.controllers.loading import public_reference
from ballbot_ros.lockstep.lockstep import RunIdentity
from ballbot_ros.lockstep.participants import (
    MAP_HASH,
    LocalNode,
    Objection,
    Participant,
    Publisher,
    RunMember,
)
from ballbot_ros.nodes.base import AnyNode
from ballbot_ros.nodes.endpoints import drain, hidden_node, raw_subscription
from ballbot_ros.nodes.middleware import Presence, is_local, living_participants, present_nodes
from ballbot_ros.parameters import PATHS, NodeParameters, Value
from ballbot_ros.recording.messages.conversions import time_ns
from ballbot_ros.recording.messages.raw import stamp_of
from ballbot_ros.recording.messages.run_reports import encode_announcement
from ballbot_ros.recording.messages.topics import PARTICIPANTS, ROLL_CALL, Topic, periodic_topics
from ballbot_ros.recording.schemas import Header
from ballbot_ros.robot.brick.fault_effects import change_faults
from ballbot_ros.robot.world.floor_map import read_map_file

_PREFIX = 24
"""Number of hexadecimal digits shared by all identifiers of one DDS participant."""

_EVERY_PARTICIPANT = 'ros_discovery_info'
"""The topic on which every participant publishes, and before it publishes on any other."""

_LIST_PERIOD_S = 1.0

_UNKNOWN_NODE = '_NODE_NAME_UNKNOWN_'
_WITHOUT_ROS = '_CREATED_BY_BARE_DDS_APP_'


class GraphObserver:
    """The publishers of topics in the namespace of a node, and the messages that arrive on them."""

    def __init__(self, node: Node, topics: Collection[Topic]) -> None:
        self._node = node
        self._topics = {topic.name: topic for topic in topics}
        self._inbox: Node | None = None
        self._subscriptions: dict[str, Subscription] = {}
        self._counts: list[int] = []
        self._found: dict[str, list[Publisher]] = {}
        self._listed_at = 0.0

    def is_complete(self) -> bool:
        """Return whether all participants have been discovered; False if that can't be known.

        It is known only if discovery is limited to this machine.
        """
        if not is_local():
            return False
        living = living_participants(self._node.context.get_domain_id())
        offers = self._node.get_publishers_info_by_topic(_EVERY_PARTICIPANT, no_mangle=True)
        return 0 < len(living) <= len(offers)

    def present_nodes(self) -> dict[str, LocalNode]:
        """Return the participants on this machine by instance, also undiscovered ones."""
        return present_nodes(self._node.context.get_domain_id(), self._node.get_namespace())

    def publishers(self) -> dict[str, list[Publisher]]:
        """Return the publishers of each topic by its name.

        Counting publishers takes a fifth of the time of listing them, so while the counts stay the
        same, the list is renewed only once a second.
        """
        now_s = time.monotonic()
        counts = [self._node.count_publishers(name) for name in self._topics]
        is_known = all(publisher.node for found in self._found.values() for publisher in found)
        if counts == self._counts and is_known and now_s - self._listed_at < _LIST_PERIOD_S:
            return self._found
        self._counts, self._listed_at = counts, now_s
        self._found = {
            name: [
                Publisher(bytes(offer.endpoint_gid), full_name(offer))
                for offer in self._node.get_publishers_info_by_topic(name)
            ]
            for name in self._topics
        }
        return self._found

    def count_publishers(self, topic: str) -> int:
        """Return the number of publishers on a topic."""
        return int(self._node.count_publishers(topic))

    def received(self, names: Collection[str]) -> list[tuple[str, int]]:
        """Return the messages on these topics since the last call, as topic and stamp [ns].

        The first call for a topic subscribes to it.
        """
        found = []
        for name in names:
            if self._inbox is None:
                self._inbox = hidden_node('look', self._node)
            if name not in self._subscriptions:
                qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
                topic = self._topics[name]
                self._subscriptions[name] = raw_subscription(self._inbox, topic, qos)
            for data, _ in drain(self._subscriptions[name]):
                with suppress(ValueError):  # too short for a stamp: from a stranger
                    found.append((name, stamp_of(data)))
        return found

    def stop_listening(self) -> None:
        """Remove all subscriptions."""
        if self._inbox is not None:
            self._inbox.destroy_node()
            self._inbox = None
            self._subscriptions.clear()


def guid_prefix(node: Node, word: str) -> str:
    """Return the common prefix of the identifiers of a node's publishers, as hexadecimal text.

    All nodes of a process share it. The only way to find it is to compare two publishers on a topic
    that nobody else uses, named after the unique `word`. It is '' if the two have no common prefix.
    """
    topic = f'_{word}'
    publishers = [node.create_publisher(HeaderMessage, topic, 1) for _ in range(2)]
    gids = [bytes(offer.endpoint_gid).hex() for offer in node.get_publishers_info_by_topic(topic)]
    for publisher in publishers:
        node.destroy_publisher(publisher)
    prefixes = {gid[:_PREFIX] for gid in gids}
    return prefixes.pop() if len(prefixes) == 1 else ''


def full_name(offer: TopicEndpointInfo) -> str:
    """Return the fully qualified name of a publisher's node, '' until it is discovered."""
    if offer.node_name == _UNKNOWN_NODE:
        return ''
    if offer.node_name == _WITHOUT_ROS:
        return 'a program without ROS'
    return f'{offer.node_namespace.rstrip("/")}/{offer.node_name}'


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
    if name == 'changes':
        return public_changes(str(value))
    return Path(str(value)).name if name in PATHS else value


class Participation:
    """Joins every run that a plant announces, and answers its roll calls.

    `on_run` is called with each new run before the node joins it, and `on_call` after each answered
    roll call.
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

    def change_faults(self, row: list[float]) -> None:
        """Let a row be that of the faults that the node has now, and announce them."""
        member, parameters = self._member, self._node.parameters
        if member.run and parameters.faults != member.participant.parameters['faults']:
            change_faults(row, parameters, member.run.start_ns)
            member.participant = member.participant.with_faults(parameters.faults)
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
        self._node.start_ns, self._node.now_ns = run.start_ns, 0
        self._node.apply_parameters()
        member.participant = with_parameters(
            member.participant, self._node.parameters, self._node.announced_values()
        )
        self._node.get_logger().info(f'takes part in run {run.number}')
        self._on_new_run(run)

    def _announce(self) -> None:
        if announcement := self._member.announcement(self._node.now_ns, self._node.awaited()):
            self._publisher.publish(encode_announcement(announcement))
