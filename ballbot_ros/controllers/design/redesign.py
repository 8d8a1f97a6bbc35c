"""A design of gains for a robot, as `ballbot design --method` and the studies make it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

from ballbot_ros.parameters import CONTROLLER, MAX_DELAY_MS, PLANT, ParameterSet, PlantParameters
from ballbot_ros.parameters.controller import MODEL
from ballbot_ros.parameters.parameter import TextEnum
from ballbot_ros.robot.plant.model import PhysicalParameters

SIGNALS = 5
"""What the gains multiply: theta, psi, their rates, the integral of theta."""

_LQG_SCALES = (
    'user.theta_scale', 'user.psi_scale', 'user.theta_dot_scale', 'user.psi_dot_scale',
    'user.integral_scale',
)  # fmt: skip


class Method(TextEnum):
    """How gains are designed."""

    LQR = 'lqr'
    DLQR = 'dlqr'
    PLACE = 'place'
    LQG = 'lqg'


OPTIONS = {
    Method.LQR: ('q', 'r'),
    Method.DLQR: ('q', 'r', 'delay'),
    Method.PLACE: ('poles', 'delay'),
    Method.LQG: ('q', 'r', 'delay'),
}
"""The options that each method takes."""


class Limit(NamedTuple):
    """What a number must be, in words and as a function."""

    wanted: str
    is_allowed: Callable[[float], bool]


def _is_weight(value: float) -> bool:
    # Solvers lose all digits with weights such as 1e300.
    return 1e-20 <= value <= 1e20


LIMITS = {
    'q': Limit('0 or within 1e-20 … 1e20', lambda value: value == 0.0 or _is_weight(value)),
    'r': Limit('within 1e-20 … 1e20', _is_weight),
    'delay': Limit(f'within 0 … {MAX_DELAY_MS:g} ms', lambda value: 0.0 <= value <= MAX_DELAY_MS),
}
"""Of the options that are numbers, or five numbers."""


@dataclass(frozen=True)
class Redesign:
    """A design of gains: the method, and its options; None for those that were not given.

    Attributes
    ----------
    q : tuple of float, optional
        Weights of theta and psi [1/deg²], their rates [s²/deg²] and the integral of theta
        [1/(deg² s²)].
    r : float, optional
        Weight of the motor voltage [1/V²].
    poles : tuple of complex, optional
        Poles of the closed loop [1/s].
    delay : float, optional
        Dead time of the motors to design for [ms], instead of the mean one of the plant.
    """

    method: Method
    q: tuple[float, ...] | None = None
    r: float | None = None
    poles: tuple[complex, ...] | None = None
    delay: float | None = None

    def apply(self, parameters: ParameterSet) -> None:
        """Set the designed gains; BallbotError if there are none."""
        # Imported only here: python-control takes two seconds.
        from ballbot_ros.controllers.design.gain_design import GainDesign, set_gains
        from ballbot_ros.controllers.design.linear_model import Q_DIAGONAL, R_WEIGHT, design_servo
        from ballbot_ros.controllers.design.sampled_loop import (
            LoopDelays,
            require_documents_program,
        )

        delays = LoopDelays.of(parameters)
        if self.delay is not None:
            delays = replace(delays, actuator=self.delay)
        if self.method is Method.LQG:
            self._prepare_lqg(parameters, delays.actuator)
            return
        require_documents_program(parameters)
        q, r = self.q or Q_DIAGONAL, self.r or R_WEIGHT
        physical = PhysicalParameters.from_parameters(parameters.of(PlantParameters))
        if self.method is Method.LQR:
            set_gains(parameters, design_servo(physical, q, r).gain.tolist())
            return
        design = GainDesign(parameters, delays)
        if self.poles is not None:
            set_gains(parameters, design.with_poles(self.poles))
        else:
            set_gains(parameters, design.regulator(q, r))

    def _prepare_lqg(self, parameters: ParameterSet, delay_ms: float) -> None:
        """Choose the controller lqg, with the robot and the dead time to design for.

        It weighs each deviation relative to a scale.
        """
        for each in fields(PhysicalParameters):
            own = f'{MODEL}{each.name}'
            if parameters.is_set(PLANT, each.name) and own not in parameters.undeclared:
                value = getattr(parameters.of(PlantParameters), each.name)
                parameters.set(CONTROLLER, own, value, '--method')
        parameters.set(CONTROLLER, 'implementation', 'lqg', '--method')
        for name, weight in zip(_LQG_SCALES, self.q or (), strict=False):
            parameters.set(CONTROLLER, name, weight**-0.5, '--q')
        if self.r is not None:
            parameters.set(CONTROLLER, 'user.voltage_scale', self.r**-0.5, '--r')
        if self.delay is not None or 'user.actuator_delay' not in parameters.undeclared:
            parameters.set(CONTROLLER, 'user.actuator_delay', delay_ms, '--delay')
