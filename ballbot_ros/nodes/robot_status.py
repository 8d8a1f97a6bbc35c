"""The newest state of the robot as lines of text, for a terminal."""

from __future__ import annotations

import time
from collections.abc import Mapping

from ballbot_ros.messages.topics import OPERATING_STATE, PLANT_IMU, PLANT_ODOM, RUN, SONAR_RANGE
from ballbot_ros.nodes.base import AnyNode
from ballbot_ros.nodes.latest_messages import LatestMessages
from ballbot_ros.viewer.drive_status import drive_status
from ballbot_ros.viewer.real_time_factor import RealTimeFactor
from ballbot_ros.viewer.snapshot import Snapshot

_TOPICS = (PLANT_IMU, PLANT_ODOM, SONAR_RANGE, OPERATING_STATE, RUN)


class RobotStatus:
    """Reads the topics of the robot whenever its lines are requested."""

    def __init__(self, node: AnyNode) -> None:
        self._newest = LatestMessages(node, _TOPICS)
        self._snapshot: Snapshot | None = None
        self._factor = RealTimeFactor()

    def lines(self) -> Mapping[str, str]:
        """Return names and texts."""
        self._snapshot, _ = self._newest.take()
        factor = 0.0
        if self._snapshot:
            factor = self._factor.update(time.monotonic(), self._snapshot.time)
        return drive_status(self._snapshot, factor)

    def close(self) -> None:
        """Remove the subscriptions."""
        self._newest.close()
