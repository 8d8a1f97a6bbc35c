"""Workers of Dask that start at once, since they are forks: so a test can kill a hundred.

Arguments are the address of the scheduler and a folder. Each line of the input starts a worker,
whose process id is printed. At the end of the input all are killed.
"""

import asyncio
import logging
import os
import signal
import sys
from contextlib import suppress

from distributed import Worker

import ballbot_ros.studies.job
import ballbot_ros.studies.packed_job
import ballbot_ros.studies.worker_versions
from ballbot_ros.studies.part_file import load_pyarrow


async def serve(address, folder):
    async with Worker(
        address, nthreads=1, host='127.0.0.1', dashboard=False, local_directory=folder
    ) as worker:
        await worker.finished()


def main(address, folder):
    load_pyarrow()
    ballbot_ros.studies.worker_versions.worker_versions()
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
