"""The control program's constants in the types of the target."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ballbot_ros.brick.schedule import TaskTiming
from ballbot_ros.controllers.document.tasks import task_timings
from ballbot_ros.parameters import ControllerParameters

Single = np.float32


@dataclass(frozen=True)
class ProgramConstants:
    """Constants of Appendix C with the document's names; ``Single`` where C has float."""

    k_f: tuple[Single, Single, Single, Single]
    k_i: Single
    k_thetadot: Single
    a_b: Single
    a_d: Single
    a_r: Single
    a_gc: Single
    a_gd: Single
    pwm_gain: Single
    pwm_offset: Single
    wheel_radius: Single
    ball_radius: Single
    theta_diff_thr: Single
    psi_diff_thr: Single
    lsb: Single
    autonomous: bool
    gp_max: int
    dst_thr: int
    sonar_hold: int
    time_start: int
    time_auto: int
    time_stop: int
    sound_freq: int
    sound_dur: int
    sound_volume: int
    tone_gain: int
    log_count: int
    ts2_period: int
    ts3_period: int

    @classmethod
    def of(cls, parameters: ControllerParameters) -> ProgramConstants:
        """Return the constants for the parameters of the node ``controller``."""
        typed: dict[str, Any] = {'autonomous': parameters.mode == 'autonomous'}
        for name, annotation in cls.__annotations__.items():
            if annotation == 'Single':
                typed[name] = Single(getattr(parameters, name))
            elif annotation == 'int':
                typed[name] = int(getattr(parameters, name))
        typed['k_f'] = tuple(Single(gain) for gain in parameters.k_f)
        return cls(**typed)

    @property
    def tasks(self) -> tuple[TaskTiming, ...]:
        """The tasks of the program."""
        return task_timings(self.ts2_period, self.ts3_period)
