"""Simulation of all segments of an experiment at once, for several sets of parameters.

It is the project's own plant: the functions of :mod:`ballbot_ros.plant` on arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ballbot_ros.identification.arrays import for_arrays
from ballbot_ros.identification.experiment import Channel, Experiment, Floats, Quantity
from ballbot_ros.identification.segments import Segments
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.plant import actuator, integration, plant
from ballbot_ros.plant.actuator import effective_duty
from ballbot_ros.plant.integration import discrete_matrices, equations_of
from ballbot_ros.plant.model import PhysicalParameters
from ballbot_ros.timing import STEP_NS, STEPS_PER_TICK, TICK_S

_DT = STEP_NS * 1e-9
_PLANES = (0, 1)
_DUTIES = range(-100, 101)
_NO_FORCES = (0.0,) * 8

_advance_linear = for_arrays(integration.advance_linear)
_advance_nonlinear = for_arrays(integration.advance_nonlinear)
_max_voltage = for_arrays(actuator.max_voltage)
_motor_current = for_arrays(actuator.motor_current)
_shaft_angle = for_arrays(plant.shaft_angle)

_STATES = 4
_SLOPE_TICKS = 20
_STATE_DEVIATIONS = (1.0, 0.5, 20.0, 10.0)
_OFFSET_DEVIATION = 50.0
_BATTERY_DEVIATION = 2.0
"""How far the unknowns of a segment may be from their first guess: far beyond what occurs [rad,
rad/s; deg, deg/s; V]. Where readings are missing, they keep the problem solvable."""


class Prediction(NamedTuple):
    """What the model predicts for `v` sets of parameters and `s` segments of `n` readings.

    Attributes
    ----------
    readings : mapping of Channel to ndarray, shape (v, s, n, 2)
    battery : ndarray, shape (v, s, n)
    """

    readings: Mapping[Channel, Floats]
    battery: Floats


class SegmentModel:
    """Model of the readings of an experiment's segments.

    A segment has unknowns of its own: for each plane its state at the start, and the offset of the
    channel that has one; and the open-circuit voltage of the battery.

    Attributes
    ----------
    segments : Segments
    deviations : ndarray, shape (k,)
        Standard deviations of the unknowns around their first guess.
    """

    def __init__(self, segments: Segments) -> None:
        self.segments = segments
        experiment = segments.experiment
        self._channels = tuple(experiment.readings)
        self._with_offset = [each for each in self._channels if each.has_offset]
        assert len(self._with_offset) <= 1
        deviations = [*_STATE_DEVIATIONS, *(_OFFSET_DEVIATION for _ in self._with_offset)]
        self._plane_unknowns = len(deviations)
        self.deviations = np.array([*deviations, *deviations, _BATTERY_DEVIATION])

    def first_guess(self) -> Floats:
        """Return a first guess of the unknowns, shape (s, k)."""
        segments, experiment = self.segments, self.segments.experiment
        guess = np.zeros((segments.count, len(self.deviations)))
        battery = experiment.battery
        measured = np.flatnonzero(~np.isnan(battery))
        if measured.size:
            guess[:, -1] = np.interp(segments.starts, measured, battery[measured])
        else:
            guess[:, -1] = experiment.plant.battery_voltage
        for plane in _PLANES:
            own = guess[:, plane * self._plane_unknowns :][:, : self._plane_unknowns]
            self._guess_plane(own, plane)
        return guess

    def _guess_plane(self, own: Floats, plane: int) -> None:
        """Fill in the unknowns of a plane, shape (s, ·)."""
        segments, plant = self.segments, self.segments.experiment.plant
        ratio = plant.ball_radius / plant.wheel_radius
        by_quantity = {each.quantity: each for each in self._channels}
        if channel := by_quantity.get(Quantity.PITCH_RATE):
            rates = _without_gaps(segments.readings[channel][:, :, plane])
            if channel.has_offset:
                own[:, _STATES] = rates.mean(axis=1)
                rates = rates - own[:, [_STATES]]
            own[:, 3] = np.radians(rates[:, 0])
        if channel := by_quantity.get(Quantity.PITCH):
            own[:, 1] = np.radians(_without_gaps(segments.readings[channel][:, :, plane])[:, 0])
        if channel := by_quantity.get(Quantity.SHAFT):
            wheel = np.radians(_without_gaps(segments.readings[channel][:, :, plane]))
            wheel -= segments.contact[:, [plane]] * plant.backlash / 2.0
            angle = wheel / ratio
        elif channel := by_quantity.get(Quantity.POSITION):
            angle = _without_gaps(segments.readings[channel][:, :, plane]) / plant.ball_radius
        own[:, 0] = angle[:, 0] + own[:, 1]
        own[:, 2] = (angle[:, _SLOPE_TICKS] - angle[:, 0]) / (_SLOPE_TICKS * TICK_S)

    def predict(self, plants: Sequence[PlantParameters], unknowns: Floats) -> Prediction:
        """Return the readings that sets of parameters predict.

        Parameters
        ----------
        plants : sequence of PlantParameters
            One for each of `v` variants; they differ in physical parameters and dead zone only.
        unknowns : ndarray, shape (v, s, k)
        """
        segments = self.segments
        lanes = _Lanes(plants, segments.experiment)
        half_play = plants[0].backlash / 2.0
        planes = unknowns[:, :, :-1].reshape(*unknowns.shape[:2], 2, self._plane_unknowns)
        # Unknowns by number, each of shape (plane, v, s).
        state_and_offset = np.ascontiguousarray(np.moveaxis(planes, (3, 2), (0, 1)))
        state = tuple(state_and_offset[:_STATES])
        contact = segments.contact.T[:, np.newaxis]
        shaft = lanes.wheel(state) + half_play * contact
        open_circuit = unknowns[:, :, -1]
        before = segments.duty_before.T
        battery = lanes.battery(open_circuit, before, lanes.voltage(before, open_circuit), state)
        predicted = self._empty(len(plants))
        for step in range(segments.length * STEPS_PER_TICK):
            self._sample(predicted, step, lanes, state, shaft, battery)
            duty = segments.duty[:, step].T
            voltage = lanes.voltage(duty, battery)
            battery = lanes.battery(open_circuit, duty, voltage, state)
            state = lanes.advance(state, voltage)
            wheel = lanes.wheel(state)
            shaft = _shaft_angle(shaft, wheel, half_play) if half_play else wheel
        for channel in self._with_offset:
            offset = np.moveaxis(state_and_offset[_STATES], 0, -1)
            predicted.readings[channel][:] += offset[:, :, np.newaxis]
        return predicted

    def _empty(self, variants: int) -> Prediction:
        shape = (variants, self.segments.count, self.segments.length)
        return Prediction(
            {channel: np.zeros((*shape, 2)) for channel in self._channels}, np.zeros(shape)
        )

    def _sample(
        self,
        predicted: Prediction,
        step: int,
        lanes: _Lanes,
        state: tuple[Floats, ...],
        shaft: Floats,
        battery: Floats,
    ) -> None:
        """Take the readings of a step, those that show it."""
        for channel in self._channels:
            age = self.segments.experiment.ages.get(channel, 0)
            number, rest = divmod(step + age, STEPS_PER_TICK)
            if rest == 0 and number < self.segments.length:
                measured = lanes.measured(channel.quantity, state, shaft)
                predicted.readings[channel][:, :, number] = np.moveaxis(measured, 0, -1)
        number, rest = divmod(step, STEPS_PER_TICK)
        if rest == 0:
            predicted.battery[:, :, number] = battery


class _Lanes:
    """The plant for several sets of parameters, on arrays of shape (2, v, s): planes x and y."""

    def __init__(self, plants: Sequence[PlantParameters], experiment: Experiment) -> None:
        physical = [PhysicalParameters.from_parameters(each) for each in plants]
        common = plants[0]
        self._voltage_law = common.voltage_slope, common.voltage_offset
        drains = common.battery_model == 'draining'
        self._battery_resistance = common.battery_resistance if drains else 0.0
        self._idle_current = common.idle_current
        self._ratio = _column([each.ratio for each in physical])
        self._radius = _column([each.ball_radius for each in physical])
        self._back_emf = self._ratio * _column([each.back_emf_constant for each in physical])
        self._resistance = _column([each.motor_resistance for each in physical])
        self._effective = np.array(
            [[effective_duty(duty, each.dead_zone) / 100.0 for duty in _DUTIES] for each in plants]
        )
        self.advance: Callable[[tuple[Floats, ...], Floats], tuple[Floats, ...]]
        if common.plant_model == 'linear':
            matrices = _columns([discrete_matrices(each, _DT)[0] for each in physical])
            self.advance = lambda state, voltage: _advance_linear(
                matrices, _NO_FORCES, state, voltage, 0.0, 0.0
            )
        else:
            equations = _columns([equations_of(each) for each in physical])
            alpha = _column([each.alpha for each in physical])
            self.advance = lambda state, voltage: _advance_nonlinear(
                equations, alpha, _DT, state, voltage, 0.0, 0.0
            )

    def wheel(self, state: tuple[Floats, ...]) -> Floats:
        """Return the angle of the wheel [rad]."""
        return np.asarray(self._ratio * (state[0] - state[1]))

    def voltage(self, duty: Any, battery: Floats) -> Floats:
        """Return the motor voltages [V] of duties, shape (2, s)."""
        full = _max_voltage(battery, *self._voltage_law)
        return np.asarray(np.moveaxis(self._effective[:, duty - _DUTIES[0]], 1, 0) * full)

    def battery(
        self, open_circuit: Floats, duty: Any, voltage: Floats, state: tuple[Floats, ...]
    ) -> Floats:
        """Return the battery voltage [V], shape (v, s), under the currents of duties, (2, s)."""
        if not self._battery_resistance:
            return open_circuit
        _, _, theta_dot, psi_dot = state
        currents = _motor_current(voltage, theta_dot, psi_dot, self._back_emf, self._resistance)
        current = (duty[:, np.newaxis] / 100.0 * currents).sum(axis=0)
        # The open-circuit voltage is constant: in a second it falls by less than 1 mV.
        drawn = np.maximum(0.0, current) + self._idle_current
        return np.asarray(open_circuit - self._battery_resistance * drawn)

    def measured(self, quantity: Quantity, state: tuple[Floats, ...], shaft: Floats) -> Floats:
        """Return a quantity of a plane, in its unit."""
        if quantity is Quantity.SHAFT:
            return np.asarray(np.degrees(shaft))
        if quantity is Quantity.POSITION:
            return np.asarray(self._radius * state[0])
        return np.asarray(np.degrees(state[1 if quantity is Quantity.PITCH else 3]))


def _column(values: Sequence[float]) -> Floats:
    return np.array(values)[:, np.newaxis]


def _columns(rows: Sequence[Sequence[float]]) -> tuple[Floats, ...]:
    return tuple(_column(values) for values in zip(*rows, strict=True))


def _without_gaps(values: Floats) -> Floats:
    """Return rows in which the first known value replaces missing ones before it."""
    filled = np.array(values)
    for column in range(filled.shape[1] - 2, -1, -1):
        missing = np.isnan(filled[:, column])
        filled[missing, column] = filled[missing, column + 1]
    return filled
