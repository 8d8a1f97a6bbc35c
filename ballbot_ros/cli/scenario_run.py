"""A run of a scenario, with progress and result on the terminal."""

from __future__ import annotations

from ballbot_ros.cli.progress import Progress
from ballbot_ros.cli.result import print_json, print_table
from ballbot_ros.run.execution import execute
from ballbot_ros.run.fork_client import ForkClient
from ballbot_ros.run.result import RunResult
from ballbot_ros.run.spec import RunOptions, RunSpec
from ballbot_ros.standard_streams import stdout_to_stderr


def load_run(reference: str, options: RunOptions) -> RunSpec:
    """Return the run of a scenario, given by name or file."""
    with stdout_to_stderr():  # a controller may print while its class is loaded
        return RunSpec.of_scenario(reference, options)


def print_result(spec: RunSpec, result: RunResult, *, as_json: bool) -> None:
    """Print the result of a run."""
    (print_json if as_json else print_table)(spec, result)


def run_and_print(
    reference: str, options: RunOptions, client: ForkClient | None, *, as_json: bool
) -> int:
    """Run a scenario, given by name or file, print its result, return the exit status.

    `client` forks the nodes that are separate processes.
    """
    spec = load_run(reference, options)
    with Progress(spec.name, spec.plant.duration) as progress, stdout_to_stderr():
        result = execute(spec, progress, client=client)
        progress.release(result.reason)
    print_result(spec, result, as_json=as_json)
    return result.exit_status
