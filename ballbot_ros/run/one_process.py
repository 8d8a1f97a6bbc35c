"""Running a scenario with all nodes in this process, on one executor."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

from ballbot_ros.codegen.implementation import implementation_for
from ballbot_ros.controllers.loading import LoadedController
from ballbot_ros.nodes.base import AnyNode, spin
from ballbot_ros.nodes.controller import Controller
from ballbot_ros.nodes.intra_process import IntraProcess
from ballbot_ros.nodes.plant_sim import PlantSim
from ballbot_ros.nodes.recorder import Recorder
from ballbot_ros.nodes.registry import make_node
from ballbot_ros.parameters import (
    CONTROLLER,
    PLANT,
    RECORDER,
    ControllerParameters,
    ParameterSet,
    PlantParameters,
    RecorderParameters,
)
from ballbot_ros.progress import PROGRESS_PERIOD_S
from ballbot_ros.run.graph import call_for_external, graph_parameters
from ballbot_ros.run.observer import RunObserver
from ballbot_ros.run.result import RunResult
from ballbot_ros.run.ros_context import ros
from ballbot_ros.run.spec import RunSpec
from ballbot_ros.run.tick_timer import TickTimer
from ballbot_ros.stop_request import StopRequest
from ballbot_ros.timing import SECOND_NS, TICK_NS


def run_in_one_process(
    spec: RunSpec, recording: Path | None, scratch: Path, observer: RunObserver
) -> RunResult:
    """Run the graph in this process."""
    parameters = graph_parameters(spec, recording, scratch)
    nodes: list[AnyNode] = []
    recorder: Recorder | None = None
    with ros(), IntraProcess([*spec.nodes, PLANT]) as within:
        try:
            call_for_external(spec, observer)
            plant = PlantSim(parameters.of(PlantParameters))
            nodes.append(plant)
            others = [name for name in spec.nodes if name not in (PLANT, RECORDER)]
            nodes += [_make_node(name, parameters, spec.controller) for name in others]
            for node in nodes:
                # The observer knows whether the result says it.
                node.logs_failure = node.role not in (PLANT, CONTROLLER)
            if recording:
                recorder = Recorder(parameters.of(RecorderParameters))
                nodes.append(recorder)
            plant.create_wall_timer(
                PROGRESS_PERIOD_S, lambda: observer.update(plant.log.ticks * TICK_NS / SECOND_NS)
            )
            with StopRequest() as stop, TickTimer(spec.controller, spec.plant, stop):
                spin(nodes, plant.done, stop, within)
            plant.stop()
            for node in nodes:
                if node.failure and not node.logs_failure:
                    observer.notice(f'{node.role}: {node.failure}')
        finally:
            for node in nodes:
                node.close()
                node.destroy_node()
    result = RunResult.from_summary(plant.summary, plant.log.trajectory())
    if recorder and recorder.failure and result.is_complete:
        result = result.failed(f'{RECORDER}: {recorder.failure}')
    if plant.exit_status == 2:
        return replace(result, failure_status=2)
    return replace(result, failure_status=128 + stop.signal) if stop.signal else result


def _make_node(name: str, parameters: ParameterSet, composed: LoadedController | None) -> AnyNode:
    if name != CONTROLLER:
        return make_node(parameters.of_node(name))
    make_implementation = partial(implementation_for, loaded=composed)
    return Controller(parameters.of(ControllerParameters), make_implementation)
