"""Nodes in the process of a command: all of a run on one executor, or one on a thread."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Thread

import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation

from ballbot_ros.controllers.codegen.implementation import implementation_for
from ballbot_ros.errors import BallbotError, one_line
from ballbot_ros.nodes.base import AnyNode, spin
from ballbot_ros.nodes.controller import ControllerNode
from ballbot_ros.nodes.end_guard import guarded_end
from ballbot_ros.nodes.endpoints import IntraProcess
from ballbot_ros.nodes.middleware import prepare_middleware, stay_local
from ballbot_ros.nodes.plant_sim import PlantSim
from ballbot_ros.nodes.processes import join_thread
from ballbot_ros.nodes.recorder import Recorder
from ballbot_ros.nodes.registry import make_node
from ballbot_ros.parameters import (
    CONTROLLER,
    PLANT,
    RECORDER,
    ControllerParameters,
    PlantParameters,
    RecorderParameters,
)
from ballbot_ros.parameters.timing import SECOND_NS, TICK_NS
from ballbot_ros.process import PROGRESS_PERIOD_S, StopRequest
from ballbot_ros.run.graph import call_for_external, graph_parameters
from ballbot_ros.run.observer import RunObserver
from ballbot_ros.run.result import RunResult
from ballbot_ros.run.spec import RunSpec
from ballbot_ros.run.tick_timer import TickTimer

RCLError = rclpy_implementation.RCLError


@contextmanager
def ros(log_level: str = 'WARN') -> Iterator[None]:
    """Provide rclpy for the nodes of this process; by default they discover only this machine.

    It raises BallbotError if ROS can't start here, for example without a folder for its logs.
    """
    stay_local()
    if rclpy.ok():
        yield
        return
    prepare_middleware()
    with guarded_end():
        try:
            rclpy.init(
                args=['--ros-args', '--log-level', log_level],
                signal_handler_options=rclpy.SignalHandlerOptions.NO,
            )
        except RuntimeError as error:
            raise BallbotError(one_line(error)) from None
        try:
            yield
        except RCLError as error:  # for example, a profile that Fast DDS refuses
            raise BallbotError(one_line(error)) from None
        finally:
            rclpy.try_shutdown()


END_S = 1.0
"""Time for a callback to return [s]; Python may abort if the thread still runs at its end."""


class NodeThread:
    """Runs a node's callbacks until it is closed; `error` says why the thread ended early."""

    def __init__(self, node: AnyNode) -> None:
        self._node = node
        self.error: BaseException | None = None
        self._end = rclpy.Future()
        self._thread = Thread(target=self._spin, name=node.get_name(), daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        try:
            spin([self._node], self._end)
        except BaseException as error:
            self.error = error
            self._node.finish()

    def close(self) -> None:
        """End the node."""
        self._end.set_result(None)
        join_thread(self._thread, END_S)
        self._node.close()
        self._node.destroy_node()


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
            make_implementation = partial(implementation_for, loaded=spec.controller)
            for name in spec.nodes:
                if name == CONTROLLER:
                    settings = parameters.of(ControllerParameters)
                    nodes.append(ControllerNode(settings, make_implementation))
                elif name not in (PLANT, RECORDER):
                    nodes.append(make_node(parameters.of_node(name)))
            for node in nodes:
                # The observer knows whether the result says it.
                node.logs_failure = node.role not in (PLANT, CONTROLLER)
            if recording:
                recorder = Recorder(parameters.of(RecorderParameters))
                nodes.append(recorder)
            plant.create_wall_timer(
                PROGRESS_PERIOD_S,
                lambda: observer.update(plant.master.log.ticks * TICK_NS / SECOND_NS),
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
    result = RunResult.from_summary(plant.summary, plant.master.log.trajectory())
    if recorder and recorder.failure and result.is_complete:
        result = result.failed(f'{RECORDER}: {recorder.failure}')
    if plant.exit_status == 2:
        return replace(result, failure_status=2)
    return replace(result, failure_status=128 + stop.signal) if stop.signal else result
