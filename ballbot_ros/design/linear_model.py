"""The linear model of one plane, and the ideal loop around it, as systems of python-control."""

from __future__ import annotations

from collections.abc import Sequence

import control
import numpy as np

from ballbot_ros.plant.model import PhysicalParameters, state_space

STATES = ('theta', 'psi', 'theta_dot', 'psi_dot')

_DEGREES_PER_RADIAN = 180.0 / np.pi


def plane_model(p: PhysicalParameters) -> control.StateSpace:
    """Return (3.24) of one plane: motor voltage `v` [V] to its states [rad, rad/s]."""
    a, b = state_space(p)
    return control.ss(
        a, b[:, :1], np.eye(4), 0.0, inputs=['v'], outputs=STATES, states=STATES, name='plane'
    )


def ideal_loop(p: PhysicalParameters, gain: Sequence[float]) -> control.StateSpace:
    """Return the loop of section 4.2, opened at the motor voltage: `v` to `v_fb` [V].

    Parameters
    ----------
    gain : sequence of float, shape (5,)
        k_f for theta, psi [V/deg], theta_dot, psi_dot [V·s/deg], then k_i [V/(deg·s)], in the
        document's signs: the feedback subtracts their product with the states.
    """
    a, b = state_space(p)
    a_bar = np.zeros((5, 5))
    a_bar[:4, :4] = a
    a_bar[4, 0] = 1.0
    b_bar = np.vstack([b[:, :1], [[0.0]]])
    c = np.reshape(gain, (1, 5)) * _DEGREES_PER_RADIAN
    states = (*STATES, 'theta_integral')
    return control.ss(
        a_bar, b_bar, c, 0.0, inputs=['v'], outputs=['v_fb'], states=states, name='loop'
    )
