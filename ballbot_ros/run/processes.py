"""The arrangements of processes in which a run can be carried out."""

from __future__ import annotations

from ballbot_ros.parameters.text_enum import TextEnum


class Processes(TextEnum):
    """How the nodes of a run are distributed over processes."""

    SEPARATE = 'separate'
    ONE = 'one'
    NONE = 'none'
    """No nodes: the closed loop without ROS."""
