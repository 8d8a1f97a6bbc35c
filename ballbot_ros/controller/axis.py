"""The balance and drive controller of one plane (section 7.4), in single precision.

Every operation is one IEEE single-precision operation, in the order of the generated code:
addition is not associative, and the duties must come out the same to the bit.
"""

from __future__ import annotations

from ballbot_ros.controller.parameters import ControllerParameters, Single
from ballbot_ros.controller.tasks import TS1_MS

ZERO, ONE, HUNDRED, THOUSAND = Single(0), Single(1), Single(100), Single(1000)
TS1 = Single(TS1_MS)


class Axis:
    """State and law of one plane; both planes are alike.

    Attributes
    ----------
    gyro_offset : Single
        Estimate of the gyro's reading at rest [deg/s].
    theta, psi, theta_dot, psi_dot : Single
        Estimated ball angle and body pitch [deg] and their rates [deg/s].
    theta_ref, theta_ref_dot : Single
        Reference of the ball angle.
    theta_diff, psi_diff : Single
        Reference less estimate [deg].
    sum_theta_ref_dot, sum_psi_dot, sum_theta_diff : Single
        Sums behind the forward Euler integrals.
    theta_smooth : Single
        Low-passed ball angle, whose difference is the rate.
    """

    def __init__(self, parameters: ControllerParameters) -> None:
        p = self._p = parameters
        self._wheel_per_ball = p.wheel_radius / p.ball_radius
        self._complement_r = ONE - p.a_r
        self._complement_d = ONE - p.a_d
        self._complement_gd = ONE - p.a_gd
        self._complement_gc = ONE - p.a_gc
        self._gp_max = Single(p.gp_max)
        self.reset()

    def reset(self) -> None:
        """Set every variable to its initial value."""
        self.gyro_offset = ZERO
        self.theta = self.psi = self.theta_dot = self.psi_dot = ZERO
        self.theta_ref = self.theta_ref_dot = ZERO
        self.theta_diff = self.psi_diff = ZERO
        self.sum_theta_ref_dot = self.sum_psi_dot = self.sum_theta_diff = ZERO
        self.theta_smooth = ZERO

    def calibrate(self, gyro: int) -> None:
        """Move the offset estimate towards a reading at rest."""
        self.gyro_offset = Single(gyro) * self._complement_gc + self._p.a_gc * self.gyro_offset

    def control(self, gyro: int, revolution: int, stick: int, max_voltage: Single) -> int:
        """Return the duty [%], -100 ... 100, truncated toward zero.

        Parameters
        ----------
        gyro, revolution : int
            Gyro reading [deg/s + offset] and motor angle [deg].
        stick : int
            Speed command, -gp_max ... gp_max.
        max_voltage : Single
            Motor voltage at full duty [V].
        """
        p = self._p

        theta_ref = TS1 * self.sum_theta_ref_dot / THOUSAND
        theta_ref_dot = (
            Single(stick) / self._gp_max * p.k_thetadot * self._complement_r
            + self.theta_ref_dot * p.a_r
        )

        psi = TS1 * self.sum_psi_dot / THOUSAND
        theta = self._wheel_per_ball * Single(revolution) + psi
        theta_smooth = theta * self._complement_d + self.theta_smooth * p.a_d
        reading = Single(gyro)
        gyro_offset = reading * self._complement_gd + p.a_gd * self.gyro_offset
        psi_dot = reading - gyro_offset
        theta_dot = (theta_smooth - self.theta_smooth) * THOUSAND / TS1

        theta_diff = theta_ref - theta
        psi_diff = ZERO - psi
        k_theta, k_psi, k_theta_dot, k_psi_dot = p.k_f
        feedback = ZERO + k_theta * theta_diff
        feedback = feedback + k_psi * psi_diff
        feedback = feedback + k_theta_dot * (theta_ref_dot - theta_dot)
        feedback = feedback + k_psi_dot * (ZERO - psi_dot)
        integral = TS1 * self.sum_theta_diff / THOUSAND * p.k_i
        duty = (integral + feedback) / max_voltage * HUNDRED
        sign = ONE if duty > ZERO else -ONE if duty < ZERO else ZERO
        duty = p.pwm_offset * sign + p.pwm_gain * duty
        duty = HUNDRED if duty > HUNDRED else -HUNDRED if duty < -HUNDRED else duty
        if duty != duty:  # no voltage and no error (0/0), or no voltage and no gain (inf·0)
            duty = ZERO

        self.sum_theta_ref_dot = theta_ref_dot + self.sum_theta_ref_dot
        self.sum_psi_dot = psi_dot + self.sum_psi_dot
        self.sum_theta_diff = theta_diff + self.sum_theta_diff
        self.theta_smooth = theta_smooth
        self.gyro_offset = gyro_offset
        self.theta, self.psi, self.theta_dot, self.psi_dot = theta, psi, theta_dot, psi_dot
        self.theta_ref, self.theta_ref_dot = theta_ref, theta_ref_dot
        self.theta_diff, self.psi_diff = theta_diff, psi_diff
        return int(duty)

    def in_control(self) -> bool:
        """Tell whether both errors are below the out-of-control thresholds."""
        p = self._p
        return bool(abs(self.theta_diff) < p.theta_diff_thr and abs(self.psi_diff) < p.psi_diff_thr)
