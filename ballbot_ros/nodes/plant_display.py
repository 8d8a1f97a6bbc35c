"""What the terminal of the gamepad node shows of a simulated robot, and its reset."""

from __future__ import annotations

import time
from collections.abc import Mapping

from std_srvs.srv import Trigger

from ballbot_ros.nodes.base import BallbotNode
from ballbot_ros.nodes.latest_messages import LatestMessages
from ballbot_ros.parameters import PLANT, GamepadParameters
from ballbot_ros.recording.messages.topics import (
    OPERATING_STATE,
    PLANT_IMU,
    PLANT_ODOM,
    RUN,
    SONAR_RANGE,
)
from ballbot_ros.viewer.run_activity import RealTimeFactor, drive_status

_TOPICS = (PLANT_IMU, PLANT_ODOM, SONAR_RANGE, OPERATING_STATE, RUN)


class PlantDisplay:
    """The newest state of the plant as texts, and the client of its reset."""

    def __init__(self, node: BallbotNode[GamepadParameters]) -> None:
        self._node = node
        self._newest, self._factor = LatestMessages(node, _TOPICS), RealTimeFactor()
        self._reset = node.create_client(Trigger, f'{PLANT}/reset')

    def lines(self) -> Mapping[str, str]:
        """Return names and texts; called on the keyboard's thread."""
        snapshot, _ = self._newest.take()
        factor = self._factor.update(time.monotonic(), snapshot.time) if snapshot else 0.0
        return drive_status(snapshot, factor)

    def restart(self) -> None:
        """Let the plant begin a new run."""
        self._reset.call_async(Trigger.Request())

    def close(self) -> None:
        """End its subscriptions."""
        self._newest.close()
        self._node.destroy_client(self._reset)
