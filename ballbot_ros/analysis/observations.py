"""What a run shows, in sentences: its limit cycles, and why the estimated pitch is off."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ballbot_ros.analysis.estimate_offset import offset_reasons
from ballbot_ros.analysis.limit_cycle import LimitCycle, limit_cycles, lowest_hz
from ballbot_ros.analysis.loop_summary import RINGS, Prediction
from ballbot_ros.analysis.run_data import RunData
from ballbot_ros.messages.topics import CONTROLLER_STATE, MOTOR_DUTY, PLANT_IMU

_NEAR_OCTAVES = 0.5
"""Distance up to which a predicted frequency is named with a limit cycle."""


def observations(run: RunData, predicted: Sequence[Prediction]) -> list[str]:
    """Return the observations of a run, a sentence each.

    Parameters
    ----------
    run : RunData
    predicted : sequence of Prediction
        The frequencies that the analysis of its loop predicts.
    """
    return [*limit_cycle_sentences(run, predicted), *offset_reasons(run)]


def limit_cycle_sentences(run: RunData, predicted: Sequence[Prediction]) -> list[str]:
    """Return a sentence for each limit cycle, or that there is none.

    Without the controller's state, a limit cycle would look like a drive to and fro.
    """
    lowest = lowest_hz(run)
    if not {MOTOR_DUTY, PLANT_IMU, CONTROLLER_STATE} <= run.series.keys() or math.isinf(lowest):
        return []
    cycles = zip('xy', limit_cycles(run), strict=True)
    found = [_sentence(plane, cycle, predicted) for plane, cycle in cycles if cycle]
    explained = [
        f' The linear model of the loop rings at {each.hz:.3g} Hz: that oscillation dies away '
        'after each disturbance, whereas a limit cycle lasts.'
        for each in predicted
        if each.reason == RINGS
    ]
    return found or [f'No limit cycle found above {lowest:.2g} Hz.{"".join(explained)}']


def _sentence(plane: str, cycle: LimitCycle, predicted: Sequence[Prediction]) -> str:
    amplitudes = f'duty ±{cycle.duty:.3g} %, pitch ±{cycle.pitch:.2g}°'
    sentence = f'Limit cycle at {cycle.hz:.3g} Hz in plane {plane}: {amplitudes}.'
    near = [each for each in predicted if abs(math.log2(each.hz / cycle.hz)) < _NEAR_OCTAVES]
    if near:
        nearest = min(near, key=lambda each: abs(math.log2(each.hz / cycle.hz)))
        sentence += f' The nearest predicted frequency is {nearest.hz:.3g} Hz ({nearest.reason}).'
    return sentence
