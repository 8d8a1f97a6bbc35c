"""`ballbot run --viewer`: a page that outlasts the run and can start further runs."""

from __future__ import annotations

import time
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from pathlib import Path

from ballbot_ros.analysis.metrics import Verdict
from ballbot_ros.cli.progress import Progress, stderr_console
from ballbot_ros.cli.result import load_run, print_result, result_json
from ballbot_ros.cli.web_page import PageOpening, PageOptions
from ballbot_ros.errors import BallbotError
from ballbot_ros.files import temporary_folder
from ballbot_ros.nodes.supervisor import BACK, Supervisor
from ballbot_ros.nodes.teleop.terminal import KeyPress, can_read_keys
from ballbot_ros.parameters import VIEWER, ParameterSet, ViewerParameters
from ballbot_ros.parameters.files import write_parameter_file
from ballbot_ros.process import StopRequest, stdout_to_stderr
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.robot.brick.bluetooth import NEUTRAL
from ballbot_ros.run.branch import branch_spec, read_past
from ballbot_ros.run.execution import execute
from ballbot_ros.run.future import Future
from ballbot_ros.run.node_process import ForkClient, NodeProcess, stop_all
from ballbot_ros.run.observer import RunObserver, StartObserver
from ballbot_ros.run.one_process import NodeThread, ros
from ballbot_ros.run.requirements import Processes, require_viewer
from ballbot_ros.run.result import RunResult
from ballbot_ros.run.spec import RunOptions, RunSpec

POLL_S = 0.05


def run_with_viewer(
    reference: str,
    options: RunOptions,
    page: PageOptions,
    client: ForkClient | None,
    *,
    as_json: bool,
) -> int:
    """Run a scenario, then those that the page requests; return the exit status of the last run.

    `client` forks viewer and nodes. If `options` name an output folder, later runs use the folders
    2, 3 ... in it. It raises BallbotError if the first run can't start. Errors of later runs are
    printed, and the page stays.
    """
    spec = load_run(reference, options)
    require_viewer(spec.parameters, options.processes)
    assert client is not None  # the nodes are separate processes
    with (
        StopRequest() as stop,
        closing(_ViewerSession(spec, reference, page, client, stop, as_json=as_json)) as session,
    ):
        status = session.run(spec, starts_paused=page.waits)
        number = 1
        # End after a status above 128 as well: it means a signal, which is meant to end everything.
        while status < 128 and not stop.signal and (chosen := session.wait_for_scenario()):
            number += 1
            folder = options.output and options.output / str(number)
            status = session.run_other(chosen, replace(options, output=folder))
    return status


class _ViewerSession:
    """The viewer's process, and the node that receives the page's requests.

    Only the address of the page is taken from the first run's parameters. It raises BallbotError if
    the viewer ends before it serves the page.
    """

    def __init__(
        self,
        spec: RunSpec,
        reference: str,
        page: PageOptions,
        client: ForkClient,
        stop: StopRequest,
        *,
        as_json: bool,
    ) -> None:
        self._client, self._stop, self._as_json = client, stop, as_json
        self._console = stderr_console()
        self._recording: Path | None = None  # of the last run
        opening = PageOpening(page, self._print, can_press_key=can_read_keys())
        with ExitStack() as stack:
            stack.enter_context(ros())
            self._scratch = Path(stack.enter_context(temporary_folder()))
            parameter_file = self._scratch / 'parameters.yaml'
            write_parameter_file(parameter_file, _address(spec.parameters), [VIEWER])
            self._viewer = NodeProcess(client, VIEWER, parameter_file, opening.on_line)
            stack.callback(stop_all, [self._viewer], last='')
            self._supervisor = Supervisor(reference)
            stack.callback(NodeThread(self._supervisor).close)
            self._wait_for_page(opening)
            self.close = stack.pop_all().close

    def _wait_for_page(self, opening: PageOpening) -> None:
        """Wait until the page can be opened, so that its address comes before everything else."""
        while not (opening.address or self._stop.signal):
            if not self._viewer.running:
                self._viewer.forward_remaining_output()
                raise BallbotError(f'{VIEWER} {self._viewer.exit_description}')
            time.sleep(POLL_S)

    def _print(self, line: str) -> None:
        self._console.print(line, soft_wrap=True)

    def run(self, spec: RunSpec, *, starts_paused: bool = False) -> int:
        """Run a scenario, print its result and show it on the page; return the exit status."""
        self._supervisor.announce(spec.name)
        with ExitStack() as stack:
            progress: RunObserver = stack.enter_context(
                Progress(spec.name, spec.plant.duration, console=self._console)
            )
            if starts_paused:
                key_press = KeyPress(self._supervisor.start_request.request)
                stack.callback(key_press.close)
                progress = StartObserver(progress, key_press, self._start_without_page)
            stack.enter_context(stdout_to_stderr())
            result = execute(
                spec,
                progress,
                self._is_run_requested,
                self._client,
                starts_paused=starts_paused,
                on_judged=partial(self._show_result, spec),
            )
        self._recording = result.recording
        self._show_result(spec, result)
        print_result(spec, result, as_json=self._as_json)
        return result.exit_status

    def _start_without_page(self) -> None:
        """Start the run if the viewer has ended, whose page cannot be opened any more."""
        if not self._viewer.running:
            self._supervisor.start_request.request()

    def run_other(self, reference: str, options: RunOptions) -> int:
        """Run another scenario; an error is printed and shown on the page."""
        try:
            return self.run(self._back(reference, options) or load_run(reference, options))
        except BallbotError as error:
            self._print(f'error: {error}')
            failure = {'outcome': Verdict.FAILED, 'reason': str(error)}
            self._supervisor.announce(reference, failure)
            return 2

    def _back(self, reference: str, options: RunOptions) -> RunSpec | None:
        """Return the last run from an earlier time on, driven by hand; None if it is a scenario."""
        if not reference.startswith(BACK):
            return None
        if self._recording is None:
            raise BallbotError(f'{reference}: the last run has no recording')
        try:
            at = float(reference.removeprefix(BACK))
        except ValueError:
            raise BallbotError(f'{reference}: not {BACK} and a time in s, such as @3.2') from None
        code = options.controller if isinstance(options.controller, str) else None
        with RecordingReader(self._recording) as reader:
            past = read_past(reader, None, self._scratch, code)
            future = Future(at=min(at, past.end), sticks=NEUTRAL, is_live=True)
            processes, output = Processes.SEPARATE, options.output
            return branch_spec(past, future, self._scratch, processes=processes, output=output)

    def _show_result(self, spec: RunSpec, result: RunResult) -> None:
        """Show the result on the page, unless another run already replaces this one."""
        if not self._is_run_requested():
            self._supervisor.announce(spec.name, result_json(spec, result))

    def _is_run_requested(self) -> bool:
        return bool(self._supervisor.requested_scenario)

    def wait_for_scenario(self) -> str:
        """Return the next scenario that the page requests; '' if page or command ends first."""
        if not self._supervisor.requested_scenario and self._viewer.running:
            self._print('the page stays open: choose a scenario there, or end with Ctrl-C')
        while self._viewer.running and not self._stop.signal:
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
