"""The balance and drive controller of one plane (section 7.4), in single precision.

Functions on numbers: state in, state out. Every operation is one IEEE single-precision operation,
in the order of the generated code, since addition is not associative and the duties must be
bit-identical. Given numbers in double precision, :func:`control` computes in double precision,
which the analysis of the loop makes use of.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, get_args

import numpy as np

from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.nodes import LogContent
from ballbot_ros.parameters.timing import TICK_MS
from ballbot_ros.robot.brick.schedule import TaskTiming

PROGRAM_NAME = 'NXT BALLBOT'
"""First line of the display."""

TASK_TS1, TASK_TS2 = 'task_ts1', 'task_ts2'
TS1_MS = TICK_MS
"""Period of task_ts1: the tick of the plant."""

LCD_MS = 500


def task_timings(ts2_ms: int, ts3_ms: int) -> tuple[TaskTiming, ...]:
    """Return the tasks; the periods of ts2 and ts3 are parameters.

    Both the Python program's schedule and the generated OIL file are derived from them.
    """
    return (
        TaskTiming('task_init', 5, 0),
        TaskTiming(TASK_TS1, 4, TS1_MS),
        TaskTiming(TASK_TS2, 3, ts2_ms),
        TaskTiming('task_ts3', 2, ts3_ms),
        TaskTiming('task_lcd', 1, LCD_MS),
    )


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
    log_content: int
    ts2_period: int
    ts3_period: int

    @classmethod
    def of(cls, parameters: ControllerParameters) -> ProgramConstants:
        """Return the constants for the parameters of the node ``controller``."""
        typed: dict[str, Any] = {
            'autonomous': parameters.mode == 'autonomous',
            'log_content': get_args(LogContent).index(parameters.log_content),
        }
        for name, annotation in cls.__annotations__.items():
            if annotation == 'Single':
                typed[name] = Single(getattr(parameters, name))
            elif annotation == 'int' and name not in typed:
                typed[name] = int(getattr(parameters, name))
        typed['k_f'] = tuple(Single(gain) for gain in parameters.k_f)
        return cls(**typed)

    @property
    def tasks(self) -> tuple[TaskTiming, ...]:
        """The tasks of the program."""
        return task_timings(self.ts2_period, self.ts3_period)


ZERO, ONE, HUNDRED, THOUSAND = Single(0), Single(1), Single(100), Single(1000)
TS1_PERIOD = Single(TS1_MS)

AxisState = tuple[Single, Single, Single, Single, Single, Single]
"""The state carried from one period to the next, see :class:`PlaneValues`.

gyro_offset, theta_ref_dot, sum_theta_ref_dot, sum_psi_dot, sum_theta_diff, theta_smooth.
"""

AxisEstimates = tuple[Single, Single, Single, Single, Single, Single, Single]
"""theta, psi, theta_dot, psi_dot, theta_ref, theta_diff, psi_diff; see :class:`PlaneValues`."""

AT_REST: AxisState = (ZERO, ZERO, ZERO, ZERO, ZERO, ZERO)

Gains = tuple[Single, Single, Single, Single]
Constants = tuple[
    Gains, Single, Single, Single, Single, Single, Single, Single, Single, Single, Single, Single,
    Single,
]  # fmt: skip
"""Constants of :func:`control`, made by :func:`constants_of`.

Plain tuples, which Python creates and unpacks several times faster than named ones.
"""


def constants_of(p: ProgramConstants) -> Constants:
    """Return the constants of :func:`control`.

    Besides those of Appendix C, they include 1 - a, Rw/Rs, and gp_max as float.
    """
    gains = p.k_f[0], p.k_f[1], p.k_f[2], p.k_f[3]  # in a row of a table, they are an array
    return (
        gains, p.k_i, p.k_thetadot,
        p.a_d, p.a_r, p.a_gd, ONE - p.a_d, ONE - p.a_r, ONE - p.a_gd,
        p.pwm_gain, p.pwm_offset, p.wheel_radius / p.ball_radius, Single(p.gp_max),
    )  # fmt: skip


def calibrated_offset(gyro_offset: Single, gyro: int, a_gc: Single) -> Single:
    """Return the offset estimate [deg/s], moved towards a reading at rest."""
    return Single(gyro) * (ONE - a_gc) + a_gc * gyro_offset


def control(
    constants: Constants,
    state: AxisState,
    gyro: Single,
    revolution: Single,
    stick: Single,
    max_voltage: Single,
) -> tuple[AxisState, AxisEstimates, Single]:
    """Return the next state, the estimates, and the duty [%], -100 ... 100, before truncation.

    Parameters
    ----------
    constants : tuple
        Result of :func:`constants_of`.
    state : tuple of Single
        Result of the previous period; initially zeros, and a gyro reading as offset.
    gyro, revolution : Single
        Gyro reading [deg/s + offset] and motor angle [deg].
    stick : Single
        Speed command, -gp_max ... gp_max.
    max_voltage : Single
        Motor voltage at full duty [V].
    """
    (
        k_f, k_i, k_thetadot, a_d, a_r, a_gd, complement_d, complement_r, complement_gd,
        pwm_gain, pwm_offset, wheel_per_ball, gp_max,
    ) = constants  # fmt: skip
    k_theta, k_psi, k_theta_dot, k_psi_dot = k_f
    gyro_offset, theta_ref_dot, sum_theta_ref_dot, sum_psi_dot, sum_theta_diff, smooth = state

    theta_ref = TS1_PERIOD * sum_theta_ref_dot / THOUSAND
    theta_ref_dot = stick / gp_max * k_thetadot * complement_r + theta_ref_dot * a_r

    psi = TS1_PERIOD * sum_psi_dot / THOUSAND
    theta = wheel_per_ball * revolution + psi
    theta_smooth = theta * complement_d + smooth * a_d
    gyro_offset = gyro * complement_gd + a_gd * gyro_offset
    psi_dot = gyro - gyro_offset
    theta_dot = (theta_smooth - smooth) * THOUSAND / TS1_PERIOD

    theta_diff = theta_ref - theta
    psi_diff = ZERO - psi
    feedback = ZERO + k_theta * theta_diff
    feedback = feedback + k_psi * psi_diff
    feedback = feedback + k_theta_dot * (theta_ref_dot - theta_dot)
    feedback = feedback + k_psi_dot * (ZERO - psi_dot)
    integral = TS1_PERIOD * sum_theta_diff / THOUSAND * k_i
    duty = (integral + feedback) / max_voltage * HUNDRED
    sign = ONE if duty > ZERO else -ONE if duty < ZERO else ZERO
    duty = pwm_offset * sign + pwm_gain * duty
    duty = HUNDRED if duty > HUNDRED else -HUNDRED if duty < -HUNDRED else duty
    if duty != duty:  # NaN: no voltage and no error (0/0), or no voltage and no gain (inf·0)
        duty = ZERO

    after = (
        gyro_offset, theta_ref_dot, theta_ref_dot + sum_theta_ref_dot, psi_dot + sum_psi_dot,
        theta_diff + sum_theta_diff, theta_smooth,
    )  # fmt: skip
    estimates = theta, psi, theta_dot, psi_dot, theta_ref, theta_diff, psi_diff
    return after, estimates, duty


def in_control(theta_diff: Single, psi_diff: Single, theta_thr: Single, psi_thr: Single) -> bool:
    """Return whether both errors [deg] are below the out-of-control thresholds."""
    return bool(abs(theta_diff) < theta_thr and abs(psi_diff) < psi_thr)


class PlaneValues(NamedTuple):
    """The controller of one plane; both planes are alike.

    Attributes
    ----------
    gyro_offset : Single
        Estimate of the gyro's reading at rest [deg/s].
    theta_ref_dot : Single
        Rate of the reference [deg/s].
    sum_theta_ref_dot, sum_psi_dot, sum_theta_diff : Single
        Sums behind the forward Euler integrals.
    theta_smooth : Single
        Low-passed ball angle [deg], whose change in a period gives theta_dot.
    theta, psi, theta_dot, psi_dot : Single
        Estimated ball angle and body pitch [deg] and their rates [deg/s].
    theta_ref : Single
        Reference of the ball angle [deg].
    theta_diff, psi_diff : Single
        Reference minus estimate [deg].
    """

    gyro_offset: Single
    theta_ref_dot: Single
    sum_theta_ref_dot: Single
    sum_psi_dot: Single
    sum_theta_diff: Single
    theta_smooth: Single
    theta: Single
    psi: Single
    theta_dot: Single
    psi_dot: Single
    theta_ref: Single
    theta_diff: Single
    psi_diff: Single
