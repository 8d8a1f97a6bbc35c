"""Lets the page of a run choose the scenario of the next one, and tells it the result."""

from __future__ import annotations

from collections.abc import Mapping

from std_msgs.msg import String
from std_srvs.srv import Trigger

from ballbot_ros.engine.scenario.reader import load_scenario
from ballbot_ros.errors import BallbotError
from ballbot_ros.nodes.base import AnyNode, BallbotNode
from ballbot_ros.parameters import PLANT, SUPERVISOR, SupervisorParameters
from ballbot_ros.recording.messages.topics import SESSION
from ballbot_ros.viewer.run_activity import encode_session

SEND_PERIOD_S = 0.1


class StartRequest:
    """Sends a request as soon as the plant can receive it."""

    def __init__(self, node: AnyNode) -> None:
        self._client = node.create_client(Trigger, f'{PLANT}/start')
        self._is_requested = False
        node.create_wall_timer(SEND_PERIOD_S, self._send)

    def request(self) -> None:
        """Request the start; may be called from any thread."""
        self._is_requested = True

    def _send(self) -> None:
        if self._is_requested and self._client.service_is_ready():
            self._is_requested = False
            self._client.call_async(Trigger.Request())


BACK = '@'
"""Begins the name of a run that goes on from a time of the last one, such as @3.2 [s]."""


class Supervisor(BallbotNode[SupervisorParameters]):
    """Requests a scenario, by its name or file; the command that runs the graph starts it.

    Instead of a scenario, it can be a time of the last run, as in :data:`BACK`. `start_request`
    starts a run that is paused at its start.
    """

    def __init__(self, scenario: str) -> None:
        super().__init__(SupervisorParameters, SupervisorParameters(scenario=scenario))
        self.requested_scenario = ''
        self._session = self.output(SESSION)
        self.start_request = StartRequest(self)
        self.create_service(Trigger, f'{SUPERVISOR}/start', self._start)

    def _start(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        name = self.parameters.scenario
        try:
            shown = name if name.startswith(BACK) else load_scenario(name).name
        except BallbotError as error:
            response.message = str(error)
            return response
        self.requested_scenario = name
        self.announce(shown)  # at once, while the run before is still ending
        response.success = True
        return response

    def announce(self, scenario: str, result: Mapping[str, object] | None = None) -> None:
        """Publish which scenario is run, and at its end the result as JSON."""
        self._session.publish(String(data=encode_session(scenario, result)))
