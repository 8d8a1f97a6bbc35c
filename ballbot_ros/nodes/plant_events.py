"""Passes the messages and requests that the plant's node receives to the master of a run."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from std_srvs.srv import SetBool, Trigger

from ballbot_ros.messages.conversions import decode_duty, push_forces, stamp_ns, time_ns
from ballbot_ros.messages.message_types import Header, WrenchStamped
from ballbot_ros.messages.motor_stop import is_stop
from ballbot_ros.messages.parameter_events import decode_parameter_event
from ballbot_ros.messages.participation import decode_announcement
from ballbot_ros.messages.raw import stamp_of
from ballbot_ros.messages.topics import (
    HISTORY,
    MOTOR_DUTY,
    PARAMETER_EVENTS,
    PARTICIPANTS,
    PUSH,
    RECORDER_ACK,
    ROLL_CALL,
    RUN,
    Topic,
)
from ballbot_ros.parameters import PLANT
from ballbot_ros.simulation.sample_history import DEPTH

if TYPE_CHECKING:
    from ballbot_ros.nodes.plant_sim import PlantSim


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
        node.subscribe(MOTOR_DUTY, self._on_duty, depth=depth, raw=True)
        node.subscribe(RECORDER_ACK, self._on_ack)
        node.subscribe(PUSH, self._on_push, depth=10)
        node.subscribe(PARAMETER_EVENTS, self._on_retuned, depth=HISTORY, raw=True)
        node.subscribe(PARTICIPANTS, self._on_announcement, depth=HISTORY, raw=True)
        for topic in (RUN, ROLL_CALL):
            node.subscribe(topic, self._run_callback(topic), depth=HISTORY)
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
            self._node.warn_malformed(MOTOR_DUTY, error)
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
            self._node.warn_malformed(PARAMETER_EVENTS, error)

    def _on_announcement(self, data: bytes) -> None:
        try:
            announcement = decode_announcement(data)
        except ValueError as error:
            self._node.warn_malformed(PARTICIPANTS, error)
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
