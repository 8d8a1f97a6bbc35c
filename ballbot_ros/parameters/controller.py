"""Parameters of the control program, with the names of Appendix C where they exist."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

from ballbot_ros.parameters.brick_time import KernelChoice, LinkParameters, TaskCosts
from ballbot_ros.parameters.nodes import (
    BrickFaults,
    DeviceSeed,
    LockstepChoice,
    LogFormat,
    StickScale,
)
from ballbot_ros.parameters.parameter import NodeParameters, Value, live, quantity, setting

Gains = tuple[float, float, float, float]
Period = Literal[4, 20, 100]
"""Periods [ms] of whole ticks that divide 100 ms, the grid on which runs begin."""

DOCUMENTS_PROGRAM = ('python', 'c', 'arm')
"""Implementations of the document's control program."""

USER, MODEL = 'user.', 'model.'
OWN_PREFIXES = (USER, MODEL)
"""Start of the names of parameters that only controllers other than the document's have: those
that the controller's class declares, and the physical values that its gains are designed for."""

ANY = (-1e9, 1e9)
COEFFICIENT = (0.0, 1.0)
UINT32_BOUNDS = (0, 2**32 - 1)


@dataclass(frozen=True, kw_only=True)
class ControllerParameters(
    LogFormat,
    StickScale,
    LockstepChoice,
    DeviceSeed,
    BrickFaults,
    KernelChoice,
    LinkParameters,
    TaskCosts,
    NodeParameters,
):
    """The parameters of ``controller``."""

    node: ClassVar[str] = 'controller'

    implementation: str = setting(
        'python',
        "the document's program (python, c, arm), or another controller: an installed name, "
        'package.module:Class or FILE.py:Class',
    )
    mode: Literal['remote', 'autonomous'] = setting('remote', 'drive mode (task_init)', '7.3')
    k_f: Gains = live(
        (-0.01504899, -1.56981134, -0.02700482, -0.23249821),
        'V/deg, V·s/deg',
        ANY,
        'servo control feedback gain of θ, ψ, θ˙, ψ˙',
        '4.2',
    )
    k_i: float = live(-0.00712528, 'V/(deg·s)', ANY, 'servo control integral gain', '4.2')
    a_b: float = quantity(0.8, '1', COEFFICIENT, 'low pass: battery voltage', '7.7')
    a_d: float = quantity(0.8, '1', COEFFICIENT, 'low pass: velocity', '7.7')
    a_r: float = quantity(0.996, '1', COEFFICIENT, 'low pass: speed reference', '7.7')
    a_gc: float = quantity(0.8, '1', COEFFICIENT, 'low pass: gyro calibration', '7.7')
    a_gd: float = quantity(0.999, '1', COEFFICIENT, 'low pass: gyro drift', '7.7')
    pwm_gain: float = live(1.0, '1', (0.0, 100.0), 'friction compensator gain', '7.7')
    pwm_offset: float = live(0.0, '%', (0.0, 100.0), 'friction compensator offset', '7.7')
    dst_thr: int = live(30, 'cm', (-1, 255), 'obstacle avoidance threshold', '7.7')
    sonar_hold: int = quantity(
        0, 'ms', (0, 60000), 'time for which the last echo stays valid if none returns'
    )
    time_start: int = quantity(1000, 'ms', UINT32_BOUNDS, 'gyro calibration time', '7.4')
    time_auto: int = quantity(5000, 'ms', UINT32_BOUNDS, 'start of autonomous drive', '7.6')
    time_stop: int = quantity(
        500, 'ms', UINT32_BOUNDS, 'time from the loss of control until the motors stop', '7.6'
    )
    theta_diff_thr: float = live(
        600.0, 'deg', (0.0, 1e6), 'wheel angle error from which control counts as lost', '7.6'
    )
    psi_diff_thr: float = live(
        15.0, 'deg', (0.0, 180.0), 'body pitch error from which control counts as lost', '7.6'
    )
    sound_freq: int = quantity(440, 'Hz', (31, 14080), 'tone after calibration', '7.6')
    sound_dur: int = quantity(
        500, 'ms', (0, 65535), 'duration of the tone after calibration', '7.6'
    )
    sound_volume: int = quantity(70, '%', (0, 100), 'volume of all tones', '7.6')
    tone_gain: int = live(0, 'Hz/cm', (0, 55), 'tone proportional to the distance; 0: none', '10')
    log_count: int = quantity(25, 'ticks', (1, 255), 'ticks between log packets', '7.4')
    ts2_period: Period = quantity(20, 'ms', (4, 100), 'period of task_ts2: obstacles', '7.5')
    ts3_period: Period = quantity(
        100, 'ms', (4, 100), 'period of task_ts3: operating state, battery, sound', '7.6'
    )
    rejoin: bool = setting(
        False,
        'true: a controller started in mid-run restarts the program; '
        'false: it fails the run at once',
    )
    changes: str = setting(
        '',
        "changes of live parameters by time from the run's start [s], such as "
        "'3.2 k_thetadot=300; 5 k_i=-0.008'",
    )
    own: tuple[tuple[str, Value], ...] = ()
    """Names and values of the parameters with `OWN_PREFIXES`."""

    def values(self) -> dict[str, Value]:
        """Return the value of each parameter, by name."""
        values = super().values()
        del values['own']
        return {**values, **dict(self.own)}

    def with_values(self, values: Mapping[str, Value]) -> ControllerParameters:
        """Return these parameters with other values for some, by name."""
        own = {name: value for name, value in values.items() if is_own(name)}
        others = {name: value for name, value in values.items() if not is_own(name)}
        changed = super().with_values(others)
        return replace(changed, own=tuple({**dict(self.own), **own}.items()))


def is_own(name: str) -> bool:
    """Return whether a parameter belongs to a controller other than the document's."""
    return name.startswith(OWN_PREFIXES)
