"""The names of the metrics on which expectations are set; `analysis` computes them."""

from __future__ import annotations

from collections.abc import Mapping

SETTLED_DEG = 1.0

METRICS: Mapping[str, str] = {
    'settling_time_s': f'time after the release until both pitches stay within ±{SETTLED_DEG:g}°',
    'peak_pitch_deg': 'largest body pitch of either plane after the release',
    'steady_pitch_rms_deg': 'root mean square of the pitch over the second half after the release',
    'position_rms_m': "root mean square of the ball's distance from its start after the release",
    'peak_position_m': 'largest distance of the ball from its start after the release',
    'final_position_x_m': 'position on plane x at the end, from the start',
    'final_position_y_m': 'position on plane y at the end, from the start',
    'duty_rms_percent': 'root mean square of the duties of both motors after the release',
    'duty_saturated_share': 'share of duties after the release that are at ±100 %',
}
