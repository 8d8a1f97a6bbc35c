"""A run of a scenario, with progress and result on the terminal."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ballbot_ros.cli.progress import Progress
from ballbot_ros.cli.result import print_json, print_table
from ballbot_ros.run.execution import execute
from ballbot_ros.run.fork_client import ForkClient
from ballbot_ros.run.spec import RunOptions, RunSpec


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
    spec = RunSpec.of_scenario(reference, options)
    with Progress(spec.name, spec.plant.duration) as progress, _stdout_to_stderr():
        result = execute(spec, progress, is_replaced, client)
    (print_json if as_json else print_table)(spec, result)
    return result.exit_status


@contextmanager
def _stdout_to_stderr() -> Iterator[None]:
    """Keep stdout for the result: redirect what the middleware prints there to stderr."""
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
