"""Identification: which parameters the data can tell apart, their values, and how sure they are."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ballbot_ros.analysis.identification.estimation import (
    ROUNDS,
    Estimator,
    ExperimentFit,
    Residuals,
    information,
    uncertainty,
)
from ballbot_ros.analysis.identification.experiment import GYRO, Experiment
from ballbot_ros.analysis.identification.segment_model import SegmentModel, engine_of
from ballbot_ros.analysis.identification.segments import Segments, cut, segment_length
from ballbot_ros.engine.trajectory import Engine
from ballbot_ros.errors import IdentificationError
from ballbot_ros.parameters import PLANT, PlantParameters, parameters_of, suggest
from ballbot_ros.parameters.parameter import TextEnum
from ballbot_ros.process import ProgressCallback
from ballbot_ros.robot.arithmetic import Floats

HARD_TO_MEASURE = (
    'body_height', 'back_emf_constant', 'torque_constant', 'dead_zone', 'body_mass',
    'motor_friction', 'ball_friction', 'motor_inertia', 'motor_resistance',
)  # fmt: skip
"""Parameters that are identified unless others are named, the hardest to measure first."""

CANDIDATES = (
    *HARD_TO_MEASURE, 'wheel_radius', 'ball_radius', 'ball_mass', 'wheel_mass', 'wheel_width',
    'gravity',
)  # fmt: skip
"""All parameters that can be identified."""

MAX_HALF_WIDTH = 0.1
"""Half of the widest 95 % interval of an identified parameter, as a part of its value."""

MARGIN = 0.8
"""Part of it that a forecast may reach."""

MIN_SEGMENTS = 10
"""Fewest segments, eight seconds with known duties, from whose scatter an interval can be told."""

LITTLE_NOISE = 0.3
"""Standard deviation of the gyro's noise [counts], below which its rounding depends on the
motion."""

MAX_INFLATION = 10.0
"""How much wider the interval of a parameter may be than if it were the only unknown. With more,
parameters all but cancel each other, and small errors of the model would be taken for them."""

MIN_LIKENESS = 0.25
"""Change of an identified parameter, relative to that of another, from which they act alike."""

UNDRIVEN_ERROR = 0.04
"""Error of an estimate without known duties, as a part of its value, which the scatter between
segments does not show. Measured in simulations: docs/identification.md."""

TYPICAL = {'ball_friction': PlantParameters().motor_friction, 'dead_zone': 1.0}
"""Usual sizes of parameters that can be 0 [N·m·s/rad, %]: intervals are relative to no less."""

_TWO_SIGMA = 1.96
_MAX_CONDITION = 1e10


class Identifiability(TextEnum):
    """What the data tell of a parameter."""

    IDENTIFIED = 'identified'
    UNCERTAIN = 'uncertain'
    NOT_TOLD_APART = 'not told apart'
    NOT_SEEN = 'not seen'


@dataclass(frozen=True)
class IdentifiedParameter:
    """A parameter and what the data tell of it.

    Attributes
    ----------
    start : float
        The value that the estimation began with; of one that was not estimated, the one it kept.
    value : float or None
        The estimate; None if it was not estimated.
    half_width : float
        Half of the 95 % interval, in the unit. Of one that was not estimated, what it would be if
        it were the only unknown.
    relative : float
        The same as a part of the value.
    alike : tuple of str
        Identified parameters that act on the readings as this one does.
    recorded : float or None
        The value that the recorded robot had; None if it is not known.
    """

    name: str
    unit: str
    verdict: Identifiability
    start: float
    value: float | None
    half_width: float
    relative: float
    alike: tuple[str, ...] = ()
    recorded: float | None = None

    @property
    def covers_recorded(self) -> bool | None:
        """Whether the interval covers the value of the recorded robot; None if there is none."""
        if self.value is None or self.recorded is None:
            return None
        return bool(abs(self.value - self.recorded) <= self.half_width)


@dataclass(frozen=True)
class ExperimentSummary:
    """An experiment, as it was used.

    Attributes
    ----------
    seconds : float
        Length of its segments together [s].
    segments, dropped : int
        Number of segments that were used, and of those that the model does not describe.
    before, after : mapping of str to float
        Root mean square of each channel's residuals, with the values at the start and with the
        estimates, in the channel's unit.
    """

    name: str
    seconds: float
    segments: int
    dropped: int
    before: Mapping[str, float]
    after: Mapping[str, float]
    units: Mapping[str, str]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Identification:
    """Result of an identification.

    Attributes
    ----------
    parameters : tuple of IdentifiedParameter
        In the order of the request.
    checks : tuple of ExperimentSummary
        Those that the estimates were checked with.
    correlation : ndarray, shape (p, p)
        Between the errors of the estimates.
    engine : Engine
        What moved the segments.
    """

    parameters: tuple[IdentifiedParameter, ...]
    experiments: tuple[ExperimentSummary, ...]
    checks: tuple[ExperimentSummary, ...]
    correlation: Floats
    engine: Engine = Engine.INTERPRETED

    @property
    def estimated(self) -> tuple[IdentifiedParameter, ...]:
        """The estimated parameters."""
        return tuple(each for each in self.parameters if each.value is not None)


# The numbers of a simulated robot that falls grow without limit. Such a step is not taken.
@np.errstate(over='ignore', invalid='ignore')
def identify(
    experiments: Sequence[Experiment],
    names: Sequence[str] = HARD_TO_MEASURE,
    start: Mapping[str, float] | None = None,
    checks: Sequence[Experiment] = (),
    progress: ProgressCallback = lambda done, total: None,
) -> Identification:
    """Identify parameters from experiments.

    Those that the data can tell apart are estimated, in the order of `names`; the others keep their
    values. It raises IdentificationError if a name is unknown, or only some experiments have
    duties.

    Parameters
    ----------
    experiments : sequence of Experiment
        All with duties, or all without.
    names : sequence of str
        Of :data:`CANDIDATES`.
    start : mapping or None
        Values to start from; the document's for those that are missing.
    checks : sequence of Experiment
        Further ones, which tell how well the estimates describe what they were not made from.
    """
    check_names(names)
    if len({each.duty is None for each in experiments}) > 1:
        raise IdentificationError(
            'files with and without duties cannot be fitted together: fit those with duties, which '
            'tell more, and --check with the others'
        )
    usual = {name: float(getattr(PlantParameters(), name)) for name in names}
    begin = {name: (start or {}).get(name, usual[name]) for name in names}
    segments = [cut(each) for each in experiments]
    if sum(each.count for each in segments) < MIN_SEGMENTS:
        return _unseen(names, segments, checks)
    candidates = [ExperimentFit(SegmentModel(each)) for each in segments if each.count]
    forecast = Estimator(candidates, begin)
    for fit in candidates:
        fit.settle(forecast.plant(fit))
    remaining = [fit.model.segments for fit in candidates]
    if sum(each.count for each in remaining) < MIN_SEGMENTS:
        return _unseen(names, remaining, checks)
    fits = [fit for fit in candidates if fit.model.segments.count]
    used = [fit.model.segments for fit in fits]
    unused = [fit.model.segments for fit in candidates if not fit.model.segments.count]
    unused += [each for each in segments if not each.count]
    estimator, chosen = _estimate(fits, names, begin, progress)
    residuals = _projected(estimator, names)
    half_widths, correlation = uncertainty([_columns(each, names, chosen) for each in residuals])
    if used[0].duty is None:
        half_widths = half_widths + UNDRIVEN_ERROR
    half_widths = half_widths * max(each.experiment.interval_factor for each in used)
    plant, values = estimator.plant(fits[0]), estimator.values
    return Identification(
        parameters=_judged(
            names,
            dict(zip(chosen, half_widths.tolist(), strict=True)),
            information(residuals),
            begin,
            plant,
            used[0].experiment.recorded,
        ),
        experiments=(
            *(_summary(fit.model.segments, begin, values, fit) for fit in fits),
            *(_summary(each, begin, values) for each in unused),
        ),
        checks=tuple(_summary(cut(each), begin, values) for each in checks),
        correlation=correlation,
        engine=engine_of(plant),
    )


def _estimate(
    fits: Sequence[ExperimentFit],
    names: Sequence[str],
    begin: Mapping[str, float],
    progress: ProgressCallback,
) -> tuple[Estimator, tuple[str, ...]]:
    """Return the estimates, and the parameters that were told apart."""
    chosen = choose(information(_projected(Estimator(fits, begin), names)), names)
    estimator = Estimator(fits, {name: begin[name] for name in chosen})
    for number in range(ROUNDS):
        progress(number, ROUNDS)
        if number:
            # With what is now known of the readings, fewer may be told apart.
            estimator.improve()
            chosen = choose(information(_projected(estimator, chosen)), chosen)
            estimator.values = {name: estimator.values[name] for name in chosen}
        if not chosen:
            break
        scales = {name: _scale(name, begin[name]) for name in chosen}
        estimator.solve(scales, {name: _bounds(name) for name in chosen})
    return estimator, chosen


def _unseen(
    names: Sequence[str], segments: Sequence[Segments], checks: Sequence[Experiment]
) -> Identification:
    """Return that nothing can be identified from so few segments."""
    experiment = segments[0].experiment
    nothing = np.zeros((len(names), len(names)))
    return Identification(
        parameters=_judged(names, {}, nothing, {}, experiment.plant, experiment.recorded),
        experiments=tuple(_summary(each, {}, {}) for each in segments),
        checks=tuple(_summary(cut(each), {}, {}) for each in checks),
        correlation=np.zeros((0, 0)),
    )


def check_names(names: Sequence[str]) -> None:
    """Raise IdentificationError if a name is unknown or given twice."""
    for name in names:
        if name not in CANDIDATES:
            raise IdentificationError(
                f'--fit: {name!r} cannot be identified; {suggest(name, CANDIDATES)}'
            )
        if names.count(name) > 1:
            raise IdentificationError(f'--fit: {name} is given twice')


def choose(information: Floats, names: Sequence[str]) -> tuple[str, ...]:
    """Return the parameters that the data can tell apart.

    One after another is taken, the most wanted first in `names`, if then the intervals of all taken
    ones are narrow enough, and not much wider than if each were the only unknown. The information,
    shape (p, p), is that of all of them relative to their scales.
    """
    chosen: list[int] = []
    for number in range(len(names)):
        together = [*chosen, number]
        half_widths = _half_widths(information[np.ix_(together, together)])
        alone = np.array([_half_widths(information[[[each]], [[each]]])[0] for each in together])
        allowed = np.minimum(MARGIN * MAX_HALF_WIDTH, MAX_INFLATION * alone)
        if (half_widths <= allowed).all():
            chosen = together
    return tuple(names[number] for number in chosen)


def _half_widths(information: Floats) -> Floats:
    """Return half of the width of each interval; infinite if there is no information."""
    size = np.sqrt(np.diag(information))
    if not size.all():
        return np.full(len(size), np.inf)
    normal = information / np.outer(size, size)
    if np.linalg.cond(normal) > _MAX_CONDITION:
        return np.full(len(size), np.inf)
    return np.asarray(_TWO_SIGMA * np.sqrt(np.diag(np.linalg.inv(normal))) / size)


def _judged(
    names: Sequence[str],
    chosen: Mapping[str, float],
    information: Floats,
    start: Mapping[str, float],
    plant: PlantParameters,
    recorded: PlantParameters | None,
) -> tuple[IdentifiedParameter, ...]:
    """Return what the data say of each parameter.

    Parameters
    ----------
    chosen : mapping of str to float
        Half of the width of the interval of each estimated one, relative to its scale.
    information : ndarray, shape (p, p)
        Of all parameters, relative to their scales.
    plant, recorded : PlantParameters
        With the present values, and those of the recorded robot if they are known.
    """
    found = []
    for number, name in enumerate(names):
        value = getattr(plant, name)
        alike: tuple[str, ...] = ()
        if name in chosen:
            relative = chosen[name]
            narrow = relative <= MAX_HALF_WIDTH
            verdict = Identifiability.IDENTIFIED if narrow else Identifiability.UNCERTAIN
        else:
            relative = float(_half_widths(information[[[number]], [[number]]])[0])
            verdict = Identifiability.NOT_SEEN
            if relative <= MAX_HALF_WIDTH:
                verdict = Identifiability.NOT_TOLD_APART
                alike = _alike(name, names, list(chosen), information)
        found.append(
            IdentifiedParameter(
                name=name,
                unit=parameters_of(PLANT)[name].unit,
                verdict=verdict,
                start=start[name] if name in chosen else value,
                value=value if name in chosen else None,
                half_width=relative * _scale(name, value),
                relative=relative,
                alike=alike,
                recorded=None if recorded is None else getattr(recorded, name),
            )
        )
    return tuple(found)


def _alike(
    name: str, names: Sequence[str], chosen: Sequence[str], information: Floats
) -> tuple[str, ...]:
    """Return the estimated parameters that a change of another one would change most."""
    rows = [names.index(each) for each in chosen]
    changes = np.linalg.solve(information[np.ix_(rows, rows)], information[rows, names.index(name)])
    return tuple(
        each for each, change in zip(chosen, changes, strict=True) if abs(change) >= MIN_LIKENESS
    )


def _summary(
    segments: Segments,
    begin: Mapping[str, float],
    found: Mapping[str, float],
    fit: ExperimentFit | None = None,
) -> ExperimentSummary:
    """Return how well segments are described with the values at the start and the found ones.

    `fit` is the estimation that used the experiment, if one did.
    """
    experiment = segments.experiment
    notes = [*experiment.notes]
    if segments.count < MIN_SEGMENTS:
        turning = ' and both encoders turn' if experiment.plant.backlash else ''
        needed = MIN_SEGMENTS * segment_length(experiment) * experiment.reading_s
        notes.append(
            f'Only {segments.seconds:.1f} s in which the robot balances undisturbed{turning}; an '
            f'identification needs {needed:g} s.'
        )
    if fit and fit.noise.get(GYRO, math.inf) < LITTLE_NOISE:
        notes.append(
            'The gyro shows hardly any noise. The errors of rounding then depend on the motion, '
            'and the intervals can be too narrow.'
        )
    deviations = []
    for values in (begin, found):
        plant = experiment.plant.with_values({name: values[name] for name in found})
        deviations.append(_deviations(segments, plant))
    before, after = deviations
    return ExperimentSummary(
        name=experiment.name,
        seconds=segments.seconds,
        segments=segments.count,
        dropped=fit.dropped if fit else 0,
        before=before,
        after=after,
        units={channel.name: channel.unit for channel in experiment.readings},
        notes=tuple(notes),
    )


def _deviations(segments: Segments, plant: PlantParameters) -> dict[str, float]:
    """Return the root mean square of each channel's residuals; NaN without segments."""
    unknown = {channel.name: math.nan for channel in segments.experiment.readings}
    if not segments.count:
        return unknown
    fit = ExperimentFit(SegmentModel(segments))
    fit.settle(plant)
    if not fit.model.segments.count:
        return unknown
    return {channel.name: value for channel, value in fit.deviations(plant).items()}


def _projected(estimator: Estimator, names: Sequence[str]) -> list[Residuals]:
    """Return residuals and derivatives by parameters, without what the segments' unknowns take."""
    plant = estimator.plant(estimator.fits[0])
    scales = {name: _scale(name, getattr(plant, name)) for name in names}
    return [each.without_unknowns() for each in estimator.linearised(scales)]


def _columns(residuals: Residuals, names: Sequence[str], chosen: Sequence[str]) -> Residuals:
    """Return the residuals with the derivatives by the chosen parameters only."""
    numbers = [*(names.index(name) for name in chosen), len(names)]
    return residuals._replace(by_parameter=residuals.by_parameter[:, :, numbers])


def _scale(name: str, value: float) -> float:
    """Return a value of the usual size of a parameter."""
    return max(abs(value), TYPICAL.get(name, 0.0))


def _bounds(name: str) -> tuple[float, float]:
    bounds = parameters_of(PLANT)[name].bounds
    assert bounds
    # An estimate that may only be too large would be biased.
    return (-np.inf, bounds[1]) if name in TYPICAL else bounds
