"""Former names of renamed metrics and keys, kept as aliases wherever programs read them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

Value = TypeVar('Value')
"""What is kept by name."""

FORMER_METRICS: Mapping[str, str] = {
    'truth_sent_again': 'resends',
    'peak_speed_m_s': 'peak_speed_m_per_s',
    'gyro_offset_error_x_deg_s': 'gyro_offset_error_x_deg_per_s',
    'gyro_offset_error_y_deg_s': 'gyro_offset_error_y_deg_per_s',
}
"""Metrics: former name to current name, as in all tables here."""

FORMER_RESULT_KEYS: Mapping[str, str] = {'missed_ticks': 'late_ticks', 'asked_again': 'resends'}
"""Keys in the JSON of a run."""

FORMER_PLANT_KEYS: Mapping[str, str] = {
    'overruns': 'late ticks',
    'missed_ticks': 'late ticks',
    'asked again': 'resends',
    'asked_again': 'resends',
}
"""Keys in the diagnostics of the plant."""

FORMER_CONTROLLER_KEYS: Mapping[str, str] = {
    'overruns': 'late ticks',
    'answers sent again': 'resends',
}
"""Keys in the diagnostics of the controller."""


def current_metric(name: str) -> str:
    """Return the current name of a metric, given its current or a former name."""
    return FORMER_METRICS.get(name, name)


def with_former_names(values: Mapping[str, Value], former: Mapping[str, str]) -> dict[str, Value]:
    """Return `values`, with each renamed value also under its former names."""
    aliases = {old: values[name] for old, name in former.items() if name in values}
    return {**values, **aliases}


def without_former_names(
    values: Mapping[str, Value], former: Mapping[str, str]
) -> dict[str, Value]:
    """Return the values without each former name whose current name is present, too."""
    return {name: value for name, value in values.items() if former.get(name) not in values}


def with_current_names(values: Mapping[str, Value], former: Mapping[str, str]) -> dict[str, Value]:
    """Return `values` of any version, with each renamed value also under its current name."""
    renamed = {name: values[old] for old, name in former.items() if old in values}
    return {**renamed, **values}
