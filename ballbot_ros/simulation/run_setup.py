"""The components and parameters of a run."""

from __future__ import annotations

from dataclasses import dataclass

from ballbot_ros.engine.plant import Plant
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.scenario.scenario import Scenario
from ballbot_ros.simulation.participants import Participant
from ballbot_ros.world.world import World


@dataclass(frozen=True)
class RunSetup:
    """Components of a run; without a world, the floor is unlimited and without walls."""

    parameters: PlantParameters
    plant: Plant
    world: World | None
    scenario: Scenario
    participant: Participant
