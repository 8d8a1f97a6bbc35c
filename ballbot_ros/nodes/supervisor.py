"""Lets the page of a run choose the scenario of the next one."""

from __future__ import annotations

from std_srvs.srv import Trigger

from ballbot_ros.errors import BallbotError
from ballbot_ros.nodes.base import BallbotNode
from ballbot_ros.parameters import SUPERVISOR, SupervisorParameters
from ballbot_ros.scenario.library import load_scenario


class Supervisor(BallbotNode[SupervisorParameters]):
    """Requests a scenario, by its name or file; the command that runs the graph starts it."""

    def __init__(self, scenario: str) -> None:
        super().__init__(SupervisorParameters, SupervisorParameters(scenario=scenario))
        self.requested_scenario = ''
        self.create_service(Trigger, f'{SUPERVISOR}/start', self._start)

    def _start(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        name = self.parameters.scenario
        try:
            load_scenario(name)
        except BallbotError as error:
            response.message = str(error)
            return response
        self.requested_scenario = name
        response.success = True
        return response
