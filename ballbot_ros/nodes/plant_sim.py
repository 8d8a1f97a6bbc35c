"""The plant: owns sim time, moves the robot, and waits for the duty of each tick."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import rclpy

from ballbot_ros.engine.plant import Plant
from ballbot_ros.errors import BallbotError
from ballbot_ros.messages.run_summary import summary_json, summary_words
from ballbot_ros.messages.run_topics import RUN_TOPICS
from ballbot_ros.messages.topics import (
    CLOCK,
    DIAGNOSTICS,
    LOCKSTEP_PUBLISHERS,
    MOTOR_DUTY,
    PLANT_IMU,
    PLANT_JOINT_STATES,
    PLANT_ODOM,
    RUN_STATUS,
    UNRECORDED,
    WALL_HIT,
)
from ballbot_ros.nodes.base import BallbotNode, run_node
from ballbot_ros.nodes.domain_lock import DomainLock
from ballbot_ros.nodes.graph_observer import GraphObserver
from ballbot_ros.nodes.heartbeat import HEARTBEAT_S, Heartbeat, HeartbeatSender
from ballbot_ros.nodes.one_shot import OneShotTimer
from ballbot_ros.nodes.participation import participant_of, with_parameters
from ballbot_ros.nodes.plant_actions import PlantActions
from ballbot_ros.nodes.plant_events import PlantEvents
from ballbot_ros.nodes.processes import LocalProcessObserver
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.scenario.library import scenario_of
from ballbot_ros.simulation.free_running_master import FreeRunningMaster
from ballbot_ros.simulation.lockstep_master import LockstepMaster
from ballbot_ros.simulation.run_actions import Actions
from ballbot_ros.simulation.run_master import RunMaster
from ballbot_ros.simulation.run_setup import RunSetup
from ballbot_ros.simulation.trajectory import TrajectoryLog, save_trajectory
from ballbot_ros.timing import RESEND_S, SECOND_NS, TICK_S
from ballbot_ros.world.world import World


class PlantSim(BallbotNode[PlantParameters]):
    """Passes events to the master of the run, and carries out its decisions."""

    def __init__(self, parameters: PlantParameters | None = None) -> None:
        # Take the lock before the node becomes a participant of the domain.
        self._lock = DomainLock(rclpy.get_default_context().get_domain_id())
        super().__init__(PlantParameters, parameters)
        self._scenario = scenario_of(self.parameters.scenario)
        self._world = World.of(self.parameters)
        self._own = participant_of(self)
        self._actions = PlantActions(self, OneShotTimer(self, self._on_wake))
        master = LockstepMaster if self.parameters.lockstep else FreeRunningMaster
        self.master: RunMaster = master(
            GraphObserver(self, tuple(LOCKSTEP_PUBLISHERS)),
            LocalProcessObserver(),
            RUN_TOPICS,
            self._set_up,
            f'{time.time_ns():x}',
            time.monotonic(),
        )
        PlantEvents(self)
        self.create_wall_timer(RESEND_S, self._on_time)
        self._heartbeats = HeartbeatSender()
        if self._heartbeats.file is not None:
            self.create_wall_timer(HEARTBEAT_S, self._send_heartbeat)
        self._free_timer = None
        if isinstance(self.master, FreeRunningMaster):
            on_tick = self.master.on_tick
            self._free_timer = self.create_wall_timer(self._tick_s, lambda: self.dispatch(on_tick))

    def dispatch(self, event: Callable[..., Actions], *what: object, **details: object) -> None:
        """Pass an event to the master with the current time, and carry out the actions."""
        self._actions.carry_out(event(time.monotonic(), *what, **details))

    def _on_time(self) -> None:
        self.dispatch(self.master.on_time)

    def _send_heartbeat(self) -> None:
        master = self.master
        now_ns = master.time_ns if master.has_begun else 0
        self._heartbeats.send(Heartbeat(now_ns, has_ended=master.summary is not None))

    def _on_wake(self) -> None:
        self.dispatch(self.master.on_wake)

    def check(self, parameters: PlantParameters) -> None:
        """Check that the scenario and the map exist, and that the robot can start there."""
        scenario_of(parameters.scenario)
        World.of(parameters)

    def on_parameters_changed(self) -> None:
        """Apply the new pace and push duration."""
        if self._free_timer is not None:
            self._free_timer.timer_period_ns = round(self._tick_s * SECOND_NS)
        self.dispatch(self.master.on_parameters, self.parameters)

    @property
    def _tick_s(self) -> float:
        """Period of the ticks of a free-running plant [s]."""
        return TICK_S / (self.parameters.real_time_factor or 1.0)

    def _set_up(self, start_ns: int) -> RunSetup:
        """Apply the parameters of a new run, and create its plant."""
        before = self.parameters
        self.apply_parameters()
        if self.parameters != before:
            self._scenario = scenario_of(self.parameters.scenario)
            self._world = World.of(self.parameters)
        return RunSetup(
            parameters=self.parameters,
            plant=Plant(self.parameters, start_ns, self._world),
            world=self._world,
            scenario=self._scenario,
            participant=with_parameters(self._own, self.parameters),
        )

    @property
    def log(self) -> TrajectoryLog:
        """The trajectory of the current run so far."""
        return self.master.log

    @property
    def summary(self) -> Mapping[str, object]:
        """The outcome of the run as JSON, after its end."""
        return summary_json(self.master.summary) if self.master.summary else {}

    def diagnose(self) -> Mapping[str, object]:
        """Return the state of the run."""
        master = self.master
        return {
            'run': master.number,
            'run name': master.run_name,
            'sim time [s]': f'{master.time_ns / SECOND_NS:.3f}',
            'ticks': master.log.ticks,
            'late ticks': master.late_ticks,
            'resends': master.resends,
            'fallen': master.is_fallen,
            'paused': master.pause.is_paused,
            'awaits start': master.pause.awaits_start,
            'pace': master.pace,
            'missing': ' '.join(master.missing),
            **(summary_words(master.summary) if master.summary else {}),
        }

    def stop(self) -> None:
        """End the run because the node is asked to stop."""
        self.dispatch(self.master.stop)

    def close(self) -> None:
        """Save the trajectory, and wait until the last messages have reached their readers."""
        self.stop()
        self._send_heartbeat()
        if path := self.parameters.trajectory_file:
            try:
                save_trajectory(Path(path), self.log.trajectory(), self.summary)
            except OSError as error:
                raise BallbotError(f'{path}: {error.strerror}') from None
        # Flush the status of the run, too: it holds the outcome, which the recorder notes.
        self.flush(
            CLOCK, PLANT_IMU, PLANT_JOINT_STATES, PLANT_ODOM, *UNRECORDED, WALL_HIT, MOTOR_DUTY,
            RUN_STATUS, DIAGNOSTICS,
        )  # fmt: skip
        self._lock.release()


def main() -> None:
    """Run the node."""
    sys.exit(run_node(PlantSim))
