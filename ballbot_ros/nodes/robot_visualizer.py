"""Draws the robot for RViz, Foxglove and similar tools; takes no part in the lockstep."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterable, Mapping

from ballbot_ros.messages.conversions import encode_text, map_grid, stamp_ns
from ballbot_ros.messages.markers import fill_transform
from ballbot_ros.messages.topics import (
    LCD,
    MAP,
    MARKERS,
    OPERATING_STATE,
    PLANT_IMU,
    PLANT_ODOM,
    ROBOT_DESCRIPTION,
    RUN,
    SONAR_RANGE,
    TF,
    TF_STATIC,
    message_class,
)
from ballbot_ros.nodes.base import AnyNode, BallbotNode, run_node
from ballbot_ros.nodes.latest_messages import LatestMessages
from ballbot_ros.parameters import Dimensions, VisualizerParameters
from ballbot_ros.plant.model import Bodies
from ballbot_ros.viewer.markers import RobotMarkers
from ballbot_ros.viewer.transforms import MOVING, PARENTS, SONAR, Frames, Transform, poses_in_map
from ballbot_ros.viewer.urdf import robot_description
from ballbot_ros.world.exports import floor_map_of

_DRAWN = (PLANT_IMU, PLANT_ODOM, SONAR_RANGE, OPERATING_STATE, LCD, MAP, RUN)

WHOLE_S = 1.0
"""Interval at which unchanged content is published again, for late subscribers."""


class RobotVisualizer(BallbotNode[VisualizerParameters]):
    """Publishes the robot's description, and markers and transforms that follow the robot."""

    def __init__(self, parameters: VisualizerParameters | None = None) -> None:
        super().__init__(VisualizerParameters, parameters)
        self._markers_output = self.output(MARKERS)
        self._description = self.output(ROBOT_DESCRIPTION)
        self._describe()
        try:
            self._transforms: Transforms | None = Transforms(
                self, self._frames.at((0.0, 0.0), (0.0, 0.0))
            )
        except ImportError:
            self._transforms = None
            self.get_logger().info('tf2_msgs is not installed: markers only, no transforms')
        self._time = self._whole_at = -math.inf
        self._newest = LatestMessages(self, _DRAWN)
        self.create_wall_timer(1.0 / self.parameters.rate, self._update)

    def _describe(self) -> None:
        """Publish the description of the robot, and draw this shape from now on."""
        dimensions = Dimensions.from_parameters(self.parameters)
        self._frames = Frames(dimensions)
        self._markers = RobotMarkers(dimensions, message_class('visualization_msgs/msg/Marker'))
        text = robot_description(dimensions, Bodies.from_parameters(self.parameters))
        self._description.publish(encode_text(text))

    def apply_parameters(self) -> None:
        """Apply the new parameter values at the start of a run."""
        before = self.parameters
        super().apply_parameters()
        if self.parameters != before:
            self._describe()
            if self._transforms is not None:
                self._transforms.fix(self._frames.at((0.0, 0.0), (0.0, 0.0)))

    def _update(self) -> None:
        snapshot, changed = self._newest.take()
        if snapshot is None:
            return
        if RUN in changed:
            self.apply_parameters()
        if RUN in changed or MAP in changed or snapshot.time < self._time:
            published = self._newest[MAP]
            self._markers.begin(floor_map_of(map_grid(published)) if published else None)
        frames = self._frames.at(snapshot.position, snapshot.psi)
        if snapshot.time != self._time:
            self._time = snapshot.time
            self.count_sample(stamp_ns(self._newest[PLANT_ODOM]))
            self._markers.follow(snapshot)
            if self._transforms is not None:
                self._transforms.publish(self.now_ns, frames)
        is_whole = time.monotonic() - self._whole_at >= WHOLE_S
        if (changed or is_whole) and self._markers_output.has_subscribers:
            if is_whole:
                self._whole_at = time.monotonic()
            markers = self._markers.at(snapshot, poses_in_map(frames), whole=is_whole)
            self._markers_output.publish(MARKERS.message_class(markers=markers))

    def close(self) -> None:
        """Remove the subscriptions."""
        self._newest.close()


class Transforms:
    """The moving frames on ``/tf``, and the fixed frame on ``/tf_static``.

    Parameters
    ----------
    frames : dict of Transform
        Pose of each frame in its parent; any pose of the robot will do, since only the fixed frame
        is published at once.

    Raises
    ------
    ImportError
        If tf2_msgs is not installed: it is not part of common_interfaces.
    """

    def __init__(self, node: AnyNode, frames: dict[str, Transform]) -> None:
        self._new_message = TF.message_class
        self._new_transform = message_class('geometry_msgs/msg/TransformStamped')
        self._moving, self._fixed = node.output(TF), node.output(TF_STATIC)
        self.fix(frames)

    def fix(self, frames: dict[str, Transform]) -> None:
        """Publish the fixed frame."""
        self._fixed.publish(self._message((SONAR,), 0, frames))

    def publish(self, stamp_ns: int, frames: dict[str, Transform]) -> None:
        """Publish the moving frames."""
        self._moving.publish(self._message(MOVING, stamp_ns, frames))

    def _message(
        self, names: Iterable[str], stamp_ns: int, frames: Mapping[str, Transform]
    ) -> object:
        transforms = []
        for name in names:
            transforms.append(self._new_transform())
            fill_transform(transforms[-1], stamp_ns, PARENTS[name], name, *frames[name].values())
        return self._new_message(transforms=transforms)


def main() -> None:
    """Run the node."""
    sys.exit(run_node(RobotVisualizer))
