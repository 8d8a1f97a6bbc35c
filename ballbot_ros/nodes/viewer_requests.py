"""What the page asks of the graph, through its services and topics."""

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

from ballbot_ros.messages.conversions import fill_push
from ballbot_ros.messages.topics import PUSH, RUN
from ballbot_ros.nodes.base import AnyNode
from ballbot_ros.nodes.graph_observer import UNKNOWN_NODE
from ballbot_ros.parameters import PLANT, SUPERVISOR, PlantParameters
from ballbot_ros.plant.truth import Pair

_SERVICES = {
    f'{PLANT}/pause': SetBool,
    f'{PLANT}/step': Trigger,
    f'{PLANT}/reset': Trigger,
    f'{SUPERVISOR}/set_parameters': SetParameters,
    f'{SUPERVISOR}/start': Trigger,
}
_PARAMETER_SERVICES = {SetParameters: 'set_parameters', GetParameters: 'get_parameters'}

ASK_AGAIN_S = 1.0
PARAMETERS_OF_PLANT = f'parameters of {PLANT}'


class _Question(NamedTuple):
    """Parameters of the plant that are asked for, and what takes their values."""

    names: Sequence[str]
    then: Callable[[PlantParameters], None]


class ViewerRequests:
    """The page calls from its own threads; the node's makes the requests.

    Parameters
    ----------
    node : BallbotNode
    tell : callable
        Takes what is to be told to those who look.
    """

    def __init__(self, node: AnyNode, tell: Callable[[str], None]) -> None:
        self._node = node
        self._tell = tell
        self._waiting: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._clients = {name: node.create_client(kind, name) for name, kind in _SERVICES.items()}
        self._plant_parameters = _ParameterClients(node)
        self._push = node.output(PUSH)
        self._had_plant = False
        self._question: _Question | None = None
        self._asked_at = -math.inf

    @property
    def lost_plant(self) -> bool:
        """Whether there was a plant, and now there is none."""
        has_plant = self._clients[f'{PLANT}/pause'].service_is_ready()
        self._had_plant |= has_plant
        return self._had_plant and not has_plant

    @property
    def can_start(self) -> bool:
        """Whether somebody runs the graph who can start another scenario."""
        return bool(self._clients[f'{SUPERVISOR}/start'].service_is_ready())

    def make(self) -> None:
        """Make the requests that wait."""
        while not self._waiting.empty():
            self._waiting.get()()
        self._ask()

    def _call(
        self, name: str, request: Any, then: Callable[[Any], None] = lambda response: None
    ) -> None:
        self._send(self._clients[name], name, request, then)

    def _send(self, client: Any, name: str, request: Any, then: Callable[[Any], None]) -> None:
        if client is not None and client.service_is_ready():
            client.call_async(request).add_done_callback(lambda future: then(future.result()))
        else:
            self._tell(f'{name}: no such service at present')

    def pause(self, pause: bool) -> None:
        """Hold the plant, or let it go on."""
        self._waiting.put(lambda: self._call(f'{PLANT}/pause', SetBool.Request(data=pause)))

    def step(self) -> None:
        """Let a paused plant go on by one tick."""
        self._waiting.put(lambda: self._call(f'{PLANT}/step', Trigger.Request()))

    def reset(self) -> None:
        """Begin a new run."""
        self._waiting.put(lambda: self._call(f'{PLANT}/reset', Trigger.Request()))

    def pace(self, factor: float) -> None:
        """Set the real-time factor; 0 is as fast as it can."""
        request = _setting('real_time_factor', factor)

        def send() -> None:
            client = self._plant_parameters.find(SetParameters)
            self._send(client, PARAMETERS_OF_PLANT, request, self._tell_refusal)

        self._waiting.put(send)

    def _tell_refusal(self, response: SetParameters.Response) -> None:
        for result in response.results:
            if not result.successful:
                self._tell(f'{PARAMETERS_OF_PLANT}: {result.reason}')

    def push(self, force: Pair) -> None:
        """Push the body [N], in plane signs."""

        def publish() -> None:
            fill_push(self._push.message, self._node.now_ns, force)
            self._push.send(self._node.now_ns)

        self._waiting.put(publish)

    def start(self, scenario: str) -> None:
        """End the run, and begin one of another scenario."""

        def begin(_: Any) -> None:
            self._call(f'{SUPERVISOR}/start', Trigger.Request(), tell)

        def tell(answer: Trigger.Response) -> None:
            self._tell(f'{scenario} begins' if answer.success else answer.message)

        request = _setting('scenario', scenario)
        self._waiting.put(lambda: self._call(f'{SUPERVISOR}/set_parameters', request, begin))

    def plant_parameters(
        self, names: Sequence[str], then: Callable[[PlantParameters], None]
    ) -> None:
        """Ask the plant for parameters until it answers; hand them to `then`.

        What was not asked for has its default.
        """
        self._question, self._asked_at = _Question(names, then), -math.inf

    def _ask(self) -> None:
        """Ask what is not answered: a plant's topics may be there before its services."""
        question, now = self._question, time.monotonic()
        if question is None or now - self._asked_at < ASK_AGAIN_S:
            return
        client = self._plant_parameters.find(GetParameters)
        if client is None or not client.service_is_ready():
            return
        self._asked_at = now

        def take(response: GetParameters.Response) -> None:
            if question is not self._question:
                return
            self._question = None
            # A player announces runs, too, but has no parameters of a plant.
            if len(response.values) == len(question.names):
                values = map(parameter_value_to_python, response.values)
                told = dict(zip(question.names, values, strict=True))
                question.then(PlantParameters(**told))

        request = GetParameters.Request(names=question.names)
        self._send(client, PARAMETERS_OF_PLANT, request, take)


class _ParameterClients:
    """Clients of the plant's parameters, whose services have its node's name, whatever that is."""

    def __init__(self, node: AnyNode) -> None:
        self._node = node
        self._plant = ''
        self._clients: dict[Any, Any] = {}

    def find(self, kind: Any) -> Any:
        """Return the client of a service, or None while the plant's name is not known."""
        offers = self._node.get_publishers_info_by_topic(RUN.name)
        names = [
            f'{offer.node_namespace.rstrip("/")}/{offer.node_name}'
            for offer in offers
            if offer.node_name != UNKNOWN_NODE
        ]
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


def _setting(name: str, value: Any) -> SetParameters.Request:
    message: Parameter = RosParameter(name, value=value).to_parameter_msg()
    return SetParameters.Request(parameters=[message])
