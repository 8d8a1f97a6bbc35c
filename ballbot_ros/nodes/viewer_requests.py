"""Requests of the page to the graph, through services and topics."""

from __future__ import annotations

import math
import queue
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from rcl_interfaces.msg import Parameter
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter import parameter_value_to_python
from std_srvs.srv import SetBool, Trigger

from ballbot_ros.messages.conversions import encode_push
from ballbot_ros.messages.topics import PUSH, RUN
from ballbot_ros.nodes.base import AnyNode
from ballbot_ros.nodes.graph_observer import full_name
from ballbot_ros.parameters import PLANT, SUPERVISOR, PlantParameters
from ballbot_ros.plant.ground_truth import Pair

_SERVICES = {
    f'{PLANT}/pause': SetBool,
    f'{PLANT}/step': Trigger,
    f'{PLANT}/reset': Trigger,
    f'{SUPERVISOR}/set_parameters': SetParameters,
    f'{SUPERVISOR}/start': Trigger,
}
_PARAMETER_SERVICES = {SetParameters: 'set_parameters', GetParameters: 'get_parameters'}

QUERY_RETRY_S = 1.0
PARAMETERS_OF_PLANT = f'parameters of {PLANT}'


class _ParameterQuery(NamedTuple):
    """A query for parameters of the plant, and the function that receives their values."""

    names: Sequence[str]
    on_parameters: Callable[[PlantParameters], None]


class ViewerRequests:
    """Queues requests from the page's threads; the node's thread sends them.

    The viewers are notified of a request that fails.
    """

    def __init__(self, node: AnyNode, notify: Callable[[str], None]) -> None:
        self._node = node
        self._notify = notify
        self._waiting: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._clients = {name: node.create_client(kind, name) for name, kind in _SERVICES.items()}
        self._plant_parameters = _ParameterClients(node)
        self._push = node.output(PUSH)
        self._had_plant = False
        self._query: _ParameterQuery | None = None
        self._queried_at = -math.inf

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

    def _call(
        self, name: str, request: Any, on_response: Callable[[Any], None] = lambda response: None
    ) -> None:
        self._send(self._clients[name], name, request, on_response)

    def _send(
        self, client: Any, name: str, request: Any, on_response: Callable[[Any], None]
    ) -> None:
        if client is None or not send(client, request, on_response):
            self._notify(f'{name}: service not available')

    def pause(self, pause: bool) -> None:
        """Pause the plant, or resume."""
        self._waiting.put(lambda: self._call(f'{PLANT}/pause', SetBool.Request(data=pause)))

    def step(self) -> None:
        """Run one tick of a paused plant."""
        self._waiting.put(lambda: self._call(f'{PLANT}/step', Trigger.Request()))

    def reset(self) -> None:
        """Begin a new run."""
        self._waiting.put(lambda: self._call(f'{PLANT}/reset', Trigger.Request()))

    def set_real_time_factor(self, factor: float) -> None:
        """Set the real-time factor; 0 is as fast as possible."""
        request = setting('real_time_factor', factor)

        def send() -> None:
            client = self._plant_parameters.find(SetParameters)
            self._send(client, PARAMETERS_OF_PLANT, request, self._notify_refusal)

        self._waiting.put(send)

    def _notify_refusal(self, response: SetParameters.Response) -> None:
        for result in response.results:
            if not result.successful:
                self._notify(f'{PARAMETERS_OF_PLANT}: {result.reason}')

    def push(self, force: Pair) -> None:
        """Push the body with a force [N] in plane signs."""

        def publish() -> None:
            self._push.publish(encode_push(self._node.now_ns, force))

        self._waiting.put(publish)

    def start(self, scenario: str) -> None:
        """End the run, and start one of another scenario."""

        def begin(_: Any) -> None:
            self._call(f'{SUPERVISOR}/start', Trigger.Request(), report)

        def report(answer: Trigger.Response) -> None:
            if not answer.success:
                self._notify(answer.message)

        request = setting('scenario', scenario)
        self._waiting.put(lambda: self._call(f'{SUPERVISOR}/set_parameters', request, begin))

    def plant_parameters(
        self, names: Sequence[str], on_parameters: Callable[[PlantParameters], None]
    ) -> None:
        """Query parameters of the plant until it answers, and pass them to `on_parameters`.

        In what `on_parameters` receives, all parameters except `names` have their defaults.
        """
        self._query, self._queried_at = _ParameterQuery(names, on_parameters), -math.inf

    def _send_query(self) -> None:
        """Send the query, again after a while if it is unanswered.

        The plant's topics may appear before its services.
        """
        query, now_s = self._query, time.monotonic()
        if query is None or now_s - self._queried_at < QUERY_RETRY_S:
            return
        client = self._plant_parameters.find(GetParameters)
        if client is None or not client.service_is_ready():
            return
        self._queried_at = now_s

        def take(response: GetParameters.Response) -> None:
            if query is not self._query:
                return
            self._query = None
            # Skip an answer without values: a player announces runs, too, but has none of the
            # plant's parameters.
            if len(response.values) == len(query.names):
                values = map(parameter_value_to_python, response.values)
                answered = dict(zip(query.names, values, strict=True))
                query.on_parameters(PlantParameters(**answered))

        request = GetParameters.Request(names=query.names)
        self._send(client, PARAMETERS_OF_PLANT, request, take)


class _ParameterClients:
    """Clients of the plant's parameter services, whose names begin with the plant's node name."""

    def __init__(self, node: AnyNode) -> None:
        self._node = node
        self._plant = ''
        self._clients: dict[Any, Any] = {}

    def find(self, kind: Any) -> Any:
        """Return the client of a service, or None while the plant's name is unknown."""
        offers = self._node.get_publishers_info_by_topic(RUN.name)
        names = list(filter(None, map(full_name, offers)))
        if not names:
            return None
        if names[0] != self._plant:
            self._plant = names[0]
            for client in self._clients.values():
                self._node.destroy_client(client)
            self._clients = {
                kind: self._node.create_client(kind, f'{self._plant}/{service}')
                for kind, service in _PARAMETER_SERVICES.items()
            }
        return self._clients[kind]


def send(client: Any, request: Any, on_response: Callable[[Any], None]) -> bool:
    """Send a request to a service; return whether the service is there."""
    if not client.service_is_ready():
        return False
    client.call_async(request).add_done_callback(lambda future: on_response(future.result()))
    return True


def setting(name: str, value: Any) -> SetParameters.Request:
    """Return the request that sets a parameter."""
    message: Parameter = RosParameter(name, value=value).to_parameter_msg()
    return SetParameters.Request(parameters=[message])
