"""Names of earlier versions, which remain as aliases wherever programs read them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

Value = TypeVar('Value')

FORMER_METRICS: Mapping[str, str] = {
    'truth_sent_again': 'resends',
    'peak_speed_m_s': 'peak_speed_m_per_s',
    'gyro_offset_error_x_deg_s': 'gyro_offset_error_x_deg_per_s',
    'gyro_offset_error_y_deg_s': 'gyro_offset_error_y_deg_per_s',
}
"""Current names of metrics by their former ones, like all tables here."""

FORMER_RESULT_KEYS: Mapping[str, str] = {'missed_ticks': 'late_ticks', 'asked_again': 'resends'}
"""The JSON of a run."""

FORMER_PLANT_KEYS: Mapping[str, str] = {
    'overruns': 'late ticks',
    'missed_ticks': 'late ticks',
    'asked again': 'resends',
    'asked_again': 'resends',
}
"""The diagnostics of the plant."""

FORMER_CONTROLLER_KEYS: Mapping[str, str] = {
    'overruns': 'late ticks',
    'answers sent again': 'resends',
}
"""The diagnostics of the controller."""


def current_metric(name: str) -> str:
    """Return the current name of a metric, which may be given by its former one."""
    return FORMER_METRICS.get(name, name)


def with_former_names(values: Mapping[str, Value], former: Mapping[str, str]) -> dict[str, Value]:
    """Return the values, also under the former names of those that are renamed."""
    aliases = {old: values[name] for old, name in former.items() if name in values}
    return {**values, **aliases}


def without_former_names(
    values: Mapping[str, Value], former: Mapping[str, str]
) -> dict[str, Value]:
    """Return the values without those that are also there under their current names."""
    return {name: value for name, value in values.items() if former.get(name) not in values}


def with_current_names(values: Mapping[str, Value], former: Mapping[str, str]) -> dict[str, Value]:
    """Return the values that were written by any version, also under their current names."""
    renamed = {name: values[old] for old, name in former.items() if old in values}
    return {**renamed, **values}
