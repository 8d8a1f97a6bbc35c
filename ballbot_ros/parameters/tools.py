"""Parameters of the nodes that record, play and show runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ballbot_ros.parameters.parameter import NodeParameters, TakesEffect, path, quantity, setting
from ballbot_ros.parameters.shared import Dimensions, MapChoice, Masses


@dataclass(frozen=True, kw_only=True)
class RecorderParameters(NodeParameters):
    """The parameters of ``recorder``."""

    node: ClassVar[str] = 'recorder'

    output: str = path(
        'file to write; empty: a new one under runs/', 'project', takes_effect=TakesEffect.READ_ONLY
    )
    attachments: str = path(
        'folder whose files are attached to the recording; empty: none',
        'project',
        takes_effect=TakesEffect.READ_ONLY,
    )


@dataclass(frozen=True, kw_only=True)
class PlayerParameters(NodeParameters):
    """The parameters of ``player``."""

    node: ClassVar[str] = 'player'

    file: str = path('recording to play', 'project', takes_effect=TakesEffect.READ_ONLY)
    rate: float = quantity(
        1.0,
        '1',
        (0.01, 100.0),
        'speed in multiples of real time',
        'project',
        takes_effect=TakesEffect.IMMEDIATELY,
    )
    start: float = quantity(
        0.0,
        's',
        (0.0, 1e9),
        'start, counted from the first message',
        'project',
        takes_effect=TakesEffect.READ_ONLY,
    )
    loop: bool = setting(
        False, 'true: restarts at the end', 'project', takes_effect=TakesEffect.READ_ONLY
    )
    topics: str = setting(
        '',
        'topics to play, separated by commas; empty: all',
        'project',
        takes_effect=TakesEffect.READ_ONLY,
    )


@dataclass(frozen=True, kw_only=True)
class ViewerParameters(Dimensions, MapChoice, NodeParameters):
    """The parameters of ``viewer``."""

    node: ClassVar[str] = 'viewer'

    host: str = setting(
        '127.0.0.1',
        'address that serves the page: all who reach it can watch, those with the token can steer',
        'project',
        takes_effect=TakesEffect.READ_ONLY,
    )
    port: int = quantity(
        -1,
        '1',
        (-1, 65535),
        'port of the page; -1: 8080, or the next free one; 0: any free one',
        'project',
        takes_effect=TakesEffect.READ_ONLY,
    )


@dataclass(frozen=True, kw_only=True)
class VisualizerParameters(Dimensions, Masses, NodeParameters):
    """The parameters of ``robot_visualizer``."""

    node: ClassVar[str] = 'robot_visualizer'

    rate: float = quantity(
        30.0,
        'Hz',
        (1.0, 250.0),
        'maximum rate of markers, transforms and odometry',
        'project',
        takes_effect=TakesEffect.READ_ONLY,
    )


@dataclass(frozen=True, kw_only=True)
class SupervisorParameters(NodeParameters):
    """The parameters of ``supervisor``."""

    node: ClassVar[str] = 'supervisor'

    scenario: str = path(
        'scenario (name or file) of the run that supervisor/start begins',
        'project',
        takes_effect=TakesEffect.IMMEDIATELY,
    )
