"""The plant: owns sim time, moves the robot, and waits for the duty of each tick."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NoReturn

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from ballbot_ros.engine.plant import Plant
from ballbot_ros.engine.scenario.reader import scenario_of
from ballbot_ros.engine.trajectory import save_trajectory
from ballbot_ros.errors import BallbotError, os_errors
from ballbot_ros.lockstep import run_actions as do
from ballbot_ros.lockstep.free_running import FreeRunningMaster
from ballbot_ros.lockstep.lockstep import DEPTH
from ballbot_ros.lockstep.lockstep_master import LockstepMaster
from ballbot_ros.lockstep.participants import Announcement
from ballbot_ros.lockstep.run_actions import Actions, RunSetup
from ballbot_ros.lockstep.run_master import RunMaster
from ballbot_ros.nodes.base import BallbotNode
from ballbot_ros.nodes.middleware import DomainLock
from ballbot_ros.nodes.participation import GraphObserver, participant_of, with_parameters
from ballbot_ros.nodes.processes import (
    HEARTBEAT_S,
    Heartbeat,
    HeartbeatSender,
    LocalProcessObserver,
)
from ballbot_ros.parameters import PLANT, PlantParameters
from ballbot_ros.parameters.timing import RESEND_S, SECOND_NS, TICK_S
from ballbot_ros.recording.messages import topics
from ballbot_ros.recording.messages.conversions import (
    decode_duty,
    encode_header,
    is_stop,
    push_forces,
    stamp_ns,
    time_ns,
)
from ballbot_ros.recording.messages.raw import stamp_of
from ballbot_ros.recording.messages.run_messages import PlantMessages
from ballbot_ros.recording.messages.run_reports import (
    decode_announcement,
    decode_parameter_event,
    encode_announcement,
    encode_run_status,
    run_status,
    summary_json,
    summary_words,
)
from ballbot_ros.recording.messages.topics import Topic
from ballbot_ros.recording.schemas import Header, WrenchStamped
from ballbot_ros.robot.brick.faults import faults_of
from ballbot_ros.robot.world.world import World


class OneShotTimer:
    """Calls back once after each :meth:`start`, on the wall clock."""

    def __init__(self, node: Node, callback: Callable[[], None]) -> None:
        self._callback = callback
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(1.0, self._fire, clock=steady, autostart=False)

    def start(self, delay_s: float) -> None:
        """Call back in `delay_s` [s]; this replaces a pending call."""
        self._timer.timer_period_ns = max(1, round(delay_s * 1e9))
        self._timer.reset()

    def cancel(self) -> None:
        """Cancel the pending call."""
        self._timer.cancel()

    def _fire(self) -> None:
        self._timer.cancel()
        self._callback()


class PlantActions:
    """Executes the master's actions in the plant's node."""

    def __init__(self, node: PlantSim, wake: OneShotTimer) -> None:
        self._node, self._wake = node, wake
        self._messages = PlantMessages(lambda topic: node.output(topic).send)
        self._participants = node.output(topics.PARTICIPANTS)
        self._status = node.output(topics.RUN_STATUS)
        self._roll_call = node.output(topics.ROLL_CALL)

    def carry_out(self, actions: do.Actions) -> None:
        """Carry out actions in their order."""
        for action in actions:
            self._carry_out(action)

    def _carry_out(self, action: do.Action) -> None:
        node, messages = self._node, self._messages
        match action:
            case do.PublishTruth(truth, wall_hit, is_resend):
                messages.truth(truth, wall_hit=wall_hit, is_resend=is_resend)
                messages.send_unrecorded(truth)
                node.count_sample(truth.stamp_ns)
            case do.WakeIn(delay_s):
                self._wake.start(delay_s)
            case do.CancelWake():
                self._wake.cancel()
            case do.ResendToDrivers(truth):
                messages.send_to_drivers(truth)
                messages.send_unrecorded(truth)
            case do.CallRoll(run, plant):
                self._roll_call.publish(encode_header(run.start_ns, run.name))
                plant = plant.with_faults(node.parameters.faults)
                self._participants.publish(encode_announcement(Announcement(plant, run.name)))
            case do.AnnounceRun(run):
                messages.announce(run.start_ns, run.name)
            case do.PublishStatus():
                self._status.publish(encode_run_status(run_status(action)))
            case do.ClearMap():
                node.drop_latched(topics.MAP)
            case do.BeginRun(start_ns, world, ball_radius):
                messages.ball_radius = ball_radius
                messages.begin(start_ns, world)
            case do.PublishPush(push, number):
                messages.push(push, number)
            case do.StopMotors(last_ns):
                messages.stop_motors(last_ns)
            case do.Log():
                self._log(action)
            case do.Warn(text):
                node.warn(text)
            case do.ClearWarning():
                node.clear_warning()
            case do.RaiseError(text):
                node.report_error(text)
            case do.ClearError():
                node.clear_error()
            case do.Report():
                node.report()
            case do.EndRun():
                self._end(action)
            case _:
                _refuse(action)

    def _log(self, action: do.Log) -> None:
        logger = self._node.get_logger()
        if not action.is_warning:
            logger.info(action.text)
        elif action.is_throttled:
            logger.warning(action.text, throttle_duration_sec=1.0)
        else:
            logger.warning(action.text)

    def _end(self, action: do.EndRun) -> None:
        self._node.finish()
        if action.summary.reason:
            self._node.fail(action.summary.reason)
        else:
            self._node.report()
        self._node.exit_status = action.exit_status


def _refuse(action: NoReturn) -> NoReturn:
    # The type of the argument lets mypy find an action that is not handled.
    raise NotImplementedError(action)


class PlantEvents:
    """Subscriptions and services of the plant's node.

    The services are ``plant_sim/reset``, ``plant_sim/start``, ``plant_sim/pause`` and
    ``plant_sim/step``. They are named after the role, so they keep their names if the node is
    renamed.
    """

    def __init__(self, node: PlantSim) -> None:
        self._node, self._master = node, node.master
        # Deep enough to receive each of several duties of one tick.
        depth = DEPTH if self._master.is_lockstep else 1
        node.subscribe(topics.MOTOR_DUTY, self._on_duty, depth=depth, raw=True)
        node.subscribe(topics.RECORDER_ACK, self._on_ack)
        node.subscribe(topics.PUSH, self._on_push, depth=10)
        node.subscribe(topics.PARAMETER_EVENTS, self._on_retuned, depth=topics.HISTORY, raw=True)
        node.subscribe(topics.PARTICIPANTS, self._on_announcement, depth=topics.HISTORY, raw=True)
        for topic in (topics.RUN, topics.ROLL_CALL):
            node.subscribe(topic, self._run_callback(topic), depth=topics.HISTORY)
        for name, kind, callback in (
            ('reset', Trigger, self._reset),
            ('start', Trigger, self._start),
            ('pause', SetBool, self._pause),
            ('step', Trigger, self._step),
        ):
            node.create_service(kind, f'{PLANT}/{name}', callback)

    def _on_duty(self, data: bytes) -> None:
        try:
            stamp_ns = stamp_of(data)
        except ValueError as error:
            self._node.warn_malformed(topics.MOTOR_DUTY, error)
            return
        try:
            duty = decode_duty(data)
        except ValueError:
            duty = None
        self._node.dispatch(self._master.on_duty, stamp_ns, duty, data, is_stop=is_stop(data))

    def _on_ack(self, header: Header) -> None:
        self._node.dispatch(self._master.on_ack, time_ns(header.stamp))

    def _on_push(self, message: WrenchStamped) -> None:
        self._node.dispatch(self._master.on_push, stamp_ns(message), *push_forces(message))

    def _on_retuned(self, data: bytes) -> None:
        try:
            values = decode_parameter_event(data)
            self._node.dispatch(self._master.on_retuned, stamp_of(data), values)
        except ValueError as error:
            self._node.warn_malformed(topics.PARAMETER_EVENTS, error)

    def _on_announcement(self, data: bytes) -> None:
        try:
            announcement = decode_announcement(data)
        except ValueError as error:
            self._node.warn_malformed(topics.PARTICIPANTS, error)
            self._node.dispatch(self._master.on_unreadable_announcement)
            return
        self._node.dispatch(self._master.on_announcement, announcement)

    def _run_callback(self, topic: Topic) -> Callable[[Header], None]:
        return lambda header: self._node.dispatch(self._master.on_run, header.frame_id, topic.name)

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._node.dispatch(self._master.reset)
        response.success = True
        response.message = 'a new run begins'
        return response

    def _start(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._master.pause.awaits_start
        response.message = 'started' if response.success else 'the run is not paused at its start'
        self._node.dispatch(self._master.start)
        return response

    def _pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._node.dispatch(self._master.set_paused, is_paused=request.data)
        response.success = True
        response.message = 'paused' if request.data else 'running'
        return response

    def _step(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._master.pause.is_paused
        response.message = 'one tick' if response.success else 'pause the plant first'
        self._node.dispatch(self._master.step)
        return response


class PlantSim(BallbotNode[PlantParameters]):
    """Passes events to the master of the run, and carries out its decisions."""

    def __init__(self, parameters: PlantParameters | None = None) -> None:
        # Take the lock before the node becomes a participant of the domain.
        self._lock = DomainLock(rclpy.get_default_context().get_domain_id())
        super().__init__(PlantParameters, parameters)
        self._scenario = scenario_of(self.parameters.scenario)
        self._world = World.of(self.parameters)
        self._own = participant_of(self)
        wake = OneShotTimer(self, lambda: self.dispatch(self.master.on_wake))
        self._actions = PlantActions(self, wake)
        master = LockstepMaster if self.parameters.lockstep else FreeRunningMaster
        self.master: RunMaster = master(
            GraphObserver(self, tuple(topics.LOCKSTEP_PUBLISHERS)),
            LocalProcessObserver(),
            topics.RUN_TOPICS,
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
        self._on_time()  # the first participants may be there already

    def dispatch(self, event: Callable[..., Actions], *what: object, **details: object) -> None:
        """Pass an event to the master with the current time, and carry out the actions."""
        self._actions.carry_out(event(time.monotonic(), *what, **details))

    def _on_time(self) -> None:
        self.dispatch(self.master.on_time)

    def _send_heartbeat(self) -> None:
        master = self.master
        now_ns = master.time_ns if master.has_begun else 0
        self._heartbeats.send(Heartbeat(now_ns, has_ended=master.summary is not None))

    def check(self, parameters: PlantParameters) -> None:
        """Check that the scenario and the map exist, and that the robot can start there."""
        scenario_of(parameters.scenario)
        faults_of(parameters)
        World.of(parameters)

    def on_parameters_changed(self) -> None:
        """Apply the new pace, push duration and faults."""
        if self._free_timer is not None:
            self._free_timer.timer_period_ns = round(self._tick_s * SECOND_NS)
        self.dispatch(self.master.on_parameters, self.parameters)

    @property
    def _tick_s(self) -> float:
        """Period of the ticks of a free-running plant [s]."""
        return TICK_S / (self.parameters.real_time_factor or 1.0)

    def _set_up(self, start_ns: int) -> RunSetup:
        """Apply the parameters of a new run, and create its plant."""
        before, self.start_ns = self.parameters, start_ns
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
    def summary(self) -> Mapping[str, object]:
        """The outcome of the run as JSON, after its end."""
        return summary_json(self.master.summary) if self.master.summary else {}

    def diagnose(self) -> Mapping[str, object]:
        """Return the state of the run."""
        summary = self.master.summary
        return {**self.master.state(), **(summary_words(summary) if summary else {})}

    def stop(self) -> None:
        """End the run because the node is asked to stop."""
        self.dispatch(self.master.stop)

    def close(self) -> None:
        """Save the trajectory, and wait until the last messages have reached their readers."""
        self.stop()
        self._send_heartbeat()
        if path := self.parameters.trajectory_file:
            with os_errors(BallbotError, path):
                save_trajectory(Path(path), self.master.log.trajectory(), self.summary)
        # Flush the status of the run, too: it holds the outcome, which the recorder notes.
        self.flush(
            topics.CLOCK, topics.PLANT_IMU, topics.PLANT_JOINT_STATES, topics.PLANT_ODOM,
            *topics.UNRECORDED, topics.WALL_HIT, topics.MOTOR_DUTY, topics.RUN_STATUS,
            topics.DIAGNOSTICS,
        )  # fmt: skip
        self._lock.release()
