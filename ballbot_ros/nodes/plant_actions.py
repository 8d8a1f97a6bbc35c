"""Carries out the decisions of the master of a run: publishes, logs, reports, sets the timer."""

from __future__ import annotations

from typing import TYPE_CHECKING, NoReturn

from ballbot_ros.messages.conversions import encode_header
from ballbot_ros.messages.participation import encode_announcement, encode_run_status
from ballbot_ros.messages.plant_messages import PlantMessages
from ballbot_ros.messages.run_summary import run_status
from ballbot_ros.messages.topics import MAP, PARTICIPANTS, ROLL_CALL, RUN_STATUS
from ballbot_ros.nodes.one_shot import OneShotTimer
from ballbot_ros.simulation import run_actions as do
from ballbot_ros.simulation.participants import Announcement

if TYPE_CHECKING:
    from ballbot_ros.nodes.plant_sim import PlantSim


class PlantActions:
    """Executes the master's actions in the plant's node."""

    def __init__(self, node: PlantSim, wake: OneShotTimer) -> None:
        self._node, self._wake = node, wake
        self._messages = PlantMessages(lambda topic: node.output(topic).send)
        self._participants = node.output(PARTICIPANTS)
        self._status = node.output(RUN_STATUS)
        self._roll_call = node.output(ROLL_CALL)

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
                self._participants.publish(encode_announcement(Announcement(plant, run.name)))
            case do.AnnounceRun(run):
                messages.announce(run.start_ns, run.name)
            case do.PublishStatus():
                self._status.publish(encode_run_status(run_status(action)))
            case do.ClearMap():
                node.drop_latched(MAP)
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
        if action.severity is do.Severity.INFO:
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
