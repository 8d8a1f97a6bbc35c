"""Requests of the transport bar of a live page."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ballbot_ros.viewer.overlay import ChooseRate, Press, Request
from ballbot_ros.viewer.run_activity import PAUSE, RATES, RESET, STEP, RunActivity

if TYPE_CHECKING:  # viser takes a second to import
    from ballbot_ros.viewer.live_controls import PlantControls


def carry_out(request: Request, activity: RunActivity, plant: PlantControls) -> None:
    """Ask the plant for what is requested, during this activity; other requests do nothing."""
    match request:
        case Press(name) if name == PAUSE:
            plant.pause(not activity.is_paused)
        case Press(name) if name == STEP:
            plant.step()
        case Press(name) if name == RESET:
            plant.reset()
        case ChooseRate(rate) if rate in RATES:
            plant.set_real_time_factor(RATES[rate])
