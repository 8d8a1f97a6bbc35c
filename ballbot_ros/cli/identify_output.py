"""What `ballbot identify` prints: tables for people, JSON, or a parameter file."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.console import Console, JustifyMethod
from rich.table import Column, Table

from ballbot_ros.analysis.identification.identification import (
    MAX_HALF_WIDTH,
    ExperimentSummary,
    Identifiability,
    Identification,
    IdentifiedParameter,
)
from ballbot_ros.cli.options import print_whole
from ballbot_ros.errors import printable
from ballbot_ros.parameters import PLANT, ParameterSet, parameters_of
from ballbot_ros.parameters.files import format_parameters

MAX_RATIO = 1.5
"""Residuals of a check, relative to those of the fit, from which the values do not describe it: the
root mean square over the channels. Of two runs of one robot, a single channel can differ more: what
gear play adds to the encoder's residual depends on a few segments."""

_DIGITS = 2
"""Significant digits of half an interval."""

_EXACT = 1e-6
"""Half an interval, relative to the value, below which the value's digits are not all written."""

_WIDEST = 10.0
"""Half an interval, relative to the value, beyond which its width does not matter."""

_FIXED = 1e-3
"""Values from here on are written without an exponent."""


class IdentifyOutput:
    """An identification as text, JSON and parameter file."""

    def __init__(self, found: Identification) -> None:
        self._found = found

    @property
    def identified(self) -> tuple[IdentifiedParameter, ...]:
        """The parameters whose intervals are narrow enough to rely on."""
        return tuple(
            row for row in self._found.estimated if row.verdict is Identifiability.IDENTIFIED
        )

    def print(self) -> None:
        """Print recordings, verdicts, values and residuals."""
        console = Console(highlight=False, markup=False)
        found = self._found
        for number, (role, each) in enumerate(self._recordings, 1):
            console.print(_recording_line(number, role, each), soft_wrap=True)
            for note in each.notes:
                console.print(f'   {printable(note)}', soft_wrap=True)
        console.print(_verdict_table(found.parameters))
        if found.estimated:
            print_whole(console, _value_table(found.estimated))
            console.print(_residual_table(self._recordings))
        for line in self.warnings:
            console.print(f'warning: {line}', soft_wrap=True)

    @property
    def warnings(self) -> list[str]:
        """The checks that the values do not describe."""
        if not self._found.estimated:
            return []
        fits = self._found.experiments
        lines = []
        for check in self._found.checks:
            ratios = [
                residual / fitted
                for channel, residual in check.after.items()
                if (fitted := max(each.after.get(channel, 0.0) for each in fits)) > 0.0
            ]
            ratio = math.sqrt(sum(each**2 for each in ratios) / max(1, len(ratios)))
            if ratio > MAX_RATIO:
                lines.append(
                    f'the residuals of {printable(check.name)} are {ratio:.2g} times those of the '
                    f'fit, more than {MAX_RATIO:g}: the values do not describe this recording'
                )
        return lines

    @property
    def corrections(self) -> list[str]:
        """What the parameter file has instead of a value out of bounds."""
        return [
            f'{row.name} is below its bound: the file has {_number(_allowed(row))}'
            for row in self.identified
            if _allowed(row) != row.value
        ]

    @property
    def parameters(self) -> ParameterSet:
        """The identified parameters, within their bounds."""
        parameters = ParameterSet()
        for row in self.identified:
            parameters.set(PLANT, row.name, _allowed(row))
        return parameters

    def parameter_file(self) -> str:
        """Return a parameter file with the identified parameters."""
        return format_parameters(self.parameters, [PLANT], [row.name for row in self.identified])

    def as_json(self) -> dict[str, object]:
        """Return the content as JSON; a number that is not finite or does not exist is null."""
        found = self._found
        return {
            'parameters': {row.name: _parameter_json(row) for row in found.parameters},
            'recordings': [_recording_json(each) for each in found.experiments],
            'checks': [_recording_json(each) for each in found.checks],
            'warnings': self.warnings,
            'engine': found.engine.value,
            'correlation': {
                'names': [row.name for row in found.estimated],
                'matrix': [[_finite(value) for value in row] for row in found.correlation.tolist()],
            },
        }

    @property
    def _recordings(self) -> list[tuple[str, ExperimentSummary]]:
        return [
            *(('fitted', each) for each in self._found.experiments),
            *(('checked with', each) for each in self._found.checks),
        ]


def _recording_line(number: int, role: str, each: ExperimentSummary) -> str:
    segments = 'segment' if each.segments == 1 else 'segments'
    dropped = f', {each.dropped} dropped' if each.dropped else ''
    return (
        f'{number}  {printable(each.name)}  {role}: {each.seconds:.1f} s in {each.segments} '
        f'{segments}{dropped}'
    )


def _column(heading: str, justify: JustifyMethod = 'left') -> Column:
    return Column(heading, justify=justify, no_wrap=True)


def _verdict_table(rows: Sequence[IdentifiedParameter]) -> Table:
    table = Table(
        _column('parameter'), _column('verdict'), 'why',
        title='What the recordings tell', title_justify='left',
    )  # fmt: skip
    if any(row.value is None for row in rows):
        # The values of the others depend on it.
        table.add_column('kept at', justify='right', no_wrap=True)
    for row in rows:
        kept = [_number(row.start)] if row.value is None else []
        table.add_row(row.name, str(row.verdict), _reason(row), *kept)
    return table


def _reason(row: IdentifiedParameter) -> str:
    interval = f'{_percent(row.relative)} %'
    if row.verdict is Identifiability.NOT_TOLD_APART:
        return f'acts like {", ".join(row.alike) or "several together"}'
    if row.verdict is Identifiability.NOT_SEEN and not math.isfinite(row.relative):
        return 'no trace in the readings'
    if row.verdict is Identifiability.NOT_SEEN and row.relative > _WIDEST:
        return f'> ± {100.0 * _WIDEST:g} % as the only unknown'
    if row.verdict is Identifiability.NOT_SEEN:
        return f'{interval} as the only unknown'
    if row.verdict is Identifiability.UNCERTAIN:
        return f'{interval}, more than {100.0 * MAX_HALF_WIDTH:g} %'
    return interval


def _value_table(rows: Sequence[IdentifiedParameter]) -> Table:
    has_recorded = any(row.recorded is not None for row in rows)
    table = Table(
        _column('parameter'), _column('value', 'right'), _column('[%]', 'right'), _column('unit'),
        _column('start', 'right'), title='Values with 95 % intervals', title_justify='left',
    )  # fmt: skip
    if has_recorded:
        table.add_column('recorded', justify='right', no_wrap=True)
    for row in rows:
        assert row.value is not None
        cells = [
            row.name, with_interval(row.value, row.half_width), _percent(row.relative), row.unit,
            _number(row.start),
        ]  # fmt: skip
        if has_recorded:
            cells.append(_recorded(row))
        table.add_row(*cells, style='dim' if row.verdict is Identifiability.UNCERTAIN else None)
    return table


def with_interval(value: float, half_width: float) -> str:
    """Return value ± half width: two significant digits of the latter, the value as far as it.

    A value with an interval that is infinite or tiny has six digits.
    """
    if not _EXACT * abs(value) < half_width < math.inf:
        return f'{_number(value)} ± {_number(float(f"{half_width:.{_DIGITS - 1}e}"))}'
    exponent = 0
    if (largest := max(abs(value), half_width)) < _FIXED:
        exponent = math.floor(math.log10(largest))
    scale = 10.0**-exponent
    # Rounded first: 0.0996 has the two digits 0.10.
    half = float(f'{half_width * scale:.{_DIGITS - 1}e}')
    places = max(0, _DIGITS - 1 - math.floor(math.log10(half)))
    text = f'{value * scale + 0.0:.{places}f} ± {half:.{places}f}'.replace('-', '−')
    return f'({text})e{exponent}'.replace('e-', 'e−') if exponent else text


def _recorded(row: IdentifiedParameter) -> str:
    if row.recorded is None or row.value is None:
        return '–'
    return f'{_number(row.recorded)} {"✓" if row.covers_recorded else "✗"}'


def _residual_table(recordings: Sequence[tuple[str, ExperimentSummary]]) -> Table:
    table = Table(
        _column('recording'), _column('channel'), _column('at the start', 'right'),
        _column('with the values', 'right'), _column('unit'),
        title='Residuals, RMS', title_justify='left',
    )  # fmt: skip
    for number, (role, each) in enumerate(recordings, 1):
        if not each.segments:
            continue
        label = f'{number} {role}'
        for channel, before in each.before.items():
            after = each.after[channel]
            table.add_row(
                label, channel, _three_digits(before), _three_digits(after), each.units[channel]
            )  # fmt: skip
            label = ''
        table.add_section()
    return table


def _allowed(row: IdentifiedParameter) -> float:
    """Return the value, or the bound that it is below: estimates may come out slightly negative."""
    bounds = parameters_of(PLANT)[row.name].bounds
    assert bounds
    assert row.value is not None
    return max(row.value, bounds[0])


def _parameter_json(row: IdentifiedParameter) -> dict[str, object]:
    return {
        'verdict': str(row.verdict),
        'alike': list(row.alike),
        'value': _finite(row.value),
        'half_width': _finite(row.half_width),
        'relative': _finite(row.relative),
        'unit': row.unit,
        'start': _finite(row.start),
        'recorded': _finite(row.recorded),
        'recorded_inside': row.covers_recorded,
        'allowed': None if row.value is None else _allowed(row),
    }


def _recording_json(each: ExperimentSummary) -> dict[str, object]:
    return {
        'recording': each.name,
        'seconds': each.seconds,
        'segments': each.segments,
        'dropped': each.dropped,
        'notes': list(each.notes),
        'residuals': {
            channel: {
                'before': _finite(each.before[channel]),
                'after': _finite(each.after[channel]),
                'unit': each.units[channel],
            }
            for channel in each.before
        },
    }


def _finite(value: float | None) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None


def _number(value: float) -> str:
    return typeset(f'{value:.6g}')


def typeset(number: str) -> str:
    """Return a number with the signs of print for minus and infinity."""
    return number.replace('inf', '∞').replace('e-0', 'e-').replace('-', '−')


def _three_digits(value: float) -> str:
    return typeset(f'{value:#.3g}'.removesuffix('.'))


def _percent(relative: float) -> str:
    """Return a half width in percent."""
    percent = 100.0 * relative
    return typeset(f'± {percent:.3g}' if percent >= 10.0 else f'± {percent:.2g}')
