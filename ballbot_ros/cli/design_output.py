"""What `ballbot design` prints: tables for people, or JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ballbot_ros.analysis.loop_figure import render_loop
from ballbot_ros.analysis.loop_summary import (
    AS_IT_RUNS,
    IDEAL,
    complex_text,
    findings,
    margin_rows,
    neglected,
    single_poles,
)
from ballbot_ros.controllers.design.linear_model import (
    PUBLISHED_GAIN,
    DesignError,
    ServoDesign,
    degree_state_space,
    design_servo,
)
from ballbot_ros.controllers.design.loop_analysis import (
    Limit,
    LoopAnalysis,
    Margins,
    SampleAnalysis,
    analyse_ideal,
    analyse_sampled,
    sorted_poles,
)
from ballbot_ros.controllers.design.sampled_loop import LoopDelays
from ballbot_ros.controllers.loading import public_reference
from ballbot_ros.parameters import (
    DOCUMENTS_PROGRAM,
    ControllerParameters,
    ParameterSet,
    PlantParameters,
)
from ballbot_ros.parameters.timing import TICK_MS
from ballbot_ros.robot.plant.model import Matrix, PhysicalParameters

GAIN_NAMES = ('θ', 'ψ', 'θ̇', 'ψ̇', '∫θ')

SHOWN_POLES = 12
"""Poles in the table: each dead time of a tick adds one."""


class DesignOutput:
    """The model of a plane, its servo gains and its loop, for parameters and a period of task_ts1.

    If it `is_redesigned`, the gains in use come from another design than section 4.2.
    """

    def __init__(
        self,
        parameters: ParameterSet,
        *,
        is_redesigned: bool = False,
        period_ms: float = TICK_MS,
    ) -> None:
        self._parameters, self._period_ms = parameters, period_ms
        self._in_use_heading = 'designed' if is_redesigned else 'in use'
        self._own = parameters.of(ControllerParameters)
        self._physical = PhysicalParameters.from_parameters(parameters.of(PlantParameters))
        self._servo: ServoDesign | DesignError
        try:
            self._servo = design_servo(self._physical)
        except DesignError as error:
            self._servo = error
        self._loops: tuple[LoopAnalysis, LoopAnalysis] | None = None
        if self._own.implementation in DOCUMENTS_PROGRAM:
            self._loops = analyse_ideal(parameters), analyse_sampled(parameters, period_ms)

    @property
    def _in_use(self) -> tuple[float, ...]:
        return (*self._own.k_f, self._own.k_i)

    def print(self) -> None:
        """Print the tables."""
        console = Console(highlight=False, markup=False)
        self._print_model(console)
        self._print_gains(console)
        if self._loops is None:
            reference = public_reference(self._own.implementation)
            console.print(
                f"The loop is known for the document's program only, not for {reference}."
            )
            return
        _, sampled = self._loops
        console.print(_margin_table(*self._loops))
        console.print(_pole_table(sampled, self._period_ms))
        for finding in findings(sampled):
            console.print(finding)
        if names := neglected(self._parameters):
            console.print(f'Not in this linear model: {", ".join(names)}.')

    def _print_model(self, console: Console) -> None:
        physical = self._physical
        a, b = degree_state_space(physical)
        title = Text('State equation (3.24)', 'bold')
        console.print(title + ', state θ ψ θ̇ ψ̇ in deg and deg/s, input in V')
        console.print(f'α = {physical.alpha:.6g} N·m/V   β = {physical.beta:.6g} N·m·s/rad')
        _print_matrix(console, 'A', a)
        _print_matrix(console, 'B', b)
        console.print(f'open-loop poles    {_poles(np.linalg.eigvals(a))} 1/s')

    def _print_gains(self, console: Console) -> None:
        table = Table(title='Servo gains', title_justify='left')
        for heading in ('', 'computed', 'published', self._in_use_heading):
            table.add_column(heading, justify='right')
        servo = self._servo
        if isinstance(servo, DesignError):
            console.print(f'section 4.2 gives no gains: {servo}')
            computed = ['–'] * len(GAIN_NAMES)
        else:
            console.print(f'closed-loop poles  {_poles(servo.poles)} 1/s')
            computed = [f'{gain:.8f}' for gain in servo.gain]
        rows = zip(GAIN_NAMES, computed, PUBLISHED_GAIN, self._in_use, strict=True)
        for name, gain, published, used in rows:
            table.add_row(name, gain, f'{published:g}', f'{used:.8f}')
        console.print(table)

    def plot(self) -> bytes:
        """Return the picture of the loop as PNG.

        It raises DesignError if the controller is another than the document's program.
        """
        _, sampled = self._loops or (None, analyse_sampled(self._parameters))
        return render_loop(self._parameters, sampled).png

    def as_json(self) -> dict[str, object]:
        """Return the content as JSON; an infinite number, or one that does not exist, is null."""
        physical = self._physical
        servo = None if isinstance(self._servo, DesignError) else self._servo
        a, b = degree_state_space(physical)
        return {
            'model': {
                'alpha': physical.alpha,
                'beta': physical.beta,
                'a': a.tolist(),
                'b': b.tolist(),
                'poles': [_pair(pole) for pole in np.linalg.eigvals(a)],
            },
            'gains': {
                'computed': servo and servo.gain.tolist(),
                'published': list(PUBLISHED_GAIN),
                'in_use': list(self._in_use),
                'poles': servo and [_pair(pole) for pole in servo.poles],
            },
            'delays_ms': asdict(LoopDelays.of(self._parameters)),
            'ideal': _loop_json(self._loops[0]) if self._loops else None,
            'as_it_runs': _loop_json(self._loops[1]) if self._loops else None,
            'findings': list(findings(self._loops[1])) if self._loops else [],
            'neglected': neglected(self._parameters),
        }  # fmt: skip


def _loop_json(loop: LoopAnalysis) -> dict[str, object]:
    return {
        'stable': loop.unstable is None,
        'poles': [
            {'value': _pair(pole.value), 'hz': pole.hz, 'damping': pole.damping}
            for pole in loop.poles
        ],
        'margins': loop.margins and _margins_json(loop.margins),
        'samples': loop.samples and _samples_json(loop.samples),
    }


def _margins_json(margins: Margins) -> dict[str, object]:
    return {
        'gain_low': _limit(margins.gain_low),
        'gain_high': _limit(margins.gain_high),
        'phase_deg': _limit(margins.phase_deg),
        'dead_time_ms': _limit(margins.dead_time_ms),
        'disk': margins.disk,
        'sensitivity_peak': _limit(margins.sensitivity),
    }


def _samples_json(samples: SampleAnalysis) -> dict[str, object]:
    return {
        'gyro_dead_time_ms': _limit(samples.gyro_dead_time_ms),
        'encoder_dead_time_ms': _limit(samples.encoder_dead_time_ms),
        'duty_percent_per_gyro_count': samples.gyro_noise,
        'duty_percent_per_encoder_count': samples.encoder_noise,
        'duty_percent_of_rounding': samples.rounding_noise,
    }


def _limit(limit: Limit) -> dict[str, float | None]:
    return {
        name: value if math.isfinite(value) else None for name, value in limit._asdict().items()
    }


def _pair(value: complex) -> list[float]:
    return [float(value.real), float(value.imag)]


def _margin_table(ideal: LoopAnalysis, sampled: LoopAnalysis) -> Table:
    table = Table('', title='Margins of the gains in use', title_justify='left')
    for heading in (IDEAL, AS_IT_RUNS, 'oscillates at'):
        table.add_column(heading, justify='right')
    for row in margin_rows(ideal, sampled):
        table.add_row(*row)
    return table


def _pole_table(loop: LoopAnalysis, period_ms: float) -> Table:
    poles = single_poles(loop.poles)
    slowest = sorted(poles, key=lambda pole: pole.decay)[:SHOWN_POLES]
    more = f'{len(poles) - len(slowest)} more decay faster' if len(poles) > len(slowest) else None
    table = Table(
        title=f'Poles of the loop that runs, every {period_ms:g} ms', title_justify='left',
        caption=more, caption_justify='left',
    )  # fmt: skip
    for heading in ('z', '|z|', 'natural [Hz]', 'damping'):
        table.add_column(heading, justify='right')
    for pole in sorted(slowest, key=poles.index):
        table.add_row(
            complex_text(pole.value),
            f'{abs(pole.value):.5f}',
            f'{pole.hz:.3g}',
            f'{pole.damping:.3g}'.replace('-', '−'),
        )
    return table


def _print_matrix(console: Console, name: str, matrix: Matrix) -> None:
    for index, row in enumerate(matrix):
        label = f'{name} =' if index == 0 else ''
        console.print(f'{label:>4} ' + ' '.join(f'{value + 0.0:12.6g}' for value in row))


def _poles(values: Iterable[complex]) -> str:
    """Return poles of a continuous system, from slow to fast, each conjugate pair as one word."""
    poles = sorted_poles(values)
    return '   '.join(complex_text(pole.value) for pole in single_poles(poles))
