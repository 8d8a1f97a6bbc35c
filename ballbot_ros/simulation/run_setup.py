"""The components and settings of a run."""

from __future__ import annotations

from dataclasses import dataclass

from ballbot_ros.parameters import PlantParameters
from ballbot_ros.plant.plant import Plant
from ballbot_ros.scenario.scenario import Scenario
from ballbot_ros.simulation.participants import Participant
from ballbot_ros.timing import SECOND_NS
from ballbot_ros.world.world import World


@dataclass(frozen=True)
class RunSettings:
    """Settings of a run.

    Attributes
    ----------
    duration_ns : int or None
        Length of the run [ns]; None for an endless run.
    push_ns : int
        Duration of an external push [ns].
    timeout_s, startup_timeout_s : float
        Silence after which the run fails, while it ticks and before its first tick [s].
    waits_for_silent : bool
        Whether the run waits for a silent participant instead of failing.
    """

    duration_ns: int | None
    real_time_factor: float
    push_ns: int
    timeout_s: float
    startup_timeout_s: float
    waits_for_silent: bool
    requires_recorder: bool

    @classmethod
    def from_parameters(cls, parameters: PlantParameters) -> RunSettings:
        """Return the settings in the parameters of ``plant_sim``."""
        return cls(
            duration_ns=round(parameters.duration * SECOND_NS) or None,
            real_time_factor=parameters.real_time_factor,
            push_ns=round(parameters.push_duration * SECOND_NS),
            timeout_s=parameters.timeout,
            startup_timeout_s=parameters.startup_timeout,
            waits_for_silent=parameters.on_timeout == 'wait',
            requires_recorder=parameters.require_recorder,
        )


@dataclass(frozen=True)
class RunSetup:
    """Components of a run; without a world, the floor is unlimited and without walls."""

    settings: RunSettings
    plant: Plant
    world: World | None
    scenario: Scenario
    participant: Participant
    ball_radius: float
