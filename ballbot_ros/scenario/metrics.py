"""The names of the metrics on which expectations are set; `analysis` computes them."""

from __future__ import annotations

from collections.abc import Mapping

SETTLED_DEG = 1.0

METRICS: Mapping[str, str] = {
    'settling_time_s': f'time until both pitches stay within ±{SETTLED_DEG:g}°',
    'peak_pitch_deg': 'largest body pitch of either plane',
    'steady_pitch_rms_deg': 'root mean square of both pitches over the second half',
    'position_rms_m': "root mean square of the ball's distance from its start",
    'peak_position_m': 'largest distance of the ball from its start',
    'overshoot_m': 'how far the ball passes its final place, coming from the farthest from it',
    'station_rms_m': "root mean square of the ball's distance from its mean place, second half",
    'station_radius_m': 'largest distance of the ball from its mean place, second half',
    'final_position_x_m': 'position on plane x at the end, from the start',
    'final_position_y_m': 'position on plane y at the end, from the start',
    'distance_driven_m': "length of the ball's path",
    'peak_speed_m_s': 'largest speed of the ball',
    'wall_clearance_m': "smallest distance from the body's outline to a wall, to about 1 cm",
    'duty_rms_percent': 'root mean square of the duties of both motors',
    'duty_saturated_share': 'share of duties that are at ±100 %',
}
"""Names, and what they are; all are of the motion from the release, the end of `hold_time`, on."""

UNITS: Mapping[str, str] = {
    'm_s': 'm/s',
    'deg_s': '°/s',
    'ms': 'ms',
    's': 's',
    'deg': '°',
    'm': 'm',
    'percent': '%',
    'j': 'J',
    'v': 'V',
    'hz': 'Hz',
}
"""The units with which the names of metrics end, the longer endings first."""


def label(name: str) -> tuple[str, str]:
    """Return a metric's name in words, and its unit; the unit of a pure number is empty."""
    for ending, unit in UNITS.items():
        if name.endswith(f'_{ending}'):
            return name.removesuffix(f'_{ending}').replace('_', ' '), unit
    return name.replace('_', ' '), ''
