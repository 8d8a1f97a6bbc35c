"""Requests of the page to the graph, through services and topics."""

from __future__ import annotations

import math
import queue
import time
from collections.abc import Callable, Sequence
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterDescriptor, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter import parameter_value_to_python
from std_srvs.srv import SetBool, Trigger

from ballbot_ros.errors import BallbotError
from ballbot_ros.lockstep.participants import TUNABLE, Announcement, Participant
from ballbot_ros.nodes.base import AnyNode
from ballbot_ros.nodes.endpoints import reliable_qos
from ballbot_ros.nodes.participation import full_name
from ballbot_ros.nodes.supervisor import BACK as EARLIER
from ballbot_ros.parameters import CONTROLLER, PLANT, SUPERVISOR, PlantParameters, parameters_of
from ballbot_ros.parameters.timing import FIRST_TICK_NS, SECOND_NS
from ballbot_ros.recording.messages.conversions import encode_push
from ballbot_ros.recording.messages.run_reports import decode_announcement, decode_parameter_event
from ballbot_ros.recording.messages.topics import HISTORY, PARAMETER_EVENTS, PARTICIPANTS, PUSH, RUN
from ballbot_ros.robot.brick.faults import parse_fault, performer_of
from ballbot_ros.robot.plant.ground_truth import Pair
from ballbot_ros.viewer.overlay import ChooseRate, Press, Request, Seek
from ballbot_ros.viewer.run_activity import BACK, BACK_S, PAUSE, RATES, RESET, STEP, RunActivity
from ballbot_ros.viewer.tuning_sliders import Numbers, Tunable, TuningSliders, numbers_of

_PLANT_SERVICES = {
    f'{PLANT}/pause': SetBool,
    f'{PLANT}/step': Trigger,
    f'{PLANT}/reset': Trigger,
    f'{SUPERVISOR}/set_parameters': SetParameters,
    f'{SUPERVISOR}/start': Trigger,
}
_PARAMETER_SERVICES = {
    DescribeParameters: 'describe_parameters',
    GetParameters: 'get_parameters',
    SetParameters: 'set_parameters',
}

QUERY_RETRY_S = 1.0

DRAGGED_S = 0.3
"""A time chosen on the time line counts if no other one is chosen within this time."""

PARAMETERS_OF_PLANT = f'parameters of {PLANT}'


class ViewerRequests:
    """Queues requests from the page's threads; the node's thread sends them.

    The viewers are notified of a request that fails.
    """

    def __init__(self, node: AnyNode, notify: Callable[[str], None]) -> None:
        self._node = node
        self._notify = notify
        self._waiting: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._clients = {
            name: node.create_client(kind, name) for name, kind in _PLANT_SERVICES.items()
        }
        self._parameters = _ParameterClients(node)
        self._push = node.output(PUSH)
        self._had_plant = False
        self._query: tuple[Sequence[str], Callable[[PlantParameters], None]] | None = None
        self._queried_at = -math.inf
        self._sought: tuple[float, float] | None = None

    @property
    def lost_plant(self) -> bool:
        """Whether the plant has disappeared."""
        has_plant = self._clients[f'{PLANT}/pause'].service_is_ready()
        self._had_plant |= has_plant
        return self._had_plant and not has_plant

    def forget_plant(self) -> None:
        """Wait for the plant of another run, which may not have been discovered yet."""
        self._had_plant = False

    @property
    def can_start(self) -> bool:
        """Whether the graph can start another scenario."""
        return bool(self._clients[f'{SUPERVISOR}/start'].service_is_ready())

    def send_queued(self) -> None:
        """Send the queued requests."""
        while not self._waiting.empty():
            self._waiting.get()()
        self._send_query()
        if self._sought and time.monotonic() - self._sought[1] > DRAGGED_S:
            self._go_back(self._sought[0])

    def _go_back(self, seconds: float) -> None:
        """End the run, and let it go on from an earlier sim time [s]."""
        self._sought = None
        self.start(f'{EARLIER}{max(0.0, seconds - FIRST_TICK_NS / SECOND_NS):.3f}')

    def _call(
        self, name: str, request: object, on_response: Callable[[Any], None] = lambda response: None
    ) -> None:
        self._send(self._clients[name], name, request, on_response)

    def _send(
        self, client: object, name: str, request: object, on_response: Callable[[Any], None]
    ) -> None:
        if client is None or not send(client, request, on_response):
            self._notify(f'{name}: service not available')

    def carry_out(self, request: Request, activity: RunActivity) -> None:
        """Ask the plant for what is requested, during this activity; other requests do nothing."""
        match request:
            case Press(name) if name == PAUSE:
                pause = SetBool.Request(data=not activity.is_paused)
                self._waiting.put(lambda: self._call(f'{PLANT}/pause', pause))
            case Press(name) if name in (STEP, RESET):
                self._waiting.put(lambda: self._call(f'{PLANT}/{name}', Trigger.Request()))
            case Press(name) if name == BACK:
                self._go_back(activity.time - BACK_S)
            case Seek(seconds) if activity.session:
                self._sought = seconds, time.monotonic()
            case ChooseRate(rate) if rate in RATES:
                setting = parameter_setting('real_time_factor', RATES[rate])
                self._waiting.put(lambda: self._set_in_plant(setting))

    def _set_in_plant(self, setting: SetParameters.Request) -> None:
        client = self._parameters.of_plant(SetParameters)
        self._send(client, PARAMETERS_OF_PLANT, setting, self._notify_refusal)

    def _notify_refusal(self, response: SetParameters.Response) -> None:
        for result in response.results:
            if not result.successful:
                self._notify(f'{PARAMETERS_OF_PLANT}: {result.reason}')

    def push(self, force: Pair) -> None:
        """Push the body with a force [N] in plane signs."""
        self._waiting.put(lambda: self._push.publish(encode_push(self._node.now_ns, force)))

    def start(self, scenario: str) -> None:
        """End the run, and start one of another scenario."""

        def begin(_: object) -> None:
            self._call(f'{SUPERVISOR}/start', Trigger.Request(), report)

        def report(answer: Trigger.Response) -> None:
            if not answer.success:
                self._notify(answer.message)

        request = parameter_setting('scenario', scenario)
        self._waiting.put(lambda: self._call(f'{SUPERVISOR}/set_parameters', request, begin))

    def plant_parameters(
        self, names: Sequence[str], on_parameters: Callable[[PlantParameters], None]
    ) -> None:
        """Query parameters of the plant until it answers, and pass them to `on_parameters`.

        In what `on_parameters` receives, all parameters except `names` have their defaults.
        """
        self._query, self._queried_at = (names, on_parameters), -math.inf

    def _send_query(self) -> None:
        """Send the query, again after a while if it is unanswered.

        The plant's topics may appear before its services.
        """
        query, now_s = self._query, time.monotonic()
        if query is None or now_s - self._queried_at < QUERY_RETRY_S:
            return
        client = self._parameters.of_plant(GetParameters)
        if client is None or not client.service_is_ready():
            return
        self._queried_at = now_s
        names, on_parameters = query

        def take(response: GetParameters.Response) -> None:
            if query is not self._query:
                return
            self._query = None
            # Skip an answer without values: a player announces runs, too, but has none of the
            # plant's parameters.
            if len(response.values) == len(names):
                values = map(parameter_value_to_python, response.values)
                on_parameters(PlantParameters(**dict(zip(names, values, strict=True))))

        request = GetParameters.Request(names=names)
        self._send(client, PARAMETERS_OF_PLANT, request, take)


class _ParameterClients:
    """Clients of the parameter services of nodes, which are found some time after they are made."""

    def __init__(self, node: AnyNode) -> None:
        self._node = node
        self._clients: dict[tuple[str, Any], Any] = {}

    def of(self, name: str, kind: Any) -> Any:
        """Return the client of a service of the node with this full name."""
        if (name, kind) not in self._clients:
            service = f'{name}/{_PARAMETER_SERVICES[kind]}'
            self._clients[name, kind] = self._node.create_client(kind, service)
        return self._clients[name, kind]

    def of_plant(self, kind: Any) -> Any:
        """Return that of the plant, which announces runs; None while its name is unknown."""
        offers = self._node.get_publishers_info_by_topic(RUN.name)
        name = next(filter(None, map(full_name, offers)), '')
        found = {each: self.of(name, each) for each in (SetParameters, GetParameters) if name}
        return found.get(kind)


def send(client: Any, request: object, on_response: Callable[[Any], None]) -> bool:
    """Send a request to a service; return whether the service is there."""
    if not client.service_is_ready():
        return False
    client.call_async(request).add_done_callback(lambda future: on_response(future.result()))
    return True


def parameter_setting(name: str, value: object) -> SetParameters.Request:
    """Return the request that sets a parameter."""
    message: Parameter = RosParameter(name, value=value).to_parameter_msg()
    return SetParameters.Request(parameters=[message])


SETTLE_S = 1.0
"""A slider that has been moved follows other changes again after this time."""

_REAL = {ParameterType.PARAMETER_DOUBLE, ParameterType.PARAMETER_DOUBLE_ARRAY}
_NUMERIC = {*_REAL, ParameterType.PARAMETER_INTEGER}


class TuningRequests:
    """Finds out what the controller of each run can tune, follows its values, and sets others.

    `notify` tells the viewers that a value was refused. The sliders show the parameters and their
    values, and say which others are wanted.
    """

    def __init__(
        self,
        node: AnyNode,
        notify: Callable[[str], None],
        sliders: TuningSliders,
    ) -> None:
        self._node, self._notify, self._sliders = node, notify, sliders
        self._clients = _ParameterClients(node)
        self._participants: dict[str, Participant] = {}
        self._faults: queue.SimpleQueue[str] = queue.SimpleQueue()
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

    def add_fault(self, text: str) -> None:
        """Queue a fault, such as ``gyro_x stuck duration=2``, for the node that has it."""
        self._faults.put(text)

    def _send_fault(self, text: str) -> None:
        try:
            role = performer_of(parse_fault(text).component)
        except BallbotError as error:
            self._notify(str(error))
            return
        if participant := self._participants.get(role):
            texts = filter(None, (participant.parameters.get('faults'), text))
            request = parameter_setting('faults', '; '.join(map(str, texts)))
            self._call(participant.node, request, self._notify_refusal)
        else:
            self._notify(f'{role} takes no part in the run')

    def _notify_refusal(self, answer: SetParameters.Response) -> None:
        for reason in (each.reason for each in answer.results if not each.successful):
            self._notify(reason)

    def send_queued(self) -> None:
        """Send the faults and numbers that the page wants, and an unanswered query again."""
        while not self._faults.empty():
            self._send_fault(self._faults.get())
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
        self._participants[participant.role] = participant
        self._clients.of(participant.node, SetParameters)
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
            self._present[name] = numbers_of(value)
            if name not in self._set_at:  # else the slider that set it may have moved on
                elsewhere[name] = self._present[name]
        if elsewhere:
            self._sliders.follow(elsewhere)

    def _set(self, name: str, numbers: Numbers) -> None:
        """Set a parameter in the controller, and in the nodes that share it."""
        tunable = self._tunables.get(name)
        if tunable is None:
            return
        value = tunable.value_of(numbers)
        self._set_at[name] = time.monotonic()
        row = parameters_of(CONTROLLER).get(name)
        for role in row.nodes if row else (CONTROLLER,):
            if role in self._participants:
                self._call(
                    self._participants[role].node,
                    parameter_setting(name, value),
                    lambda answer: self._take_answer(name, numbers, answer),
                )

    def _take_answer(self, name: str, numbers: Numbers, answer: SetParameters.Response) -> None:
        for result in answer.results:
            if result.successful:
                self._present[name] = numbers
            else:
                self._notify(result.reason)
                self._sliders.follow({name: self._present[name]})

    def _call(self, node: str, request: object, on_response: Callable[[Any], None]) -> None:
        kind = next(kind for kind in _PARAMETER_SERVICES if isinstance(request, kind.Request))
        is_there = send(self._clients.of(node, kind), request, on_response)
        if kind is SetParameters and not is_there:
            self._notify(f'{node}: service not available')


def _tunable_names(announcement: Announcement) -> list[str]:
    names = announcement.participant.parameters.get(TUNABLE)
    return [name for name in names if isinstance(name, str)] if isinstance(names, list) else []


def _tunable(descriptor: ParameterDescriptor, value: ParameterValue, start: object) -> Tunable:
    ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
    bounds = (ranges[0].from_value, ranges[0].to_value) if ranges else None
    present = parameter_value_to_python(value)
    if not _is_like(start, numbers_of(present)):
        start = present
    is_whole = descriptor.type not in _REAL
    name, description = descriptor.name, descriptor.description
    return Tunable.of(name, description, bounds, start, present, is_whole=is_whole)


def _is_like(value: object, numbers: Numbers) -> bool:
    values = value if isinstance(value, list | tuple) else [value]
    return len(values) == len(numbers) and all(
        isinstance(each, int | float) and not isinstance(each, bool) and math.isfinite(each)
        for each in values
    )
