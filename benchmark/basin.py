"""Basin of attraction: the pitches and pitch rates from which the robot recovers.

A run begins like any other. The robot is held until the calibration has ended; then its plane x is
set to a pitch and a pitch rate, with the ball at rest. The plant is nonlinear, devices and program
are those of the NXT. What the program knows about the pitch at that moment makes a difference: it
integrates the pitch from the gyro, and begins with 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.controllers.document.constants import Single
from ballbot_ros.controllers.document.program import ControlProgram
from ballbot_ros.design.recoverable import RecoverableStates
from ballbot_ros.parameters import PLANT, ControllerParameters, ParameterSet
from ballbot_ros.simulation.closed_loop import ClosedLoop
from ballbot_ros.timing import TICK_S

Floats = NDArray[np.float64]

RECOVERY_S = 10.0
"""Time after which a robot that has not fallen has recovered [s]."""

PITCH_DEG, RATE_DEG_S = 18.0, 80.0
"""Largest pitch and pitch rate of the map, in both directions."""


class Estimate(Enum):
    """What the program takes the pitch for: 0 as at the start of a run, or what it is."""

    ZERO = 'pitch taken for 0'
    TRUE = 'pitch known'


class Start(NamedTuple):
    """A state of plane x, and whether the robot recovers from it.

    Attributes
    ----------
    pitch_deg, rate_deg_s : float
        Pitch and pitch rate; the ball is at rest.
    share : float
        Share of what any controller could recover; more than 1 is beyond the motors.
    from_zero, from_true : bool
        Whether it recovers if the program takes the pitch for zero, and if it knows it.
    """

    pitch_deg: float
    rate_deg_s: float
    share: float
    from_zero: bool
    from_true: bool

    def recovers(self, estimate: Estimate) -> bool:
        """Return whether the robot recovers with this estimate."""
        return self.from_zero if estimate is Estimate.ZERO else self.from_true


def starts(
    parameters: ParameterSet, limit: RecoverableStates, pitches: int, rates: int
) -> Iterator[Start]:
    """Yield the starts of a map with so many pitches and rates, the lowest rate first."""
    for rate in np.linspace(-RATE_DEG_S, RATE_DEG_S, rates).tolist():
        for pitch in np.linspace(-PITCH_DEG, PITCH_DEG, pitches).tolist():
            yield Start(
                pitch,
                rate,
                float(limit.share(np.radians([0.0, pitch, 0.0, rate]))),
                *(recovers(parameters, pitch, rate, estimate) for estimate in Estimate),
            )


def recovers(
    parameters: ParameterSet, pitch_deg: float, rate_deg_s: float, estimate: Estimate
) -> bool:
    """Return whether the robot still stands some time after it was set to a pitch and a rate."""
    values = ParameterSet()
    values.update(parameters)
    values.set(PLANT, 'plant_model', 'nonlinear')
    pitch, rate = math.radians(pitch_deg), math.radians(rate_deg_s)
    # The motor angles count from the pitch at the start, so that the program sees none of it.
    values.set(PLANT, 'start_pitch_x', pitch if estimate is Estimate.ZERO else 0.0)
    hold_s = parameters.of(ControllerParameters).time_start * 1e-3 + TICK_S
    values.set(PLANT, 'hold_time', hold_s)
    loop = ClosedLoop(values)
    program = loop.program
    assert isinstance(program, ControlProgram)
    for _ in loop.ticks(hold_s):
        pass
    loop.plant.state = loop.plant.state._replace(x=(0.0, pitch, 0.0, rate))
    if estimate is Estimate.TRUE:
        x = program.x._replace(sum_psi_dot=Single(pitch_deg / TICK_S))
        program.state = program.state._replace(x=x[:6])
    return not any(loop.plant.fallen for _ in loop.ticks(RECOVERY_S))
