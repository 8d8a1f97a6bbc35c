"""The loop of one plane as it runs: sampled, filtered and delayed.

A linear model from tick to tick of the document's program near the upright position: motor
voltages held between duties, samples of gyro and encoder, both low passes, the integrals in the
listing's order, and all dead times. It leaves out what is not linear: rounding, limits, dead zone,
gear play, `pwm_offset` and a sagging battery. Dead times with jitter count as constant, with their
mean.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from itertools import pairwise
from typing import cast

import control
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm

from ballbot_ros.controllers.design.linear_model import STATES, DesignError
from ballbot_ros.controllers.document import axis
from ballbot_ros.controllers.document.axis import ProgramConstants, Single
from ballbot_ros.controllers.document.program import max_motor_voltage, mean_delays
from ballbot_ros.controllers.loading import public_reference
from ballbot_ros.parameters import (
    CONTROLLER,
    DOCUMENTS_PROGRAM,
    GYRO,
    PLANT,
    ControllerParameters,
    EncoderParameters,
    GyroParameters,
    ParameterSet,
    PlantParameters,
)
from ballbot_ros.parameters.timing import STEPS_PER_TICK, TICK_MS
from ballbot_ros.robot.brick.sensors import battery_mv, mean_delay
from ballbot_ros.robot.compiler_hints import with_globals
from ballbot_ros.robot.plant.laws import max_voltage
from ballbot_ros.robot.plant.model import Matrix, PhysicalParameters, state_space

DUTY, GYRO_ERROR, ENCODER_ERROR, STICK, FORCE = INPUTS = (
    'duty', 'gyro_error', 'encoder_error', 'stick', 'force',
)  # fmt: skip
"""Applied duty [%]; errors of the samples of gyro [deg/s] and encoder [deg]; stick; horizontal
force at the body's centre [N]."""

_PROGRAM = (
    'gyro_offset', 'theta_ref_dot', 'sum_theta_ref_dot', 'sum_psi_dot', 'sum_theta_diff',
    'theta_smooth',
)  # fmt: skip
"""The variables of a plane that last, in the order of `PlaneValues` of the document's program."""

_FILTERS = ('a_d', 'a_gd', 'a_r')
"""Shares of the old value in the program's low passes, each tick."""

_REFERENCE = ('theta_ref_dot', 'sum_theta_ref_dot')
"""Those outside the loop: they depend on the stick alone."""

_UNIT = 2.0**-64
"""Length of the unit vectors by which the law is linearised: too small to saturate the duty, and a
power of two, which changes no digit."""

_DEGREES = 180.0 / math.pi


PARAMETERS = frozenset(
    f'{node}.{name}'
    for node, names in (
        (PLANT, (each.name for each in fields(PhysicalParameters))),
        (PLANT, ('battery_voltage', 'voltage_slope', 'voltage_offset')),
        (PLANT, ('actuator_delay', 'actuator_delay_jitter')),
        (GYRO, ('delay', 'delay_jitter')),
        (EncoderParameters.node, ('delay', 'delay_jitter')),
        (CONTROLLER, ('k_f', 'k_i', 'pwm_gain', 'a_d', 'a_gd')),
    )
    for name in names
)
"""Parameters that have an effect on :class:`SampledLoop`."""


@dataclass(frozen=True)
class LoopDelays:
    """The dead times of a loop [ms]: until a duty takes effect, and the ages of the samples."""

    actuator: float = 0.0
    gyro: float = 0.0
    encoder: float = 0.0

    @classmethod
    def of(cls, parameters: ParameterSet) -> LoopDelays:
        """Return the mean dead times of plant, drivers, and the brick with its link."""
        plant = parameters.of(PlantParameters)
        gyro, encoder = parameters.of(GyroParameters), parameters.of(EncoderParameters)
        pairs = (
            (plant.actuator_delay, plant.actuator_delay_jitter),
            (gyro.delay, gyro.delay_jitter),
            (encoder.delay, encoder.delay_jitter),
        )
        actuator, of_gyro, of_encoder = (mean_delay(*pair, STEPS_PER_TICK) for pair in pairs)
        gyro_age, duty_delay = mean_delays(parameters.of(ControllerParameters))
        return cls(actuator + duty_delay, of_gyro + gyro_age, of_encoder)


def require_documents_program(parameters: ParameterSet) -> None:
    """Raise DesignError if the controller is another than the document's program."""
    implementation = parameters.of(ControllerParameters).implementation
    if implementation not in DOCUMENTS_PROGRAM:
        raise DesignError(
            "the loop as it runs is known for the document's program only "
            f'({", ".join(DOCUMENTS_PROGRAM)}), not for {public_reference(implementation)}'
        )


class SampledLoop:
    """The loop of one plane from tick to tick, opened at the duty.

    From one tick to the next, ``x[k+1] = a x[k] + b u[k]``; the duty that the program computes at
    the tick is ``c x[k] + d u[k]`` [%]. Positive feedback of it to the first input closes the loop.
    It raises DesignError if the controller is another than the document's program.

    Parameters
    ----------
    parameters : ParameterSet
        Those of the plant, the drivers and the document's program.
    delays : LoopDelays, optional
        Instead of the dead times in `parameters`.
    period_ms : float
        Period of task_ts1. The simulation has that of the document only. With another one the
        gains are the same, and so are the time constants of the filters.

    Attributes
    ----------
    states : tuple of str
        Those of the plane [rad, rad/s], of the program, and samples and duties on their way.
    a, b, c, d : ndarray, shape (n, n), (n, 5), (n,) and (5,)
        The matrices; the inputs are `INPUTS`.
    """

    def __init__(
        self, parameters: ParameterSet, delays: LoopDelays | None = None, period_ms: float = TICK_MS
    ) -> None:
        require_documents_program(parameters)
        self._plane = _Plane.of(parameters.of(PlantParameters))
        self._law, self._period_ms = _law(parameters, period_ms), period_ms
        self.period_s = period_ms * 1e-3
        self._set_delays(delays or LoopDelays.of(parameters))

    def with_delays(self, delays: LoopDelays) -> SampledLoop:
        """Return the same loop with other dead times."""
        loop = copy(self)
        loop._set_delays(delays)
        return loop

    def _set_delays(self, delays: LoopDelays) -> None:
        tick = _tick(self._plane, delays, self._period_ms)
        self.delays, self.states = delays, tick.states
        after = self._law @ tick.read
        transition = np.vstack([tick.plane_after, after[:-1], tick.queues_after])
        n = len(self.states)
        self.a, self.b = transition[:, :n], transition[:, n:]
        self.c, self.d = after[-1, :n], after[-1, n:]

    def closed(self) -> tuple[Matrix, Matrix]:
        """Return the matrices (n, n) and (n, 5) of the loop closed by the duty."""
        return self.a + self.b[:, :1] * self.c, self.b + self.b[:, :1] * self.d

    def poles(self, gain: ArrayLike = 1.0) -> NDArray[np.complex128]:
        """Return the poles of the loop closed by `gain` times the duty, in the z plane.

        For an array of gains (...), the poles have the shape (..., n).
        """
        _, a, b, c = self._feedback()
        feedback = np.asarray(gain)[..., None, None] * (b * c)
        return np.linalg.eigvals(a + feedback).astype(complex)

    def open_loop(self) -> control.StateSpace:
        """Return the loop opened at the duty, for negative feedback; its input is a duty [%]."""
        names, a, b, c = self._feedback()
        return control.ss(
            a, b, -c, 0.0, self.period_s,
            inputs=['duty'], outputs=['duty_fb'], states=list(names), name='sampled_loop',
        )  # fmt: skip

    def _feedback(self) -> tuple[tuple[str, ...], Matrix, Matrix, Matrix]:
        """Return the states that take part in the feedback, and a, b, c of the duty for them."""
        names, basis = self.feedback_states()
        inverse = basis.T / np.square(basis).sum(axis=0)[:, None]  # its columns are orthogonal
        return names, inverse @ self.a @ basis, inverse @ self.b[:, :1], self.c @ basis

    def duty_for(self, source: str) -> control.StateSpace:
        """Return the closed loop from one of `INPUTS` to the computed duty [%]."""
        names, basis = self.feedback_states()
        inverse = np.linalg.pinv(basis)
        a, b = self.closed()
        column = INPUTS.index(source)
        return control.ss(
            inverse @ a @ basis, inverse @ b[:, [column]], self.c @ basis, self.d[column],
            self.period_s, inputs=[source], outputs=['duty'], states=list(names),
            name='closed_sampled_loop',
        )  # fmt: skip

    def feedback_states(self) -> tuple[tuple[str, ...], Matrix]:
        """Return the states that take part in the feedback, and their columns in all states.

        The reference does not, nor an integral that is not used. The program's pitch is a sum of
        what passes the low pass of the offset, so ``(1 - a_gd) sum_psi_dot - a_gd gyro_offset``
        never changes: offset and sum are one state.
        """
        integral, offset = map(self.states.index, ('sum_theta_diff', 'gyro_offset'))
        return _feedback_states(self.states, bool(self.c[integral]), float(self.a[offset, offset]))


@lru_cache(maxsize=256)
def _feedback_states(
    states: tuple[str, ...], is_integrating: bool, a_gd: float
) -> tuple[tuple[str, ...], Matrix]:
    kept = [name for name in states if name not in (*_REFERENCE, 'sum_psi_dot')]
    if not is_integrating:
        kept.remove('sum_theta_diff')
    basis = np.eye(len(states))[:, [states.index(name) for name in kept]]
    column = basis[:, kept.index('gyro_offset')]
    column *= 1.0 - a_gd
    column[states.index('sum_psi_dot')] = a_gd
    return tuple(kept), basis


@dataclass(frozen=True, eq=False)
class _Plane:
    """The motion of a plane in rad and s under duties [%] and forces [N] held for a time."""

    a: Matrix
    b: Matrix
    ratio: float

    @classmethod
    @lru_cache(maxsize=8)
    def of(cls, parameters: PlantParameters) -> _Plane:
        p = PhysicalParameters.from_parameters(parameters)
        a, b = state_space(p)
        volts = max_voltage(
            parameters.battery_voltage, parameters.voltage_slope, parameters.voltage_offset
        )
        force = b[:, 1] * p.ball_radius + b[:, 2] * p.body_height
        return cls(a, np.column_stack([b[:, 0] * volts / 100.0, force]), p.ratio)

    def move(self, time_ms: float, state: Matrix, duty: Matrix, force: Matrix) -> Matrix:
        """Return the state after a time, each as rows."""
        n, m = self.b.shape
        block = np.zeros((n + m, n + m))
        block[:n, :n], block[:n, n:] = self.a, self.b
        return np.asarray(expm(block * (time_ms * 1e-3))[:n] @ np.vstack([state, duty, force]))

    def gyro(self, state: Matrix) -> Matrix:
        """Return the pitch rate [deg/s]."""
        return np.asarray(state[3] * _DEGREES)

    def angle(self, state: Matrix) -> Matrix:
        """Return the angle of the motor shaft [deg]."""
        return np.asarray(self.ratio * (state[0] - state[1]) * _DEGREES)


class _Tick:
    """A tick of the plane: its end and the samples as rows of factors of its states and inputs.

    Attributes
    ----------
    states : tuple of str
        As in :class:`SampledLoop`: plane, program, queues.
    read : ndarray
        The program's variables, and what it reads at the start of the tick: gyro, encoder, stick.
    plane_after, queues_after : ndarray
        The other states at the end of the tick.
    """

    def __init__(self, plane: _Plane, delays: LoopDelays, period_ms: float) -> None:
        duties, gyros, angles = (
            tuple(f'{name}[{ticks}]' for ticks in range(1, math.ceil(delay_ms / period_ms) + 1))
            for name, delay_ms in (
                (DUTY, delays.actuator), ('gyro', delays.gyro), ('angle', delays.encoder),
            )
        )  # fmt: skip
        self.states = (*STATES, *_PROGRAM, *duties, *gyros, *angles)
        names = (*self.states, *INPUTS)
        self._rows = dict(zip(names, np.eye(len(names)), strict=True))

        state = self[STATES]
        gyro = (self[gyros[-1]] if gyros else plane.gyro(state)) + self[GYRO_ERROR]
        angle = (self[angles[-1]] if angles else plane.angle(state)) + self[ENCODER_ERROR]
        self.read = np.vstack([self[_PROGRAM], gyro, angle, self[STICK]])

        # Within the tick: when the next duty takes effect, and when the samples are taken.
        change, gyro_ms, angle_ms = (
            -delay % period_ms for delay in (-delays.actuator, delays.gyro, delays.encoder)
        )
        acting = [self[DUTY], *(self[name] for name in duties)]
        newer = int(delays.actuator // period_ms)
        samples = {}
        for start, end in pairwise(sorted({0.0, change, gyro_ms, angle_ms, float(period_ms)})):
            samples[start] = state
            duty = acting[newer if start >= change else newer + 1]
            state = plane.move(end - start, state, duty, self[FORCE])
        self.plane_after = state
        self.queues_after = np.array([
            *acting[: len(duties)],
            *[plane.gyro(samples[gyro_ms]), *(self[name] for name in gyros)][: len(gyros)],
            *[plane.angle(samples[angle_ms]), *(self[name] for name in angles)][: len(angles)],
        ]).reshape(-1, len(names))  # fmt: skip

    def __getitem__(self, name: str | Sequence[str]) -> Matrix:
        """Return the row of a state or input, or the rows of several."""
        if isinstance(name, str):
            return self._rows[name]
        return np.array([self._rows[each] for each in name])


_tick = lru_cache(maxsize=256)(_Tick)  # the same for all gains


def _law(parameters: ParameterSet, period_ms: float) -> Matrix:
    """Return the law of the program as a matrix, from what :func:`axis.control` computes.

    It has a row for each variable after the tick and for the duty; a column for each variable
    before, the gyro's and the encoder's sample and the stick.
    """
    own = parameters.of(ControllerParameters)
    filters = {name: getattr(own, name) ** (period_ms / TICK_MS) for name in _FILTERS}
    program = replace(ProgramConstants.of(replace(own, **filters)), pwm_offset=Single(0))
    law = with_globals(axis.control, {'TS1_PERIOD': np.float64(period_ms)})
    gains, *others = axis.constants_of(program)
    constants = cast(axis.Constants, (tuple(map(np.float64, gains)), *map(np.float64, others)))
    sample = battery_mv(parameters.of(PlantParameters).battery_voltage)
    volts = max_motor_voltage(cast(Single, np.float64(sample)))
    columns = []
    for vector in np.eye(len(_PROGRAM) + 3) * _UNIT:
        *before, gyro, angle, stick = vector
        after, _, duty = law(
            constants, cast(axis.AxisState, tuple(before)), gyro, angle, stick, volts
        )
        columns.append([*after, duty])
    return np.array(columns, float).T / _UNIT
