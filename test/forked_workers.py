"""Workers of Dask that start at once, since they are forks: so a test can kill a hundred.

Arguments are the address of the scheduler, a folder, and a study, whose compiled code is loaded
before the forks. Each line of the input starts a worker,
whose process id is printed. At the end of the input all are killed.
"""

import asyncio
import logging
import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

from distributed import Worker

from ballbot_ros.lab.studies.cluster import worker_versions
from ballbot_ros.lab.studies.job import PackedJob, job_of
from ballbot_ros.lab.studies.reader import read_study
from ballbot_ros.lab.studies.runs import simulator_for
from ballbot_ros.lab.studies.sampling import Sampler


async def serve(address, folder):
    async with Worker(
        address, nthreads=1, host='127.0.0.1', dashboard=False, local_directory=folder
    ) as worker:
        await worker.finished()


def load(path):
    study = read_study(path)
    job = job_of(study, Path())
    PackedJob.of(job)
    simulator_for(job.spec, study.measures).simulate(Sampler(study).part(0, 1))
    worker_versions()


def main(address, folder, study):
    load(study)
    logging.getLogger('distributed').setLevel(logging.CRITICAL)
    # The system reaps those that are killed.
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    workers = []
    for _ in sys.stdin:
        process = os.fork()
        if process == 0:
            try:
                asyncio.run(serve(address, folder))
            finally:
                os._exit(0)
        workers.append(process)
        print(process, flush=True)
    for process in workers:
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)


if __name__ == '__main__':
    main(*sys.argv[1:])
