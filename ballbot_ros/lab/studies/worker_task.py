"""What a worker of a cluster executes for a part.

The text of this module goes with each part, since a worker may have another version of this
package, or none. So it imports only the standard library and Dask until versions are compared, and
takes and returns only objects of Python's own types.
"""

from __future__ import annotations

import logging
import pickle
from collections.abc import Mapping
from pathlib import Path

Answer = tuple[str, bytes, tuple[int, ...]]
"""Why the worker can't do the part, or else '', the part's file, and its numbers of runs."""


def do_part(required: Mapping[str, str], payload: bytes) -> Answer:
    """Do a part if all versions are the required ones."""
    from distributed import get_worker

    worker = get_worker()
    fault = _difference(required)
    if not fault:
        try:
            return _do(payload, Path(worker.local_directory) / 'ballbot_ros')
        except Exception as error:
            fault = _described(error)
    return f'worker {worker.address}: {fault}', b'', ()


def _difference(required: Mapping[str, str]) -> str:
    """Return what is missing or differs; '' if nothing."""
    try:
        from ballbot_ros.lab.studies.cluster import worker_versions
    except ImportError as error:
        missing = error.name or str(error)
        if missing.startswith('ballbot_ros.'):
            missing = f'{missing}, since it has another version'
        return (
            f'has no {missing}; install ballbot_ros {required["ballbot_ros"]} with its extra '
            '[cluster] there'
        )
    versions = worker_versions()
    for name, version in required.items():
        if versions.get(name) != version:
            return f'its {name} is {versions.get(name) or "missing"}, the command has {version}'
    return ''


def _do(payload: bytes, folder: Path) -> Answer:
    from ballbot_ros.lab.studies.execution import call_safely
    from ballbot_ros.lab.studies.job import Job

    packed, part, samples = pickle.loads(payload)
    job: Job = packed.unpack(folder)
    # A run that hangs can't be interrupted in a thread of the worker.
    encoded = call_safely(Job.encode, job, part, samples)
    summary = encoded.summary
    return '', encoded.data, (summary.runs, summary.passed, summary.failed, summary.fallen)


def _described(error: Exception) -> str:
    from ballbot_ros.errors import BallbotError

    if isinstance(error, BallbotError):
        return str(error)
    logging.getLogger('distributed.worker').error('a part failed', exc_info=error)
    return f'{type(error).__name__}: {error}'
