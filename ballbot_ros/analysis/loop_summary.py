"""The loop in words and numbers: margins of the ideal loop next to those of the loop that runs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

from ballbot_ros.parameters import (
    ControllerParameters,
    EncoderParameters,
    GyroParameters,
    ParameterSet,
    PlantParameters,
)

if TYPE_CHECKING:  # python-control takes two seconds to import
    from ballbot_ros.controllers.design.loop_analysis import Limit, LoopAnalysis, Margins, Pole

IDEAL, AS_IT_RUNS = 'ideal, continuous', 'as it runs'
"""Headings of the two loops."""


class MarginRow(NamedTuple):
    """A margin of both loops, and the frequency at which the one that runs oscillates."""

    name: str
    ideal: str
    sampled: str
    frequency: str


def margin_rows(ideal: LoopAnalysis, sampled: LoopAnalysis) -> list[MarginRow]:
    """Return the margins of the ideal loop next to those of the loop that runs."""
    columns = _margins(ideal), _margins(sampled)
    return [
        MarginRow(name, value, *others)
        for name, (value, _), others in zip(_NAMES, *columns, strict=True)
    ]


_NAMES = (
    'gain', 'phase', 'dead time, motors', 'dead time, gyro', 'dead time, encoders',
    'disk margin', 'sensitivity peak',
)  # fmt: skip


def _margins(loop: LoopAnalysis) -> list[tuple[str, str]]:
    """Return each margin, and the frequency at which the loop then oscillates."""
    margins = loop.margins
    if margins is None:
        return [('not stable', ''), *[('–', '')] * (len(_NAMES) - 1)]
    gains = margins.gain_low, margins.gain_high
    phase, peak = margins.phase_deg, margins.sensitivity
    return [
        (
            ' … '.join(_number(each.value) for each in gains),
            ' … '.join(filter(None, (_hertz(each.hz) for each in gains))),
        ),
        (f'{_number(phase.value)}°', _hertz(phase.hz)),
        *(
            (f'{_number(each.value)} ms', _hertz(each.hz)) if each else ('–', '')
            for each in _dead_times(loop, margins)
        ),
        (_number(margins.disk), ''),
        (_number(peak.value), _hertz(peak.hz)),
    ]


def _dead_times(loop: LoopAnalysis, margins: Margins) -> tuple[Limit | None, ...]:
    """Return the additional dead times of motors, gyro and encoders that the loop bears."""
    samples = loop.samples
    return (
        margins.dead_time_ms,
        samples.gyro_dead_time_ms if samples else None,
        samples.encoder_dead_time_ms if samples else None,
    )


def findings(sampled: LoopAnalysis) -> Iterator[str]:
    """Yield what limits the loop that runs, a sentence each."""
    if pole := sampled.unstable:
        if pole.is_growing:
            how = f' at {_hertz(pole.oscillation_hz)}' if pole.oscillation_hz else ''
            yield f'Unstable: pole {complex_text(pole.value)} grows{how}.'
        else:
            yield f'Not stable: what belongs to the pole {complex_text(pole.value)} never decays.'
    if pole := sampled.ringing:
        yield (
            f'Rings at {_hertz(pole.oscillation_hz)}: pole {complex_text(pole.value)}, '
            f'damping {_number(pole.damping)}.'
        )
    if margins := sampled.margins:
        for change, limit in _changes(sampled, margins):
            yield f'{change}: oscillates at {_hertz(limit.hz)}.'
    if samples := sampled.samples:
        yield (
            f'Noise of one count of the gyro gives {_number(samples.gyro_noise)} % duty, of the '
            f'encoder {_number(samples.encoder_noise)} %; rounding to whole counts '
            f'{_number(samples.rounding_noise)} % (standard deviations).'
        )


def _changes(loop: LoopAnalysis, margins: Margins) -> Iterator[tuple[str, Limit]]:
    """Yield the changes at which the loop oscillates."""
    motors, gyro, encoders = _dead_times(loop, margins)
    for change, limit in (
        ('{} times the gain', margins.gain_high),
        ('{} times the gain', margins.gain_low),
        ('{} ms more dead time of the motors', motors),
        ('{} ms more dead time of the gyro', gyro),
        ('{} ms more dead time of the encoders', encoders),
    ):
        if limit and not math.isnan(limit.hz):
            yield change.format(_number(limit.value)), limit


RINGS = 'rings'


class PredictedFrequency(NamedTuple):
    """A frequency [Hz] at which a loop oscillates, and the reason: its own, or after a change."""

    hz: float
    reason: str


def predictions(sampled: LoopAnalysis) -> list[PredictedFrequency]:
    """Return the frequencies to look for in a run of the loop."""
    found = []
    if (pole := sampled.unstable) and pole.oscillation_hz:
        found.append(PredictedFrequency(pole.oscillation_hz, 'grows'))
    if pole := sampled.ringing:
        found.append(PredictedFrequency(pole.oscillation_hz, RINGS))
    if margins := sampled.margins:
        found += [
            PredictedFrequency(limit.hz, change) for change, limit in _changes(sampled, margins)
        ]
    return found


def neglected(parameters: ParameterSet) -> list[str]:
    """Return what a run with these parameters has and the linear model does not."""
    plant, own = parameters.of(PlantParameters), parameters.of(ControllerParameters)
    jitters = (
        plant.actuator_delay_jitter,
        parameters.of(GyroParameters).delay_jitter,
        parameters.of(EncoderParameters).delay_jitter,
    )
    present = {
        'the dead zone': plant.dead_zone > 0.0,
        'the gear play': plant.backlash > 0.0,
        'pwm_offset': own.pwm_offset > 0.0,
        'the draining battery': plant.battery_model == 'draining',
        'the variation of the dead times (jitter), which count with their means': any(jitters),
    }
    return [name for name, is_present in present.items() if is_present]


def complex_text(value: complex) -> str:
    """Return a pole, or the pair that it belongs to, with 4 digits."""
    real = f'{value.real + 0.0:.4g}'.replace('-', '−')
    if abs(value.imag) < 1e-9:
        return real
    return f'{real} ± {abs(value.imag):.4g}j'


def single_poles(poles: tuple[Pole, ...]) -> list[Pole]:
    """Return the poles with one of each conjugate pair."""
    return [pole for pole in poles if pole.value.imag >= 0.0]


def _number(value: float) -> str:
    if math.isinf(value):
        return '∞'
    return f'{value:.3g}'


def _hertz(hz: float) -> str:
    return '' if math.isnan(hz) else f'{hz:.3g} Hz'
