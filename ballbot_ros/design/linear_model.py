"""The linear model of one plane, and the ideal loop around it, as systems of python-control."""

from __future__ import annotations

import control
import numpy as np

from ballbot_ros.parameters import ControllerParameters, ParameterSet, PlantParameters
from ballbot_ros.plant.model import PhysicalParameters, state_space

STATES = ('theta', 'psi', 'theta_dot', 'psi_dot')

_DEGREES_PER_RADIAN = 180.0 / np.pi


def plane_model(p: PhysicalParameters) -> control.StateSpace:
    """Return (3.24) of one plane: motor voltage `v` [V] to its states [rad, rad/s]."""
    a, b = state_space(p)
    return control.ss(
        a, b[:, :1], np.eye(4), 0.0, inputs=['v'], outputs=STATES, states=STATES, name='plane'
    )


def ideal_loop(parameters: ParameterSet) -> control.StateSpace:
    """Return the loop of section 4.2, opened at the motor voltage: `v` to `v_fb` [V].

    State feedback in continuous time with the gains in use: ``k_f`` on the states, ``k_i`` on the
    integral of theta, both times ``pwm_gain``. Without ``k_i`` there is no integral.
    """
    own = parameters.of(ControllerParameters)
    a, b = state_space(PhysicalParameters.from_parameters(parameters.of(PlantParameters)))
    a_bar = np.zeros((5, 5))
    a_bar[:4, :4] = a
    a_bar[4, 0] = 1.0
    b_bar = np.vstack([b[:, :1], [[0.0]]])
    c = own.pwm_gain * np.array([[*own.k_f, own.k_i]]) * _DEGREES_PER_RADIAN
    states = (*STATES, 'theta_integral')
    n = 5 if own.k_i else 4
    return control.ss(
        a_bar[:n, :n], b_bar[:n], c[:, :n], 0.0,
        inputs=['v'], outputs=['v_fb'], states=states[:n], name='loop',
    )  # fmt: skip
