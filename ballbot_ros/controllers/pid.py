"""A cascade of two PID controllers: the ball's position demands a pitch, the pitch a voltage."""

from __future__ import annotations

from dataclasses import dataclass

from ballbot_ros.controllers.controller import MAX_DUTY, Readings
from ballbot_ros.controllers.driving import (
    DrivingController,
    PlaneController,
    PlaneInputs,
    SpeedReference,
)
from ballbot_ros.controllers.interface import Estimates
from ballbot_ros.parameters import ControllerParameters, TakesEffect, quantity
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.robot.plant.model import PhysicalParameters


def gain(default: float, unit: str, description: str) -> float:
    """Declare a gain, which can be changed during a run."""
    return quantity(
        default,
        unit,
        (0.0, 1e6),
        description,
        'project',
        takes_effect=TakesEffect.IMMEDIATELY,
    )


@dataclass(frozen=True)
class PIDParameters:
    """Gains of both controllers, and time constants of the estimates."""

    reference_time: float = quantity(
        0.3, 's', (0.0, 60.0), 'time constant of each of two low passes of the speed', 'project'
    )
    pitch_p: float = gain(1.6, 'V/deg', 'voltage for a pitch error')
    pitch_d: float = gain(0.2, 'V·s/deg', 'voltage for a pitch rate')
    position_p: float = gain(0.012, '1', 'pitch for an error of the ball angle')
    position_i: float = gain(0.004, '1/s', 'pitch for its integral')
    position_d: float = gain(0.01, 's', 'pitch for an error of the ball rate')
    back_emf: float = gain(0.0111, 'V·s/deg', 'voltage that keeps the ball rolling, per ball rate')
    rate_time: float = quantity(
        0.02, 's', (0.0, 10.0), 'time constant of the low pass of the ball rate', 'project'
    )
    drift_time: float = quantity(
        6.0, 's', (0.1, 1e6), 'time constant at which the gyro offset is corrected', 'project'
    )


class PID(DrivingController[PIDParameters]):
    """Two PID controllers in a cascade, for each plane.

    The outer one leans the body against an error of the ball's angle (P), its integral (I) and its
    rate (D). The inner one drives the ball under the body: P on the pitch error, D on its rate.
    """

    def make_plane(self) -> PlaneController:
        """Return the controller of a plane, at rest."""
        return Cascade(self.parameters, self.model)


class Cascade:
    """Both controllers and the estimates of a plane."""

    def __init__(self, parameters: PIDParameters, model: PhysicalParameters) -> None:
        self._p = parameters
        self._wheel_per_ball = 1.0 / model.ratio
        self._reference = SpeedReference(self._p.reference_time)
        self._offset_error = 0.0
        self._rate = 0.0
        self._integral = 0.0
        self.estimates = Estimates(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def duty(self, readings: Readings, inputs: PlaneInputs) -> int:
        """Return the duty [%]."""
        p = self._p
        self._reference.update(inputs.speed)
        self._estimate(inputs.rate, inputs.revolution)
        now = self.estimates

        error = now.theta_ref - now.theta
        pitch = (
            p.position_p * error
            + p.position_i * self._integral
            + p.position_d * (now.theta_ref_dot - now.theta_dot)
        )
        voltage = (
            p.pitch_p * (now.psi - pitch) + p.pitch_d * now.psi_dot + p.back_emf * now.theta_dot
        )
        duty = readings.duty(voltage)
        if abs(duty) < MAX_DUTY:  # else the integral would wind up
            self._integral += TICK_S * error
        return duty

    def retune(self, parameters: PIDParameters, _: ControllerParameters) -> None:
        """Use other gains."""
        self._p = parameters

    def _estimate(self, rate: float, revolution: int) -> None:
        """Update the estimates from the gyro and the encoder."""
        p, now = self._p, self.estimates
        # A robot that does not fall has a mean pitch of 0: what remains is the gyro's drift.
        self._offset_error += TICK_S / (p.drift_time * p.drift_time) * now.psi
        # The mean of two readings: the motors answer within a tick, so that a strong reaction to
        # single readings would make them shiver from tick to tick.
        now.psi_dot = (rate + self._rate) / 2.0 - self._offset_error
        self._rate = rate
        now.psi += TICK_S * (now.psi_dot - 2.0 / p.drift_time * now.psi)

        theta = self._wheel_per_ball * revolution + now.psi
        change = (theta - now.theta) / TICK_S - now.theta_dot
        now.theta_dot += TICK_S / (TICK_S + p.rate_time) * change
        now.theta = theta
        now.theta_ref, now.theta_ref_dot = self._reference.theta, self._reference.theta_dot
