"""Parameters shared by several nodes: one value each, whichever node it is set in."""

from __future__ import annotations

from dataclasses import dataclass

from ballbot_ros.parameters.parameter import Subset, TakesEffect, path, quantity, setting


@dataclass(frozen=True, kw_only=True)
class DeviceSeed:
    """The seed of the device noise and jitter."""

    seed: int = quantity(
        1, '1', (0, 2**63 - 1), 'seed of all device noise and jitter of the run', 'project'
    )


@dataclass(frozen=True, kw_only=True)
class MapChoice:
    """The map that the robot drives on."""

    map: str = path('map (shipped name or image file); empty: unlimited floor', 'B.2')


@dataclass(frozen=True, kw_only=True)
class ScenarioChoice:
    """The scenario that a node takes part in."""

    scenario: str = path('scenario (name or file) for stick signals and pushes; empty: none', '5.1')


@dataclass(frozen=True, kw_only=True)
class LockstepChoice:
    """Whether the graph runs in lockstep."""

    lockstep: bool = setting(
        True,
        'true: each tick waits for its inputs; false: wall-clock timers, newest sample wins',
        'project',
        takes_effect=TakesEffect.READ_ONLY,
    )


@dataclass(frozen=True, kw_only=True)
class StickScale:
    """The meaning of a full stick."""

    k_thetadot: float = quantity(
        380.0,
        'deg/s',
        (0.0, 1e4),
        'speed reference gain (0.17 m/s)',
        '7.7',
        takes_effect=TakesEffect.IMMEDIATELY,
    )
    gp_max: int = quantity(100, '%', (1, 127), 'largest stick value', '5.1')


@dataclass(frozen=True, kw_only=True)
class BallRadius:
    """The size of the ball."""

    ball_radius: float = quantity(0.026, 'm', (1e-3, 1.0), 'spherical wheel radius Rs', '3.1')


@dataclass(frozen=True, kw_only=True)
class Radii(BallRadius):
    """The sizes of the rolling parts."""

    wheel_radius: float = quantity(
        0.021, 'm', (1e-3, 1.0), 'motor wheel (rubber tire) radius Rw', '3.1'
    )


@dataclass(frozen=True, kw_only=True)
class BodyDepth:
    """The extent of the body in x."""

    body_depth: float = quantity(0.135, 'm', (0.0, 10.0), 'body depth D, along x', '3.1')


@dataclass(frozen=True, kw_only=True)
class Dimensions(Radii, BodyDepth, Subset):
    """All lengths that determine the robot's shape."""

    wheel_width: float = quantity(
        0.022, 'm', (0.0, 1.0), 'motor wheel height (width of the tire) Lw', '3.1'
    )
    body_width: float = quantity(0.135, 'm', (0.0, 10.0), 'body width W, along y', '3.1')
    body_height: float = quantity(
        0.17, 'm', (1e-3, 10.0), 'distance L from the ball centre to the body centre', '3.1'
    )


@dataclass(frozen=True, kw_only=True)
class Masses:
    """The masses of the robot's parts."""

    ball_mass: float = quantity(0.013, 'kg', (1e-06, 100.0), 'spherical wheel mass Ms', '3.1')
    wheel_mass: float = quantity(0.015, 'kg', (0.0, 100.0), 'motor wheel mass Mw', '3.1')
    body_mass: float = quantity(0.682, 'kg', (1e-06, 100.0), 'body mass Mb', '3.1')
