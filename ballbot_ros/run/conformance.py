"""Testing a node against the contract of its role."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from uuid import uuid4

from ballbot_ros.nodes.conformance import examination
from ballbot_ros.nodes.conformance.examination import RequirementResult
from ballbot_ros.nodes.conformance_bench import ConformanceBench
from ballbot_ros.nodes.middleware import DomainLock, require_discovery, ros_domain
from ballbot_ros.process import StopRequest
from ballbot_ros.run.one_process import ros


def examine_node(role: str, command: Sequence[str] = ()) -> Iterator[RequirementResult]:
    """Test the node of a role; yield a row for each requirement of its contract.

    Parameters
    ----------
    command : sequence of str
        The command that starts the node, which has ended when the iterator has; empty if the user
        starts the node. Late start and restart can only be tested with a command.

    Raises
    ------
    BallbotError
        If ROS can't start, a plant or player is in the ROS domain, or there is no such program.
    """
    require_discovery()
    with (
        StopRequest() as stop,
        ros(),
        DomainLock(ros_domain()),
        closing(ConformanceBench(role, command, stop)) as bench,
    ):
        yield from examination.examine(role, bench, uuid4().hex)
