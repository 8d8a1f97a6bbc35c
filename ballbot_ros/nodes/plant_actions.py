"""Carries out the decisions of the master of a run: publishes, logs, reports, sets the timer."""

from __future__ import annotations

from functools import singledispatchmethod
from typing import TYPE_CHECKING

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

    @singledispatchmethod
    def _carry_out(self, action: do.Action) -> None:
        raise NotImplementedError(action)

    @_carry_out.register
    def _(self, action: do.PublishTruth) -> None:
        truth = action.truth
        self._messages.truth(truth, wall_hit=action.wall_hit, is_resend=action.is_resend)
        self._node.count_sample(truth.stamp_ns)

    @_carry_out.register
    def _(self, action: do.ResendToDrivers) -> None:
        self._messages.send_to_drivers(action.truth)

    @_carry_out.register
    def _(self, action: do.WakeIn) -> None:
        self._wake.start(action.delay_s)

    @_carry_out.register
    def _(self, action: do.CancelWake) -> None:
        self._wake.cancel()

    @_carry_out.register
    def _(self, action: do.CallRoll) -> None:
        self._roll_call.publish(encode_header(action.run.start_ns, action.run.name))
        announcement = Announcement(action.plant, action.run.name)
        self._participants.publish(encode_announcement(announcement))

    @_carry_out.register
    def _(self, action: do.AnnounceRun) -> None:
        self._messages.announce(action.run.start_ns, action.run.name)

    @_carry_out.register
    def _(self, action: do.PublishStatus) -> None:
        self._status.publish(encode_run_status(run_status(action)))

    @_carry_out.register
    def _(self, action: do.ClearMap) -> None:
        self._node.drop_latched(MAP)

    @_carry_out.register
    def _(self, action: do.BeginRun) -> None:
        self._messages.ball_radius = action.ball_radius
        self._messages.begin(action.start_ns, action.world)

    @_carry_out.register
    def _(self, action: do.PublishPush) -> None:
        self._messages.push(action.push, action.number)

    @_carry_out.register
    def _(self, action: do.StopMotors) -> None:
        self._messages.stop_motors(action.last_ns)

    @_carry_out.register
    def _(self, action: do.Log) -> None:
        logger = self._node.get_logger()
        if action.severity is do.Severity.INFO:
            logger.info(action.text)
        elif action.is_throttled:
            logger.warning(action.text, throttle_duration_sec=1.0)
        else:
            logger.warning(action.text)

    @_carry_out.register
    def _(self, action: do.Warn) -> None:
        self._node.warn(action.text)

    @_carry_out.register
    def _(self, action: do.ClearWarning) -> None:
        self._node.clear_warning()

    @_carry_out.register
    def _(self, action: do.RaiseError) -> None:
        self._node.report_error(action.text)

    @_carry_out.register
    def _(self, action: do.ClearError) -> None:
        self._node.clear_error()

    @_carry_out.register
    def _(self, action: do.Report) -> None:
        self._node.report()

    @_carry_out.register
    def _(self, action: do.EndRun) -> None:
        self._node.finish()
        if action.summary.reason:
            self._node.fail(action.summary.reason)
        else:
            self._node.report()
        self._node.exit_status = action.exit_status
