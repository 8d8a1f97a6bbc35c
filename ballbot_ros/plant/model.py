"""Equations of motion of one plane: the spherical wheeled inverted pendulum (section 3).

The state of a plane is (theta, psi, theta_dot, psi_dot) in rad and rad/s: ball angle and body
pitch. The input is the motor voltage v. Arguments are SI throughout.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class Bodies:
    """Ball, wheels and body of section 3.1, named as in :data:`ballbot_ros.parameters.TABLE`."""

    ball_mass: float
    ball_radius: float
    wheel_mass: float
    wheel_radius: float
    wheel_width: float
    body_mass: float
    body_height: float

    @property
    def ball_inertia(self) -> float:
        """Js = 2 Ms Rs²/3 [kg·m²], a hollow sphere."""
        return 2.0 * self.ball_mass * self.ball_radius**2 / 3.0

    @property
    def wheel_inertia(self) -> float:
        """Jw = Mw Lw²/2 [kg·m²], the document's formula."""
        return self.wheel_mass * self.wheel_width**2 / 2.0

    @property
    def body_inertia(self) -> float:
        """Jpsi = Mb L²/3 [kg·m²]."""
        return self.body_mass * self.body_height**2 / 3.0


@dataclass(frozen=True)
class PhysicalParameters(Bodies):
    """The bodies, what drives them and what slows them: all of section 3.1."""

    gravity: float
    motor_inertia: float
    motor_resistance: float
    back_emf_constant: float
    torque_constant: float
    motor_friction: float
    ball_friction: float

    @property
    def ratio(self) -> float:
        """Gear ratio k = Rs/Rw from ball to motor (no slip)."""
        return self.ball_radius / self.wheel_radius

    @property
    def drive_inertia(self) -> float:
        """k² (Jm + Jw) [kg·m²], motor and wheel seen from the ball."""
        return self.ratio**2 * (self.motor_inertia + self.wheel_inertia)

    @property
    def alpha(self) -> float:
        """Kt/Rm [N·m/V] (3.19). The document has no k here; its gains need it so."""
        return self.torque_constant / self.motor_resistance

    @property
    def beta(self) -> float:
        """k (Kt Kb/Rm + fm) [N·m·s/rad] (3.19)."""
        return self.ratio * (
            self.torque_constant * self.back_emf_constant / self.motor_resistance
            + self.motor_friction
        )


def linear_matrices(p: PhysicalParameters) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Return E, F, G (2, 2) and H (2, 1) of the linearised equations (3.22).

    ``E (theta'', psi'') + F (theta', psi') + G (theta, psi) = H v``, angles in rad.
    """
    arm = p.body_mass * p.body_height
    coupling = arm * p.ball_radius - p.drive_inertia
    e = np.array(
        [
            [
                (p.body_mass + p.ball_mass) * p.ball_radius**2 + p.ball_inertia + p.drive_inertia,
                coupling,
            ],
            [coupling, arm * p.body_height + p.body_inertia + p.drive_inertia],
        ]
    )
    f = np.array([[p.beta + p.ball_friction, -p.beta], [-p.beta, p.beta]])
    g = np.array([[0.0, 0.0], [0.0, -arm * p.gravity]])
    h = np.array([[p.alpha], [-p.alpha]])
    return e, f, g, h


def state_space(p: PhysicalParameters) -> tuple[Matrix, Matrix]:
    """Return A (4, 4) and B (4, 3) of the linear state equation (3.24), angles in rad.

    The columns of B belong to the motor voltage [V] and to generalised forces on theta and psi
    [N·m], which the document does not have; its own B is the first column.
    """
    e, f, g, h = linear_matrices(p)
    inverse = np.linalg.inv(e)
    a = np.zeros((4, 4))
    a[:2, 2:] = np.eye(2)
    a[2:, :2] = -inverse @ g
    a[2:, 2:] = -inverse @ f
    b = np.zeros((4, 3))
    b[2:, :1] = inverse @ h
    b[2:, 1:] = inverse
    return a, b


def impulse_ratio(p: PhysicalParameters, psi: float) -> float:
    """Return m12/m22 of the mass matrix of (3.11)-(3.12) at the pitch `psi`; the linear one's at 0.

    An impulse on theta alone changes psi_dot by minus this ratio times the change of theta_dot.
    """
    arm = p.body_mass * p.body_height
    m12 = arm * p.ball_radius * math.cos(psi) - p.drive_inertia
    return m12 / (arm * p.body_height + p.body_inertia + p.drive_inertia)


def energy(p: PhysicalParameters, state: tuple[float, float, float, float]) -> float:
    """Return the mechanical energy T1 + T2 + U [J] of one plane, (3.5)-(3.7).

    The height of the ball's centre is the zero of the potential.
    """
    _, psi, theta_dot, psi_dot = state
    arm = p.body_mass * p.body_height
    ball = (p.body_mass + p.ball_mass) * p.ball_radius**2 + p.ball_inertia
    body = arm * p.body_height + p.body_inertia
    return (
        0.5 * ball * theta_dot**2
        + arm * p.ball_radius * math.cos(psi) * theta_dot * psi_dot
        + 0.5 * body * psi_dot**2
        + 0.5 * p.drive_inertia * (theta_dot - psi_dot) ** 2
        + arm * p.gravity * math.cos(psi)
    )
