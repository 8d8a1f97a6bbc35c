"""Simulation of all segments of an experiment at once, for several sets of parameters.

It is the project's own plant: the functions of :mod:`ballbot_ros.robot.plant` on arrays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ballbot_ros.analysis.identification.experiment import (
    Channel,
    ChannelQuantity,
    Experiment,
    for_arrays,
)
from ballbot_ros.analysis.identification.segments import Segments, segment_length
from ballbot_ros.engine.compilation import can_compile, compiled_and_kept
from ballbot_ros.engine.trajectory import Engine
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.plant.integration import (
    advance_linear,
    advance_nonlinear,
    discrete_matrices,
    equations_of,
    linear_rates,
    pieces_of,
    response_of_pieces,
    superposed,
)
from ballbot_ros.robot.plant.laws import effective_duty, max_voltage, motor_current, shaft_angle
from ballbot_ros.robot.plant.model import PhysicalParameters

_PLANES = (0, 1)
_DUTIES = range(-100, 101)
_NO_FORCES = (0.0,) * 8
_AT_REST = (0.0,) * 4

_advance_linear = for_arrays(advance_linear)
_advance_nonlinear = for_arrays(advance_nonlinear)
_response_of_pieces = for_arrays(response_of_pieces)
_superposed = for_arrays(superposed)
_max_voltage = for_arrays(max_voltage)
_motor_current = for_arrays(motor_current)
_shaft_angle = for_arrays(shaft_angle)

_STATES = 4
_SLOPE_S = 0.08
_STATE_DEVIATIONS = (1.0, 0.5, 20.0, 10.0)
_OFFSET_DEVIATION = 50.0
_FILTERED_RATE_DEVIATION = 1.0
_VOLTAGE_DEVIATION = 10.0
_BATTERY_DEVIATION = 2.0
"""How far the unknowns of a segment may be from their first guess: far beyond what occurs [rad,
rad/s; deg, deg/s; rad/s; V; V]. Where readings are missing, they keep the problem solvable."""


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

    A segment has unknowns of its own: for each plane its state at the start, the offset of the
    channel that has one, the state of the filter of an estimated pitch, and the voltages of the
    motor if its duties are not known; and the open-circuit voltage of the battery. `deviations`,
    shape (k,), are the standard deviations of the unknowns around their first guess.
    """

    def __init__(self, segments: Segments) -> None:
        self.segments = segments
        experiment = segments.experiment
        self._channels = tuple(experiment.readings)
        self._samples = {
            channel: _samples(shown, segments.length * experiment.steps_per_reading)
            for channel, shown in segments.shown.items()
        }
        self._with_offset = [each for each in self._channels if each.has_offset]
        assert len(self._with_offset) <= 1
        deviations = [*_STATE_DEVIATIONS, *(_OFFSET_DEVIATION for _ in self._with_offset)]
        self._filtered_rate = len(deviations)
        self._filter_s = max((each.filter_s for each in self._channels), default=0.0)
        if self._filter_s:
            deviations.append(_FILTERED_RATE_DEVIATION)
        self._first_voltage = len(deviations)
        if segments.duty is None:
            # Of the whole segment, also if only its beginning is simulated.
            deviations += (segment_length(experiment) - 1) * [_VOLTAGE_DEVIATION]
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
        if channel := by_quantity.get(ChannelQuantity.PITCH_RATE):
            rates = _without_gaps(segments.readings[channel][:, :, plane])
            if channel.has_offset:
                own[:, _STATES] = rates.mean(axis=1)
                rates = rates - own[:, [_STATES]]
            own[:, 3] = np.radians(rates[:, 0])
        if channel := by_quantity.get(ChannelQuantity.PITCH):
            own[:, 1] = np.radians(_without_gaps(segments.readings[channel][:, :, plane])[:, 0])
        elif channel := by_quantity.get(ChannelQuantity.ESTIMATED_PITCH):
            pitch = _without_gaps(segments.readings[channel][:, :, plane])
            own[:, _STATES] = pitch[:, 0]
            own[:, 1] = np.radians(pitch[:, 0])
            own[:, 3] = np.radians(pitch[:, 1] - pitch[:, 0]) / segments.experiment.reading_s
        if channel := by_quantity.get(ChannelQuantity.SHAFT):
            wheel = np.radians(_without_gaps(segments.readings[channel][:, :, plane]))
            wheel -= segments.contact[:, [plane]] * plant.backlash / 2.0
            angle = wheel / ratio
        elif channel := by_quantity.get(ChannelQuantity.POSITION):
            angle = _without_gaps(segments.readings[channel][:, :, plane]) / plant.ball_radius
        own[:, 0] = angle[:, 0] + own[:, 1]
        reading_s = segments.experiment.reading_s
        readings = max(1, round(_SLOPE_S / reading_s))
        own[:, 2] = (angle[:, readings] - angle[:, 0]) / (readings * reading_s)
        if segments.duty is None:
            # Those that would keep the speed.
            physical = PhysicalParameters.from_parameters(plant)
            rates = np.diff(angle, axis=1) / reading_s
            end = self._first_voltage + rates.shape[1]
            own[:, self._first_voltage : end] = physical.beta / physical.alpha * rates

    def predict(self, plants: Sequence[PlantParameters], unknowns: Floats) -> Prediction:
        """Return the readings that sets of parameters predict.

        There is a plant for each of `v` variants, which differ in physical parameters and dead zone
        only. The unknowns have the shape (v, s, k).
        """
        segments = self.segments
        lanes = _Lanes(plants, segments.experiment)
        steps = segments.experiment.steps_per_reading
        half_play = plants[0].backlash / 2.0
        planes = unknowns[:, :, :-1].reshape(*unknowns.shape[:2], 2, self._plane_unknowns)
        # Unknowns by number, each of shape (plane, v, s).
        state_and_offset = np.ascontiguousarray(np.moveaxis(planes, (3, 2), (0, 1)))
        state = state_and_offset[:_STATES]
        contact = segments.contact.T[:, np.newaxis]
        shaft = lanes.wheel(state) + half_play * contact
        open_circuit = unknowns[:, :, -1]
        drive: _KnownDuties | _UnknownVoltages
        if segments.duty is None:
            drive = _UnknownVoltages(state_and_offset[self._first_voltage :], open_circuit, steps)
        else:
            drive = _KnownDuties(segments, lanes, state, open_circuit)
        filtered_rate = np.zeros_like(shaft)
        if self._filter_s:
            filtered_rate = state_and_offset[self._filtered_rate]
        start_rate = filtered_rate
        shape = len(plants), segments.count, segments.length
        predicted = Prediction(
            {channel: np.zeros((*shape, 2)) for channel in self._channels}, np.zeros(shape)
        )
        for step in range((segments.length - 1) * steps + 1):
            estimate = self._filter_s * (filtered_rate - start_rate)
            motion = _Motion(state, shaft, estimate, drive.battery)
            self._sample(predicted, step, lanes, motion)
            if self._filter_s:
                # As the controller does, with the rate at the start of the step.
                gain = segments.experiment.step_s / self._filter_s
                filtered_rate = filtered_rate + gain * (state[3] - filtered_rate)
            before = None
            for number, share in drive.parts(step):
                voltage = drive.voltage(number, state, share)
                state = lanes.advance(state, voltage, share, before)
                before = voltage
            wheel = lanes.wheel(state)
            shaft = _shaft_angle(shaft, wheel, half_play) if half_play else wheel
        for channel in self._with_offset:
            offset = np.moveaxis(state_and_offset[_STATES], 0, -1)
            predicted.readings[channel][:] += offset[:, :, np.newaxis]
        return predicted

    def _sample(self, predicted: Prediction, step: int, lanes: _Lanes, motion: _Motion) -> None:
        """Take the readings of a step, those that show it or a time close to it."""
        experiment = self.segments.experiment
        for channel in self._channels:
            segments, numbers, weights = self._samples[channel][step]
            if len(segments):
                measured = np.moveaxis(lanes.measured(channel.quantity, motion), 0, -1)
                part = weights[:, np.newaxis] * measured[:, segments]
                predicted.readings[channel][:, segments, numbers] += part
        number, rest = divmod(step + experiment.battery_age, experiment.steps_per_reading)
        if rest == 0 and number < self.segments.length:
            predicted.battery[:, :, number] = motion.battery


def _samples(shown: Floats, steps: int) -> list[tuple[Any, Any, Floats]]:
    """Return, for each step, the readings that show it or a time between it and its neighbours.

    They are given by segment and number, with their weights: readings between steps are
    interpolated.
    """
    segments, numbers = np.indices(shown.shape).reshape(2, -1)
    at = shown.ravel()
    before = np.floor(at).astype(np.intp)
    all_steps = np.concatenate([before, before + 1])
    weights = np.concatenate([1.0 - (at - before), at - before])
    order = np.argsort(all_steps, kind='stable')
    order = order[(weights[order] > 0.0) & (all_steps[order] >= 0)]
    bounds = np.searchsorted(all_steps[order], np.arange(steps + 1))
    rows = order % len(at)
    return [
        (segments[rows[a:b]], numbers[rows[a:b]], weights[order[a:b]]) for a, b in pairwise(bounds)
    ]


class _Motion(NamedTuple):
    """What the devices measure of a step: arrays of shape (2, v, s), the battery's (v, s).

    Attributes
    ----------
    state : ndarray, shape (4, 2, v, s)
        theta, psi [rad], theta_dot, psi_dot [rad/s].
    shaft : ndarray
        Angle of the motor shaft [rad].
    estimate : ndarray
        Change of the estimated pitch since the start [rad].
    battery : ndarray
        Its voltage [V].
    """

    state: Floats
    shaft: Floats
    estimate: Floats
    battery: Floats


class _KnownDuties:
    """Duties that are known: motors and battery depend on each other.

    `battery`, shape (v, s), is its present voltage [V].
    """

    def __init__(
        self, segments: Segments, lanes: _Lanes, state: Floats, open_circuit: Floats
    ) -> None:
        assert segments.duty is not None
        assert segments.duty_before is not None
        assert segments.changes is not None
        self._duty, self._lanes, self._open_circuit = segments.duty, lanes, open_circuit
        self._changes = segments.changes
        self._is_divided = np.asarray((segments.changes < 1.0).any(axis=0))
        before = segments.duty_before.T
        voltage = lanes.voltage(before, open_circuit)
        self.battery = lanes.battery(open_circuit, before, voltage, state)

    def parts(self, step: int) -> Sequence[tuple[int, Floats | None]]:
        """Return the parts of a step: that whose duty acts, and the share of the step, shape (s,).

        The share is None for a whole step.
        """
        if not self._is_divided[step]:
            return ((step, None),)
        change = self._changes[:, step]
        return (step, change), (step + 1, 1.0 - change)

    def voltage(self, step: int, state: Floats, share: Floats | None) -> Floats:
        """Return the motor voltages [V] under the duties of a step, from this state on.

        The battery feels them in the segments in which they act for some time.
        """
        duty = self._duty[:, step].T
        voltage = self._lanes.voltage(duty, self.battery)
        after = self._lanes.battery(self._open_circuit, duty, voltage, state)
        self.battery = after if share is None else np.where(share > 0.0, after, self.battery)
        return voltage


class _UnknownVoltages:
    """Motor voltages [V] midway between readings, unknowns of shape (n - 1, 2, v, s).

    They change linearly. At the readings, an error that alternates would hardly be seen.
    """

    def __init__(self, voltages: Floats, battery: Floats, steps_per_reading: int) -> None:
        self._voltages, self.battery, self._steps = voltages, battery, steps_per_reading

    def parts(self, step: int) -> Sequence[tuple[int, None]]:
        """Return the step as its only part."""
        return ((step, None),)

    def voltage(self, step: int, _state: Floats, _share: Floats | None) -> Floats:
        """Return the motor voltages [V] in a step."""
        last = len(self._voltages) - 1
        position = min(max(0.0, (step + 0.5) / self._steps - 0.5), float(last))
        number = int(position)
        part = position - number
        following = self._voltages[min(number + 1, last)]
        return np.asarray((1.0 - part) * self._voltages[number] + part * following)


class _Lanes:
    """The plant for several sets of parameters, on arrays of shape (2, v, s): planes x and y."""

    def __init__(self, plants: Sequence[PlantParameters], experiment: Experiment) -> None:
        physical = [PhysicalParameters.from_parameters(each) for each in plants]
        common, step_s = plants[0], experiment.step_s
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
        self._step_s = step_s
        self._is_linear = common.plant_model == 'linear'
        if self._is_linear:
            self._matrices = _columns([discrete_matrices(each, step_s)[0] for each in physical])
            self._rates = _columns([linear_rates(each) for each in physical])
            self._pieces = max(pieces_of(linear_rates(each)[-1], step_s) for each in physical)
        else:
            self._constants = np.array([(*equations_of(each), each.alpha) for each in physical])
            self._advance = advance_arrays
            if engine_of(common) is Engine.COMPILED:
                self._advance = compiled_and_kept(advance_segments)

    def advance(
        self, state: Floats, voltage: Floats, share: Floats | None, before: Floats | None
    ) -> Floats:
        """Return the state after a part of a step, as a plant computes it.

        Parameters
        ----------
        share : ndarray, shape (s,), or None
            That of the step; None for all of it.
        before : ndarray or None
            The voltage in the part before; None in the first one.
        """
        if not self._is_linear:
            share = np.ones(state.shape[3]) if share is None else share
            return self._advance(self._constants, self._step_s * share, state, voltage)
        if before is None:
            after = _advance_linear(self._matrices, _NO_FORCES, state, voltage, 0.0, 0.0)
        else:
            h = self._step_s * np.asarray(share) / self._pieces
            response = _response_of_pieces(self._rates, h, self._pieces)
            after = _superposed(state, response, voltage - before)
        return np.array(after)

    def wheel(self, state: Floats) -> Floats:
        """Return the angle of the wheel [rad]."""
        return np.asarray(self._ratio * (state[0] - state[1]))

    def voltage(self, duty: Any, battery: Floats) -> Floats:
        """Return the motor voltages [V] of duties, shape (2, s)."""
        full = _max_voltage(battery, *self._voltage_law)
        effective = np.moveaxis(self._effective[:, duty - _DUTIES[0]], 1, 0)
        return np.ascontiguousarray(effective * full)

    def battery(self, open_circuit: Floats, duty: Any, voltage: Floats, state: Floats) -> Floats:
        """Return the battery voltage [V], shape (v, s), under the currents of duties, (2, s)."""
        if not self._battery_resistance:
            return open_circuit
        _, _, theta_dot, psi_dot = state
        currents = _motor_current(voltage, theta_dot, psi_dot, self._back_emf, self._resistance)
        current = (duty[:, np.newaxis] / 100.0 * currents).sum(axis=0)
        # The open-circuit voltage is constant: in a second it falls by less than 1 mV.
        drawn = np.maximum(0.0, current) + self._idle_current
        return np.asarray(open_circuit - self._battery_resistance * drawn)

    def measured(self, quantity: ChannelQuantity, motion: _Motion) -> Floats:
        """Return a quantity of a plane, in its unit."""
        theta, psi, _, psi_dot = motion.state
        if quantity is ChannelQuantity.POSITION:
            return np.asarray(self._radius * theta)
        angles = {
            ChannelQuantity.SHAFT: motion.shaft,
            ChannelQuantity.PITCH: psi,
            ChannelQuantity.PITCH_RATE: psi_dot,
            ChannelQuantity.ESTIMATED_PITCH: motion.estimate,
        }
        return np.asarray(np.degrees(angles[quantity]))


def engine_of(plant: PlantParameters) -> Engine:
    """Return what moves the segments of a plant; the linear model needs no compiler."""
    is_compiled = plant.plant_model == 'nonlinear' and can_compile()
    return Engine.COMPILED if is_compiled else Engine.INTERPRETED


def advance_segments(constants: Floats, dt: Floats, state: Floats, voltage: Floats) -> Floats:
    """Return the state of segments some time later, by the nonlinear model.

    It is for the compiler; :func:`advance_arrays` does the same without one.

    Parameters
    ----------
    constants : ndarray, shape (v, 11)
        The equations of each variant, and alpha.
    dt : ndarray, shape (s,)
        That time [s].
    state : ndarray, shape (4, 2, v, s)
    voltage : ndarray, shape (2, v, s)
    """
    after = np.empty(state.shape)
    for variant in range(len(constants)):
        m11, m22, coupling, drive, det, det_1, det_2, weight, beta, fs, alpha = constants[variant]
        equations = m11, m22, coupling, drive, det, det_1, det_2, weight, beta, fs
        for segment in range(state.shape[3]):
            theta_x, theta_y = state[0, :, variant, segment]
            psi_x, psi_y = state[1, :, variant, segment]
            theta_dot_x, theta_dot_y = state[2, :, variant, segment]
            psi_dot_x, psi_dot_y = state[3, :, variant, segment]
            voltage_x, voltage_y = voltage[:, variant, segment]
            planes = advance_nonlinear(
                equations, alpha, dt[segment],
                (theta_x, psi_x, theta_dot_x, psi_dot_x),
                (theta_y, psi_y, theta_dot_y, psi_dot_y),
                voltage_x, voltage_y, 0.0, 0.0, 0.0, 0.0,
            )  # fmt: skip
            for plane in range(2):
                for number in range(_STATES):
                    after[number, plane, variant, segment] = planes[plane][number]
    return after


def advance_arrays(constants: Floats, dt: Floats, state: Floats, voltage: Floats) -> Floats:
    """Return what :func:`advance_segments` returns, with the same bits."""
    *equations, alpha = constants.T[:, :, np.newaxis]
    # The arrays have both planes; the second one of the function stays at rest.
    planes = _advance_nonlinear(
        equations, alpha, dt, state, _AT_REST, voltage, 0.0, 0.0, 0.0, 0.0, 0.0
    )
    return np.array(planes[0])


def _column(values: Sequence[float]) -> Floats:
    return np.array(values)[:, np.newaxis]


def _columns(rows: Sequence[Sequence[float]]) -> tuple[Floats, ...]:
    return tuple(_column(values) for values in zip(*rows, strict=True))


def _without_gaps(values: Floats) -> Floats:
    """Return rows in which missing values are interpolated, or at the ends the next one."""
    filled = np.array(values)
    numbers = np.arange(filled.shape[1])
    for row in filled:
        known = ~np.isnan(row)
        if known.any():
            row[~known] = np.interp(numbers[~known], numbers[known], row[known])
        else:
            row[:] = 0.0
    return filled
