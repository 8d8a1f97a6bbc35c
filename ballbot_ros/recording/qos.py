"""Quality of service in recordings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

INFINITE = 2**63 - 1
"""An infinite duration [ns]."""


@dataclass(frozen=True)
class QosProfile:
    """The QoS offered by a publisher, with the names and the order of rosbag2.

    Attributes
    ----------
    history : str
        ``keep_last``, ``keep_all``, ``system_default``, or ``unknown`` if discovery does not report
        it.
    depth : int
        Number of messages kept; 0 if unknown.
    reliability : str
        ``reliable``, ``best_effort``, ...
    durability : str
        ``transient_local``, ``volatile``, ...
    deadline, lifespan, liveliness_lease_duration : int
        Durations [ns]; 0 if left to the middleware, or `INFINITE`.
    liveliness : str
        ``automatic``, ``manual_by_topic``, ...
    avoid_ros_namespace_conventions : bool
        Whether the topic's name is passed to the middleware unchanged.
    """

    history: str
    depth: int
    reliability: str
    durability: str
    deadline: int = INFINITE
    lifespan: int = INFINITE
    liveliness: str = 'automatic'
    liveliness_lease_duration: int = INFINITE
    avoid_ros_namespace_conventions: bool = False

    @classmethod
    def from_rclpy(cls, profile: Any) -> QosProfile:
        """Convert an ``rclpy.qos.QoSProfile``, such as ``TopicEndpointInfo.qos_profile``."""
        return cls(
            history=profile.history.name.lower(),
            depth=profile.depth,
            reliability=profile.reliability.name.lower(),
            durability=profile.durability.name.lower(),
            deadline=profile.deadline.nanoseconds,
            lifespan=profile.lifespan.nanoseconds,
            liveliness=profile.liveliness.name.lower(),
            liveliness_lease_duration=profile.liveliness_lease_duration.nanoseconds,
            avoid_ros_namespace_conventions=profile.avoid_ros_namespace_conventions,
        )


RELIABLE_LATCHED = QosProfile('keep_last', 128, 'reliable', 'transient_local')
"""The QoS offered by every publisher of the graph."""
