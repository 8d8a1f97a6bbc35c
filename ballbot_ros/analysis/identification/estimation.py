"""Estimation of physical parameters by least squares, with intervals.

The residuals are differences between readings and their predictions by the plant, each divided by
its standard deviation. Parameters and the unknowns of all segments are estimated together. A
controller moved the robot by these readings: its answers to their errors bias the estimates, for
which the intervals allow. The rounding of an encoder would bias them far more, as the controller
holds the shaft where the reading changes. So its readings count only while it turns, and the
rounding that is expected at the predicted angle is taken out of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import t as student

from ballbot_ros.analysis.identification.experiment import (
    ROUNDING_DEVIATION,
    Channel,
    expected_rounding,
)
from ballbot_ros.analysis.identification.segment_model import SegmentModel
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.robot.arithmetic import Floats

ROUNDS = 3
"""Fits, each with the selection, the rounding and the deviations that the one before found."""

TURNING_COUNTS = 1.0
"""Slowest predicted turn of an encoder between two readings, at which these count."""

MISFIT = 4.0
"""Root mean square of the residuals, relative to the median, beyond which a segment is dropped."""

NONSENSE = 100.0
"""The same, beyond which it is dropped before the first fit, whatever the parameters are."""

FEEDBACK_BIAS = 1.0
"""Bias of an estimate over its standard deviation, since the controller moves the robot by the
readings that are fitted. Measured in simulations: docs/identification.md."""

_DIFFERENCE = 1e-5
_LEAST_DEVIATION = 0.02
_MAX_STEPS = 40
_PARTS = 0.25, 0.5
_MAX_SETTLING = 8
_SETTLED = 1e-6


class Residuals(NamedTuple):
    """Residuals of the segments of an experiment, and their derivatives.

    Attributes
    ----------
    values : ndarray, shape (s, m)
    by_parameter : ndarray, shape (s, m, p)
        By each parameter over its scale, and last by the error of the battery reading over its
        standard deviation.
    by_unknown : ndarray, shape (s, m, k)
    """

    values: Floats
    by_parameter: Floats
    by_unknown: Floats

    def answer(self, changes: Floats) -> Floats:
        """Return the changes of the unknowns, (s, k, p), that best undo those of the residuals."""
        q, r = np.linalg.qr(self.by_unknown)
        return np.asarray(-np.linalg.solve(r, np.einsum('smk,smp->skp', q, changes)))

    def without_unknowns(self) -> Residuals:
        """Return the parts that no change of the segments' unknowns could remove."""
        q, _ = np.linalg.qr(self.by_unknown)
        return Residuals(
            self.values - np.einsum('smk,sk->sm', q, np.einsum('smk,sm->sk', q, self.values)),
            self.by_parameter
            - np.einsum('smk,skp->smp', q, np.einsum('smk,smp->skp', q, self.by_parameter)),
            self.by_unknown,
        )


class ExperimentFit:
    """An experiment during the estimation: its unknowns, and what is known of its readings' errors.

    Attributes
    ----------
    unknowns : ndarray, shape (s, k)
        The present estimate.
    dropped : int
        Number of segments that were dropped, since the model does not describe them.
    noise : dict of Channel to float
        Of rounded channels, the standard deviation of their errors before they are rounded.
    """

    def __init__(self, model: SegmentModel, unknowns: Floats | None = None) -> None:
        self.dropped = 0
        self._deviations = {each: each.noise for each in model.segments.experiment.readings}
        self.noise: dict[Channel, float] = {}
        self._use(model, model.first_guess() if unknowns is None else unknowns)

    def _use(self, model: SegmentModel, unknowns: Floats) -> None:
        self.model, self.unknowns = model, unknowns
        self._guess = unknowns
        readings = model.segments.readings
        self._counts = {each: ~np.isnan(values) for each, values in readings.items()}
        self._rounding = {each: np.zeros_like(values) for each, values in readings.items()}

    def residuals(
        self, plants: Sequence[PlantParameters], unknowns: Floats, battery_error: float
    ) -> Floats:
        """Return the residuals of variants, shape (v, s, m).

        `plants` and `unknowns`, shape (v, s, k), are those of the variants; `battery_error` [V] is
        that of the battery reading.
        """
        predicted = self.model.predict(plants, unknowns)
        segments = self.model.segments
        shape = unknowns.shape[:2]
        parts = []
        for channel, values in segments.readings.items():
            difference = predicted.readings[channel] + self._rounding[channel] - values
            counted = np.where(self._counts[channel], difference, 0.0)
            parts.append(counted.reshape(*shape, -1) / self._deviations[channel])
        difference = predicted.battery + battery_error - segments.battery
        # At its start, a segment knows the current only roughly.
        difference[:, :, 0] = 0.0
        parts.append(np.nan_to_num(difference) / segments.experiment.battery_error)
        parts.append((unknowns - self._guess) / self.model.deviations)
        return np.concatenate(parts, axis=2)

    def linearised(
        self, plant: PlantParameters, scales: Mapping[str, float], battery_error: float
    ) -> Residuals:
        """Return the residuals and their derivatives, by differences.

        The parameters of `scales` vary, each by a part of its scale.
        """
        count, own = len(scales), self.unknowns.shape[1]
        plants = [plant] * (1 + count + own)
        for number, (name, scale) in enumerate(scales.items(), start=1):
            value = getattr(plant, name) + _DIFFERENCE * scale
            plants[number] = plant.with_values({name: value})
        unknowns = np.repeat(self.unknowns[np.newaxis], len(plants), axis=0)
        for number in range(own):
            unknowns[1 + count + number, :, number] += _DIFFERENCE
        values = self.residuals(plants, unknowns, battery_error)
        slopes = np.moveaxis((values[1:] - values[0]) / _DIFFERENCE, 0, -1)
        # Exact, so that there is a solution even if the readings make no sense.
        slopes[:, -own:, count:] = np.diag(1.0 / self.model.deviations)
        return Residuals(
            values[0],
            np.concatenate([slopes[:, :, :count], self._battery_slope(values)], axis=2),
            slopes[:, :, count:],
        )

    def _battery_slope(self, values: Floats) -> Floats:
        slope = np.zeros((*values.shape[1:], 1))
        battery = self.model.segments.battery
        end = values.shape[2] - self.unknowns.shape[1]
        experiment = self.model.segments.experiment
        slope[:, end - battery.shape[1] : end, 0] = (
            ~np.isnan(battery) * experiment.battery_offset / experiment.battery_error
        )
        slope[:, end - battery.shape[1], 0] = 0.0
        return slope

    @np.errstate(over='ignore', invalid='ignore')
    def settle(self, plant: PlantParameters) -> None:
        """Estimate the unknowns of the segments, for these parameters.

        It begins with the first readings of each: after a rough guess of the pitch at the start,
        the robot would soon have fallen. Segments whose readings make no sense are dropped.
        """
        segments = self.model.segments
        for part in _PARTS:
            beginning = ExperimentFit(
                SegmentModel(segments.beginnings(round(segments.length * part))), self.unknowns
            )
            beginning.settle_all(plant, 0.0)
            self.unknowns = beginning.unknowns
        self.settle_all(plant, 0.0)
        size = self._size(plant, 0.0)
        finite = size[np.isfinite(size)]
        usual = float(np.median(finite)) if finite.size else 0.0
        self._drop(~(size <= NONSENSE * max(1.0, usual)))  # NaN as well

    def settle_all(self, plant: PlantParameters, battery_error: float) -> None:
        """Estimate the unknowns of the segments from all readings (Gauss-Newton)."""
        cost = np.full(len(self.unknowns), np.inf)
        before = self.unknowns
        for _ in range(_MAX_SETTLING):
            found = self.linearised(plant, {}, battery_error)
            present = np.sum(found.values**2, axis=1)
            better = present <= cost  # false as well if a robot fell, and nothing is finite
            before = np.where(better[:, np.newaxis], self.unknowns, before)
            self.unknowns = before
            if not (present < cost * (1.0 - _SETTLED)).any():
                return
            cost = np.where(better, present, cost)
            self.unknowns = self.unknowns + found.answer(found.values[:, :, np.newaxis])[:, :, 0]

    def improve(self, plant: PlantParameters, battery_error: float) -> None:
        """Learn from a fit: drop segments, select readings, take out rounding, weigh the rest."""
        size = self._size(plant, battery_error)
        self._drop(size > MISFIT * max(1.0, float(np.median(size))))
        predicted = self.model.predict([plant], self.unknowns[np.newaxis])
        for channel in self._deviations:
            self._improve_channel(channel, predicted.readings[channel][0])

    def _size(self, plant: PlantParameters, battery_error: float) -> Floats:
        """Return the root mean square of the residuals of each segment, shape (s,)."""
        residuals = self.residuals([plant], self.unknowns[np.newaxis], battery_error)[0]
        return np.asarray(np.sqrt(np.mean(residuals**2, axis=1)))

    def _drop(self, dropped: NDArray[np.bool_]) -> None:
        if dropped.any():
            self.dropped += int(dropped.sum())
            self._use(SegmentModel(self.model.segments.without(dropped)), self.unknowns[~dropped])

    def _improve_channel(self, channel: Channel, predicted: Floats) -> None:
        readings = self.model.segments.readings[channel]
        counts = ~np.isnan(readings)
        if channel.is_rounded and not channel.has_offset:
            counts &= np.abs(np.gradient(predicted, axis=1)) >= TURNING_COUNTS
        errors = predicted + self._rounding[channel] - readings
        deviation = _rms(errors[counts]) if counts.any() else channel.noise
        self._counts[channel] = counts
        if channel.is_rounded:
            self._deviations[channel] = max(_LEAST_DEVIATION, deviation)
            noise = math.sqrt(max(0.0, deviation**2 - ROUNDING_DEVIATION**2))  # before rounding
            self.noise.setdefault(channel, noise)
            self._rounding[channel] = expected_rounding(predicted, self.noise[channel])
        else:
            self._deviations[channel] = max(channel.noise, deviation)

    def deviations(self, plant: PlantParameters) -> dict[Channel, float]:
        """Return the root mean square of each channel's residuals, in its unit."""
        predicted = self.model.predict([plant], self.unknowns[np.newaxis]).readings
        readings = self.model.segments.readings
        return {
            channel: _rms((predicted[channel][0] - values)[~np.isnan(values)])
            for channel, values in readings.items()
        }


def _rms(errors: Floats) -> float:
    return float(np.sqrt(np.mean(errors**2)))


class Estimator:
    """Least squares over experiments.

    Parameters
    ----------
    values : mapping of str to float
        Parameters that differ from those of the experiments; the estimated ones begin with them.

    Attributes
    ----------
    values : dict of str to float
        Parameters: the present estimates, and those that are kept.
    battery_sigmas : float
        The present estimate of the error of the battery reading, over its standard deviation.
    """

    def __init__(self, fits: Sequence[ExperimentFit], values: Mapping[str, float]) -> None:
        self.fits = fits
        self.values = dict(values)
        self.battery_sigmas = 0.0

    def plant(self, fit: ExperimentFit) -> PlantParameters:
        """Return the parameters of an experiment's robot, with the present estimates."""
        return fit.model.segments.experiment.plant.with_values(self.values)

    def improve(self) -> None:
        """Learn from a fit what is known of the readings' errors."""
        for fit in self.fits:
            fit.improve(self.plant(fit), self.battery_error(fit))

    def battery_error(self, fit: ExperimentFit) -> float:
        """Return the present estimate of the error of an experiment's battery reading [V]."""
        return self.battery_sigmas * fit.model.segments.experiment.battery_offset

    def linearised(self, scales: Mapping[str, float]) -> list[Residuals]:
        """Return the residuals of each experiment, with their derivatives by some parameters."""
        return [
            fit.linearised(self.plant(fit), scales, self.battery_error(fit)) for fit in self.fits
        ]

    def solve(self, scales: Mapping[str, float], bounds: Mapping[str, tuple[float, float]]) -> None:
        """Minimise the squares of all residuals over parameters and unknowns of the segments.

        `scales` and `bounds` are those of the parameters to estimate.
        """
        projected = _Projected(self, scales)
        limits = [np.divide(bounds[name], scale) for name, scale in scales.items()]
        found = least_squares(
            projected.residuals,
            projected.start,
            projected.jacobian,
            bounds=tuple(zip(*limits, (-np.inf, np.inf), strict=True)),
            x_scale='jac',
            ftol=1e-6,
            xtol=1e-6,
            gtol=1e-10,
            max_nfev=_MAX_STEPS,
        )
        projected.residuals(found.x)


class _Projected:
    """All residuals as a function of the parameters alone (variable projection, Golub and Pereyra).

    The unknowns of the segments are always those that fit the parameters best. This takes few steps
    also where the robot's instability makes the common problem badly nonlinear. `start`, shape
    (p,), has the present estimates over their scales, and last the battery reading's error.
    """

    def __init__(self, estimator: Estimator, scales: Mapping[str, float]) -> None:
        self._estimator, self._scales = estimator, scales
        values = [estimator.values[name] / scale for name, scale in self._scales.items()]
        self.start = np.array([*values, estimator.battery_sigmas])
        self._origin = self.start
        self._unknowns = [fit.unknowns for fit in estimator.fits]
        self._answers = [np.zeros((*each.shape, len(self.start))) for each in self._unknowns]

    def residuals(self, variables: Floats) -> Floats:
        """Return the residuals, and last the battery reading's error."""
        estimator = self._estimator
        *values, sigmas = variables.tolist()
        estimator.battery_sigmas = sigmas
        estimator.values.update(
            (name, value * scale)
            for value, (name, scale) in zip(values, self._scales.items(), strict=True)
        )
        change, parts = variables - self._origin, []
        for fit, unknowns, answer in zip(
            estimator.fits, self._unknowns, self._answers, strict=True
        ):
            fit.unknowns = unknowns + answer @ change
            plant, error = estimator.plant(fit), estimator.battery_error(fit)
            fit.settle_all(plant, error)
            parts.append(fit.residuals([plant], fit.unknowns[np.newaxis], error).ravel())
        return np.concatenate([*parts, [sigmas]])

    def jacobian(self, variables: Floats) -> Floats:
        """Return the derivatives of :meth:`residuals`, at the variables of its last call."""
        found = self._estimator.linearised(self._scales)
        self._origin = variables
        self._unknowns = [fit.unknowns for fit in self._estimator.fits]
        self._answers = [each.answer(each.by_parameter) for each in found]
        parts = [each.without_unknowns().by_parameter for each in found]
        rows = np.concatenate([part.reshape(-1, len(variables)) for part in parts])
        last = np.zeros((1, len(variables)))
        last[0, -1] = 1.0
        return np.concatenate([rows, last])


def uncertainty(residuals: Sequence[Residuals]) -> tuple[Floats, Floats]:
    """Return half of the width of each parameter's 95 % interval, and the errors' correlation.

    The half widths, shape (p,), are relative to the scales; the correlation has the shape (p, p).
    They come from the scatter between segments, so readings within a segment may have dependent
    errors. The error of the battery reading is the same in all: it has a prior instead. The
    residuals are without unknowns, at the estimate.
    """
    information = _information(residuals)
    scores = np.concatenate(
        [np.einsum('smp,sm->sp', each.by_parameter, each.values) for each in residuals]
    )
    count, parameters = scores.shape
    inverse = np.linalg.inv(information)
    freedom = max(1, count - parameters)
    scatter = scores.T @ scores * (count / freedom)
    scatter[-1, -1] += 1.0
    covariance = (inverse @ scatter @ inverse)[:-1, :-1]
    deviations = np.sqrt(np.diag(covariance))
    quantile = float(student.ppf(0.975, freedom)) * math.sqrt(1.0 + FEEDBACK_BIAS**2)
    return quantile * deviations, covariance / np.outer(deviations, deviations)


def information(residuals: Sequence[Residuals]) -> Floats:
    """Return the information on the parameters, shape (p, p), if all errors are independent."""
    whole = _information(residuals)
    # Take out the error of the battery reading, which is not known either.
    last = whole[-1, :-1]
    return np.asarray(whole[:-1, :-1] - np.outer(last, last) / whole[-1, -1])


def _information(residuals: Sequence[Residuals]) -> Floats:
    total = sum(
        np.einsum('smp,smq->pq', each.by_parameter, each.by_parameter) for each in residuals
    )
    whole = np.array(total)
    whole[-1, -1] += 1.0
    return whole
