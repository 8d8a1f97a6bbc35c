"""Runs a scenario with every node in this process, on one executor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from ballbot_ros.cli.experiment import Experiment
from ballbot_ros.cli.graph import graph_parameters, ros, write_attachments
from ballbot_ros.cli.progress import UPDATE_S, Progress
from ballbot_ros.nodes.base import AnyNode, spin
from ballbot_ros.nodes.controller import Controller
from ballbot_ros.nodes.encoder_driver import EncoderDriver
from ballbot_ros.nodes.gamepad_teleop import GamepadTeleop
from ballbot_ros.nodes.gyro_driver import GyroDriver
from ballbot_ros.nodes.plant_sim import PlantSim
from ballbot_ros.nodes.recorder import Recorder
from ballbot_ros.nodes.sonar_driver import SonarDriver
from ballbot_ros.parameters import (
    CONTROLLER,
    ENCODER,
    GAMEPAD,
    GYRO,
    RECORDER,
    SONAR,
    PlantParameters,
    RecorderParameters,
)
from ballbot_ros.simulation.outcome import Outcome
from ballbot_ros.simulation.run_result import RunResult
from ballbot_ros.simulation.timing import SECOND_NS, TICK_NS
from ballbot_ros.stop_request import StopRequest

_DRIVERS: dict[str, Callable[[Any], AnyNode]] = {
    GYRO: GyroDriver,
    ENCODER: EncoderDriver,
    SONAR: SonarDriver,
    GAMEPAD: GamepadTeleop,
    CONTROLLER: Controller,
}
"""What makes each node from its parameters."""


def run_in_one_process(experiment: Experiment, scratch: Path, progress: Progress) -> RunResult:
    """Run the graph in this process."""
    write_attachments(experiment, scratch)
    parameters = graph_parameters(experiment, scratch)
    nodes: list[AnyNode] = []
    recorder: Recorder | None = None
    with ros():
        try:
            plant = PlantSim(parameters.of(PlantParameters))
            nodes.append(plant)
            nodes += [make(parameters.of_node(name)) for name, make in _DRIVERS.items()]
            if experiment.recording:
                recorder = Recorder(parameters.of(RecorderParameters))
                nodes.append(recorder)
            plant.every(UPDATE_S, lambda: progress.update(plant.log.ticks * TICK_NS / SECOND_NS))
            with StopRequest() as stop:
                spin(nodes, plant.done, stop)
            plant.stop()
        finally:
            for node in nodes:
                node.close()
                node.destroy_node()
    result = RunResult.of_plant(plant.summary, plant.log.trajectory())
    if recorder and recorder.failure and result.outcome is Outcome.COMPLETED:
        result = result.failed(f'{RECORDER}: {recorder.failure}')
    if plant.exit_status == 2:
        return replace(result, exit_status=2)
    return replace(result, exit_status=128 + stop.signal) if stop.signal else result
