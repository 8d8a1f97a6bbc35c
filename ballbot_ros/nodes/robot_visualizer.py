"""Draws the robot for RViz, Foxglove and similar tools; takes no part in the lockstep."""

from __future__ import annotations

import math
import time
from contextlib import suppress

from ballbot_ros.nodes.base import BallbotNode
from ballbot_ros.nodes.endpoints import drain, raw_subscription, requested_qos
from ballbot_ros.nodes.latest_messages import LatestMessages
from ballbot_ros.parameters import Dimensions, VisualizerParameters
from ballbot_ros.recording.messages.conversions import map_grid, stamp_ns
from ballbot_ros.recording.messages.raw import stamp_of
from ballbot_ros.recording.messages.run_messages import Send
from ballbot_ros.recording.messages.topics import (
    HISTORY,
    LCD,
    MAP,
    MARKERS,
    OPERATING_STATE,
    PARTICIPANTS,
    PLANT_IMU,
    PLANT_ODOM,
    RUN,
    SONAR_RANGE,
    TF,
    Topic,
    find_message_class,
    message_class,
)
from ballbot_ros.robot.world.floor_map import floor_map_of
from ballbot_ros.viewer.derived_messages import DerivedMessages
from ballbot_ros.viewer.markers import RobotMarkers
from ballbot_ros.viewer.robot import Frames, poses_in_map

_DRAWN = (PLANT_IMU, PLANT_ODOM, SONAR_RANGE, OPERATING_STATE, LCD, MAP, RUN)
_SOURCES = tuple(topic for topic in DerivedMessages.INPUTS if topic is not PARTICIPANTS)
"""The shape is that of this node's parameters, as that of the markers."""

WHOLE_S = 1.0
"""Interval at which unchanged content is published again, for late subscribers."""


class RobotVisualizer(BallbotNode[VisualizerParameters]):
    """Publishes the robot's description, and markers and transforms that follow the robot."""

    def __init__(self, parameters: VisualizerParameters | None = None) -> None:
        super().__init__(VisualizerParameters, parameters)
        self._markers_output = self.output(MARKERS)
        if find_message_class(TF.type_name) is None:
            self.get_logger().info('tf2_msgs is not installed: markers only, no transforms')
        self._derived = DerivedMessages(self._make_send, self.parameters)
        self._describe()
        self._time = self._whole_at = -math.inf
        self._newest = LatestMessages(self, _DRAWN)
        inbox = self._newest.inbox
        self._sources = {
            topic: raw_subscription(inbox, topic, requested_qos(topic, HISTORY))
            for topic in _SOURCES
        }
        self.create_wall_timer(1.0 / self.parameters.rate, self._update)

    def _describe(self) -> None:
        """Publish the description of the robot, and draw this shape from now on."""
        dimensions = Dimensions.from_parameters(self.parameters)
        self._frames = Frames(dimensions)
        self._markers = RobotMarkers(dimensions, message_class('visualization_msgs/msg/Marker'))
        self._derived.set_shape(self.parameters)
        self._derived.describe(self.now_ns)

    def _make_send(self, topic: Topic) -> Send:
        """Return what publishes a topic; this node draws the markers itself, with the robot."""
        if topic is MARKERS or find_message_class(topic.type_name) is None:
            return lambda stamp_ns, data: None
        return self.output(topic).send

    def apply_parameters(self) -> None:
        """Apply the new parameter values at the start of a run."""
        before = self.parameters
        super().apply_parameters()
        if self.parameters != before:
            self._describe()

    def _update(self) -> None:
        snapshot, changed = self._newest.take()
        if RUN in changed:
            self.apply_parameters()
        self._derive()
        if snapshot is None:
            return
        if RUN in changed or MAP in changed or snapshot.time < self._time:
            published = self._newest[MAP]
            self._markers.begin(floor_map_of(map_grid(published)) if published else None)
        frames = self._frames.at(snapshot.position, snapshot.psi)
        if snapshot.time != self._time:
            self._time = snapshot.time
            self.count_sample(stamp_ns(self._newest[PLANT_ODOM]))
            self._markers.follow(snapshot)
        is_whole = time.monotonic() - self._whole_at >= WHOLE_S
        if (changed or is_whole) and self._markers_output.has_subscribers:
            if is_whole:
                self._whole_at = time.monotonic()
            markers = self._markers.at(snapshot, poses_in_map(frames), whole=is_whole)
            self._markers_output.publish(MARKERS.message_class(markers=markers))

    def _derive(self) -> None:
        """Publish what follows from all messages since the last update."""
        for topic, subscription in self._sources.items():
            for data, _ in drain(subscription):
                with suppress(ValueError):  # too short for a stamp
                    self._derived.add(topic, stamp_of(data), data)
        self._derived.send()

    def close(self) -> None:
        """Remove the subscriptions."""
        self._newest.close()
