"""A run of a scenario, with progress and result on the terminal."""

from __future__ import annotations

from collections.abc import Callable

from ballbot_ros.cli.progress import Progress
from ballbot_ros.cli.result import print_json, print_table
from ballbot_ros.run.execution import execute
from ballbot_ros.run.fork_client import ForkClient
from ballbot_ros.run.spec import RunOptions, RunSpec
from ballbot_ros.standard_streams import stdout_to_stderr


def run_and_print(
    reference: str,
    options: RunOptions,
    client: ForkClient | None,
    *,
    as_json: bool,
    is_replaced: Callable[[], bool] | None = None,
) -> int:
    """Run a scenario, given by name or file, print its result, return the exit status.

    `client` forks the nodes that are separate processes. `is_replaced` returns whether another run
    has been requested, which replaces this one.
    """
    with stdout_to_stderr():  # a controller may print while its class is loaded
        spec = RunSpec.of_scenario(reference, options)
    with Progress(spec.name, spec.plant.duration) as progress, stdout_to_stderr():
        result = execute(spec, progress, is_replaced, client)
    (print_json if as_json else print_table)(spec, result)
    return result.exit_status
