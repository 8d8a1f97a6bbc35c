"""Equations of motion of one plane: the spherical wheeled inverted pendulum (section 3).

The state of a plane is (theta, psi, theta_dot, psi_dot) in rad and rad/s: ball angle and body
pitch. The input is the motor voltage v. Arguments are SI throughout.

The functions use attributes of their argument only, so that it can be the row of a table of robots.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.parameters import Subset
from ballbot_ros.robot.arithmetic import sine_cosine

Matrix = NDArray[np.float64]


def _ball_inertia(p: Bodies) -> float:
    """Js = 2 Ms Rs²/3 [kg·m²], a hollow sphere."""
    return 2.0 * p.ball_mass * p.ball_radius * p.ball_radius / 3.0


def _wheel_inertia(p: Bodies) -> float:
    """Jw = Mw Lw²/2 [kg·m²], the document's formula."""
    return p.wheel_mass * p.wheel_width * p.wheel_width / 2.0


def _body_inertia(p: Bodies) -> float:
    """Jpsi = Mb L²/3 [kg·m²]."""
    return p.body_mass * p.body_height * p.body_height / 3.0


def gear_ratio(p: Bodies) -> float:
    """Gear ratio k = Rs/Rw from ball to motor (no slip)."""
    return p.ball_radius / p.wheel_radius


def _drive_inertia(p: PhysicalParameters) -> float:
    """k² (Jm + Jw) [kg·m²], motor and wheel seen from the ball."""
    ratio = gear_ratio(p)
    return ratio * ratio * (p.motor_inertia + _wheel_inertia(p))


def torque_per_volt(p: PhysicalParameters) -> float:
    """Kt/Rm [N·m/V] (3.19). The document has no factor k here, and its gains depend on that."""
    return p.torque_constant / p.motor_resistance


def drive_friction(p: PhysicalParameters) -> float:
    """k (Kt Kb/Rm + fm) [N·m·s/rad] (3.19)."""
    return gear_ratio(p) * (
        p.torque_constant * p.back_emf_constant / p.motor_resistance + p.motor_friction
    )


@dataclass(frozen=True)
class Bodies(Subset):
    """Ball, wheels and body of section 3.1, named as in `parameters.TABLE`."""

    ball_mass: float
    ball_radius: float
    wheel_mass: float
    wheel_radius: float
    wheel_width: float
    body_mass: float
    body_height: float

    ball_inertia = property(_ball_inertia)
    wheel_inertia = property(_wheel_inertia)
    body_inertia = property(_body_inertia)


@dataclass(frozen=True)
class PhysicalParameters(Bodies):
    """The bodies, their drive and their friction: all of section 3.1."""

    gravity: float
    motor_inertia: float
    motor_resistance: float
    back_emf_constant: float
    torque_constant: float
    motor_friction: float
    ball_friction: float

    ratio = property(gear_ratio)
    drive_inertia = property(_drive_inertia)
    alpha = property(torque_per_volt)
    beta = property(drive_friction)


class MassMatrix(NamedTuple):
    """Mass matrix [kg·m²] of (3.11)-(3.12) at a pitch psi.

    ``[[m11, m12], [m12, m22]]`` with ``m12 = coupling cos(psi) - drive``. Its determinant is
    computed as ``det + cos(psi) (det_1 - det_2 cos(psi))``, with det at least a third larger than
    det_2, because the difference m11 m22 - m12² would lose all digits where the drive's inertia
    dominates.
    """

    m11: float
    m22: float
    coupling: float
    drive: float
    det: float
    det_1: float
    det_2: float


def mass_matrix(p: PhysicalParameters) -> MassMatrix:
    """Return the mass matrix of a plane."""
    arm = p.body_mass * p.body_height
    coupling = arm * p.ball_radius
    drive = _drive_inertia(p)
    rolling = (p.body_mass + p.ball_mass) * p.ball_radius * p.ball_radius + _ball_inertia(p)
    tilting = arm * p.body_height + _body_inertia(p)
    return MassMatrix(
        m11=rolling + drive,
        m22=tilting + drive,
        coupling=coupling,
        drive=drive,
        det=tilting * rolling + drive * (rolling + tilting),
        det_1=2.0 * drive * coupling,
        det_2=coupling * coupling,
    )


def state_space(p: PhysicalParameters) -> tuple[Matrix, Matrix]:
    """Return A (4, 4) and B (4, 3) of the linear state equation (3.24), angles in rad.

    The columns of B belong to the motor voltage [V] and to generalised forces on theta and psi
    [N·m]. The document has no such forces; its B is the first column.
    """
    m = mass_matrix(p)
    upright = m.det + (m.det_1 - m.det_2)  # the determinant of the mass matrix
    # The inverse of the mass matrix.
    i11, i22 = m.m22 / upright, m.m11 / upright
    i12 = (m.drive - m.coupling) / upright
    weight = p.body_mass * p.body_height * p.gravity
    alpha, beta = torque_per_volt(p), drive_friction(p)
    friction = beta + p.ball_friction
    a = np.array(
        [
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [0.0, i12 * weight, i12 * beta - i11 * friction, (i11 - i12) * beta],
            [0.0, i22 * weight, i22 * beta - i12 * friction, (i12 - i22) * beta],
        ]
    )
    b = np.array(
        [
            [0.0, 0.0, 0.0],
            [0.0, 0.0, 0.0],
            [(i11 - i12) * alpha, i11, i12],
            [(i12 - i22) * alpha, i12, i22],
        ]
    )
    return a, b


def impulse_ratio(m: MassMatrix, psi: float) -> float:
    """Return m12/m22 of the mass matrix of (3.11)-(3.12) at a pitch; 0 gives the linear model's.

    An impulse on theta alone changes psi_dot by minus this ratio times the change of theta_dot.
    """
    _, cosine = sine_cosine(psi)
    return (m.coupling * cosine - m.drive) / m.m22
