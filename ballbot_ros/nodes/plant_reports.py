"""Reads the plant's diagnostics without the executor."""

from __future__ import annotations

from itertools import islice

from rclpy.node import Node
from rclpy.qos import QoSProfile

from ballbot_ros.messages.plant_report import PlantReport, decode_plant_report
from ballbot_ros.messages.topics import DIAGNOSTICS
from ballbot_ros.nodes.inbox import drain, raw_subscription

_DEPTH = 50


class PlantReports:
    """The plant's reports on a topic that all nodes share, read through a hidden node."""

    def __init__(self, inbox: Node) -> None:
        self._subscription = raw_subscription(inbox, DIAGNOSTICS, QoSProfile(depth=_DEPTH))

    def take(self) -> list[PlantReport]:
        """Return the reports that have arrived since the last call, oldest first."""
        # Read no more messages than can be waiting: other nodes may publish faster than this.
        arrived = islice(drain(self._subscription), _DEPTH)
        reports = (decode_plant_report(data) for data, _ in arrived)
        return [report for report in reports if report is not None]
