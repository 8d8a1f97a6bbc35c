"""The shipped scenarios' hashes, which every machine must reproduce."""

from __future__ import annotations

import yaml

from ballbot_ros.parameters import PLANT
from ballbot_ros.scenario.scenario import Scenario
from ballbot_ros.share import share_directory
from ballbot_ros.simulation.closed_loop import ClosedLoop
from ballbot_ros.simulation.timing import SECOND_NS, TICK_NS
from ballbot_ros.simulation.trajectory import TrajectoryLog

GOLDEN_FILE = 'config/duty_sha256.yaml'


def golden_hashes() -> dict[str, str]:
    """Return the ``duty_sha256`` of each shipped scenario by its name."""
    text = (share_directory() / GOLDEN_FILE).read_text(encoding='utf-8')
    return dict(yaml.safe_load(text))


def duty_sha256(scenario: Scenario) -> str:
    """Run a scenario in this process and return its ``duty_sha256``."""
    loop, log = ClosedLoop(scenario.parameters, scenario), TrajectoryLog(keep=False)
    ticks = round(scenario.parameters.values(PLANT)['duration'] * SECOND_NS) // TICK_NS
    for _ in range(ticks):
        tick = loop.tick()
        log.add(tick.truth, *tick.outputs.duty)
        if loop.plant.stopped:
            break
    return log.duty_sha256
