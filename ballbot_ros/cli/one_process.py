"""Runs a scenario with every node in this process, on one executor."""

from __future__ import annotations

from pathlib import Path

from ballbot_ros.cli.experiment import Experiment, Finished
from ballbot_ros.cli.graph import graph_parameters, ros, write_attachments
from ballbot_ros.cli.progress import UPDATE_S, Progress
from ballbot_ros.nodes.base import BallbotNode, spin
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
    PLANT,
    RECORDER,
    SONAR,
)
from ballbot_ros.simulation.timing import SECOND_NS, TICK_NS
from ballbot_ros.stop_request import StopRequest

_DRIVERS = {
    GYRO: GyroDriver,
    ENCODER: EncoderDriver,
    SONAR: SonarDriver,
    GAMEPAD: GamepadTeleop,
    CONTROLLER: Controller,
}


def run_in_one_process(experiment: Experiment, scratch: Path, progress: Progress) -> Finished:
    """Run the graph in this process."""
    write_attachments(experiment, scratch)
    parameters = graph_parameters(experiment, scratch)
    nodes: list[BallbotNode] = []
    recorder: Recorder | None = None
    with ros():
        try:
            plant = PlantSim(parameters.values(PLANT))
            nodes.append(plant)
            nodes += [make(parameters.values(name)) for name, make in _DRIVERS.items()]
            if experiment.recording:
                recorder = Recorder(parameters.values(RECORDER))
                nodes.append(recorder)
            plant.every(UPDATE_S, lambda: progress.update(plant.log.ticks * TICK_NS / SECOND_NS))
            with StopRequest() as stop:
                spin(nodes, plant.done, stop)
            plant.stop()
        finally:
            for node in nodes:
                node.close()
                node.destroy_node()
    summary = {**plant.summary, 'exit_status': 128 + stop.signal if stop.signal else 1}
    if plant.exit_status == 2:
        summary['exit_status'] = 2
    if recorder and recorder.failure and summary['outcome'] == 'completed':
        summary.update(outcome='failed', reason=f'{RECORDER}: {recorder.failure}')
    return Finished(summary, plant.log.trajectory())
