"""`ballbot run --viewer`: a page that outlasts the run and can start further runs."""

from __future__ import annotations

import time
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from ballbot_ros.cli.scenario_run import run_and_print
from ballbot_ros.errors import BallbotError
from ballbot_ros.files import temporary_folder
from ballbot_ros.nodes.supervisor import Supervisor
from ballbot_ros.parameters import VIEWER, ParameterSet, ViewerParameters
from ballbot_ros.parameters.files import write_parameter_file
from ballbot_ros.run.fork_client import ForkClient
from ballbot_ros.run.graph import ros
from ballbot_ros.run.node_process import NodeProcess, stop_all
from ballbot_ros.run.node_thread import NodeThread
from ballbot_ros.run.requirements import require_viewer
from ballbot_ros.run.spec import RunOptions, RunSpec
from ballbot_ros.stop_request import StopRequest

POLL_S = 0.05


def run_with_viewer(
    reference: str, options: RunOptions, client: ForkClient | None, *, as_json: bool
) -> int:
    """Run a scenario, then those that the page requests; return the exit status of the last run.

    `client` forks viewer and nodes. If `options` name an output folder, later runs use the folders
    2, 3 ... in it.

    Raises
    ------
    BallbotError
        If the first run can't start. Errors of later runs are printed, and the page stays.
    """
    parameters = RunSpec.of_scenario(reference, options).parameters
    require_viewer(parameters, options.processes)
    assert client is not None  # the nodes are separate processes
    console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    with (
        StopRequest() as stop,
        closing(ViewerSession(parameters, reference, client, console)) as session,
    ):

        def run(reference: str, options: RunOptions) -> int:
            return run_and_print(
                reference, options, client, as_json=as_json, is_replaced=session.is_run_requested
            )

        status = run(reference, options)
        number = 1
        # End after a status above 128 as well: it means a signal, which is meant to end everything.
        while status < 128 and not stop.signal and (chosen := session.wait_for_scenario(stop)):
            number += 1
            folder = options.output and options.output / str(number)
            try:
                status = run(chosen, replace(options, output=folder))
            except BallbotError as error:
                console.print(f'error: {error}')
                status = 2
    return status


class ViewerSession:
    """The viewer's process, and the node that receives the page's requests.

    The parameters are those of the first run, with the address of the page. The console prints the
    viewer's lines.
    """

    def __init__(
        self, parameters: ParameterSet, reference: str, client: ForkClient, console: Console
    ) -> None:
        self._console = console
        with ExitStack() as stack:
            stack.enter_context(ros())
            folder = stack.enter_context(temporary_folder())
            parameter_file = Path(folder) / 'parameters.yaml'
            write_parameter_file(parameter_file, _address(parameters), [VIEWER])
            self._viewer = NodeProcess(client, VIEWER, parameter_file, self._print)
            stack.callback(stop_all, [self._viewer], last='')
            self._supervisor = Supervisor(reference)
            stack.callback(NodeThread(self._supervisor).close)
            self.close = stack.pop_all().close

    def _print(self, line: str) -> None:
        self._console.print(line)

    def is_run_requested(self) -> bool:
        """Return whether the page requests another run."""
        return bool(self._supervisor.requested_scenario)

    def wait_for_scenario(self, stop: StopRequest) -> str:
        """Return the next scenario that the page requests; '' if page or command ends first."""
        if not self._supervisor.requested_scenario and self._viewer.running:
            self._print('the page stays open: choose a scenario there, or end with Ctrl-C')
        while self._viewer.running and not stop.signal:
            if requested := self._supervisor.requested_scenario:
                self._supervisor.requested_scenario = ''
                return requested
            time.sleep(POLL_S)
        if not self._viewer.running:
            self._print(f'{VIEWER} {self._viewer.exit_description}')
        return ''


def _address(parameters: ParameterSet) -> ParameterSet:
    """Return only the page's address; the run's plant announces the other parameters."""
    address = ParameterSet()
    viewer = parameters.of(ViewerParameters)
    address.set(VIEWER, 'host', viewer.host)
    address.set(VIEWER, 'port', viewer.port)
    return address
