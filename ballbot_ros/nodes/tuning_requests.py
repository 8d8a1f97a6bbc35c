"""Requests of the page to the controller: what can be tuned, and other values for it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import ParameterDescriptor, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from rclpy.parameter import parameter_value_to_python

from ballbot_ros.messages.parameter_events import decode_parameter_event
from ballbot_ros.messages.participation import decode_announcement
from ballbot_ros.messages.topics import HISTORY, PARAMETER_EVENTS, PARTICIPANTS
from ballbot_ros.nodes.base import AnyNode
from ballbot_ros.nodes.topic_publisher import reliable_qos
from ballbot_ros.nodes.viewer_requests import QUERY_RETRY_S, send, setting
from ballbot_ros.parameters import CONTROLLER, parameters_of
from ballbot_ros.simulation.participants import TUNABLE, Announcement
from ballbot_ros.viewer.tunable import Numbers, Tunable

if TYPE_CHECKING:  # viser takes a second to import
    from ballbot_ros.viewer.tuning_sliders import TuningSliders

SETTLE_S = 1.0
"""A slider that has been moved follows other changes again after this time."""

_SERVICES = {
    DescribeParameters: 'describe_parameters',
    GetParameters: 'get_parameters',
    SetParameters: 'set_parameters',
}
_REAL = {ParameterType.PARAMETER_DOUBLE, ParameterType.PARAMETER_DOUBLE_ARRAY}
_NUMERIC = {*_REAL, ParameterType.PARAMETER_INTEGER}


class TuningRequests:
    """Finds out what the controller of each run can tune, follows its values, and sets others.

    Parameters
    ----------
    notify : callable
        Tells the viewers that a value was refused.
    sliders : TuningSliders
        Shows the parameters and their values, and says which others are wanted.
    """

    def __init__(
        self,
        node: AnyNode,
        notify: Callable[[str], None],
        sliders: TuningSliders,
    ) -> None:
        self._node, self._notify, self._sliders = node, notify, sliders
        self._clients: dict[tuple[str, Any], Any] = {}
        self._nodes: dict[str, str] = {}
        self._controller = ('', '')
        self._query: Announcement | None = None
        self._queried_at = -math.inf
        self._tunables: dict[str, Tunable] = {}
        self._present: dict[str, Numbers] = {}
        self._set_at: dict[str, float] = {}
        node.create_subscription(
            PARTICIPANTS.message_class,
            PARTICIPANTS.name,
            self._on_participant,
            reliable_qos(HISTORY, latched=True),  # a viewer may start in mid-run
            raw=True,
        )
        node.subscribe(PARAMETER_EVENTS, self._on_event, depth=HISTORY, raw=True)

    def send_queued(self) -> None:
        """Send the numbers that the page wants, and an unanswered query again."""
        for name, numbers in self._sliders.take().items():
            self._set(name, numbers)
        now_s = time.monotonic()
        for name, set_at in list(self._set_at.items()):
            if now_s - set_at > SETTLE_S:
                del self._set_at[name]
                self._sliders.follow({name: self._present[name]})
        if self._query and now_s - self._queried_at >= QUERY_RETRY_S:
            self._queried_at = now_s
            self._send_query(self._query)

    def _on_participant(self, data: bytes) -> None:
        try:
            announcement = decode_announcement(data)
        except ValueError as error:
            self._node.warn_malformed(PARTICIPANTS, error)
            return
        participant = announcement.participant
        self._nodes[participant.role] = participant.node
        joined = (announcement.run, participant.instance)
        if participant.role == CONTROLLER and joined != self._controller:
            self._controller = joined
            self._query, self._queried_at = announcement, -math.inf

    def _send_query(self, announcement: Announcement) -> None:
        """Ask the controller for the descriptions and values of what it can tune."""
        node, names = announcement.participant.node, _tunable_names(announcement)
        if not names:
            self._take(announcement, [], [])
            return

        def take_descriptions(described: DescribeParameters.Response) -> None:
            request = GetParameters.Request(names=names)
            self._call(
                node,
                request,
                lambda got: self._take(announcement, described.descriptors, got.values),
            )

        self._call(node, DescribeParameters.Request(names=names), take_descriptions)

    def _take(
        self,
        announcement: Announcement,
        descriptors: Sequence[ParameterDescriptor],
        values: Sequence[ParameterValue],
    ) -> None:
        if announcement is not self._query:
            return
        self._query = None
        start = announcement.participant.parameters
        # The values of a node that lacks one of its parameters would be in no known order.
        pairs = zip(descriptors, values, strict=False) if len(descriptors) == len(values) else ()
        tunables = [
            _tunable(descriptor, value, start.get(descriptor.name))
            for descriptor, value in pairs
            if descriptor.type in _NUMERIC
        ]
        self._tunables = {each.name: each for each in tunables}
        self._present = {each.name: each.value for each in tunables}
        self._set_at.clear()
        self._sliders.show(tunables)

    def _on_event(self, data: bytes) -> None:
        try:
            values = decode_parameter_event(data)
        except ValueError as error:
            self._node.warn_malformed(PARAMETER_EVENTS, error)
            return
        elsewhere = {}
        for name, value in values.items():
            if name not in self._present or not _is_like(value, self._present[name]):
                continue  # another node may publish anything
            self._present[name] = _numbers(value)
            if name not in self._set_at:  # else the slider that set it may have moved on
                elsewhere[name] = self._present[name]
        if elsewhere:
            self._sliders.follow(elsewhere)

    def _set(self, name: str, numbers: Numbers) -> None:
        """Set a parameter in the controller, and in the nodes that share it."""
        tunable = self._tunables.get(name)
        if tunable is None:
            return
        value = tunable.ros_value(numbers)
        self._set_at[name] = time.monotonic()
        row = parameters_of(CONTROLLER).get(name)
        for role in row.nodes if row else (CONTROLLER,):
            if role in self._nodes:
                self._call(
                    self._nodes[role],
                    setting(name, value),
                    lambda answer: self._take_answer(name, numbers, answer),
                )

    def _take_answer(self, name: str, numbers: Numbers, answer: SetParameters.Response) -> None:
        for result in answer.results:
            if result.successful:
                self._present[name] = numbers
            else:
                self._notify(result.reason)
                self._sliders.follow({name: self._present[name]})

    def _call(self, node: str, request: Any, on_response: Callable[[Any], None]) -> None:
        kind = next(kind for kind in _SERVICES if isinstance(request, kind.Request))
        if (node, kind) not in self._clients:
            service = f'{node}/{_SERVICES[kind]}'
            self._clients[node, kind] = self._node.create_client(kind, service)
        is_there = send(self._clients[node, kind], request, on_response)
        if kind is SetParameters and not is_there:
            self._notify(f'{node}: service not available')


def _tunable_names(announcement: Announcement) -> list[str]:
    names = announcement.participant.parameters.get(TUNABLE)
    return [name for name in names if isinstance(name, str)] if isinstance(names, list) else []


def _tunable(descriptor: ParameterDescriptor, value: ParameterValue, start: object) -> Tunable:
    ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
    low, high = (ranges[0].from_value, ranges[0].to_value) if ranges else (-math.inf, math.inf)
    present = parameter_value_to_python(value)
    numbers = _numbers(present)
    return Tunable(
        descriptor.name,
        descriptor.description,
        low,
        high,
        _numbers(start) if _is_like(start, numbers) else numbers,
        numbers,
        is_whole=descriptor.type not in _REAL,
        is_array=descriptor.type == ParameterType.PARAMETER_DOUBLE_ARRAY,
    )


def _is_like(value: object, numbers: Numbers) -> bool:
    values = value if isinstance(value, list | tuple) else [value]
    return len(values) == len(numbers) and all(
        isinstance(each, int | float) and not isinstance(each, bool) and math.isfinite(each)
        for each in values
    )


def _numbers(value: Any) -> Numbers:
    return tuple(value) if hasattr(value, '__len__') else (value,)
