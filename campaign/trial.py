"""One trial as a separate process, which prints the verdict as JSON.

``python -m campaign.trial FAULT SEED NUMBER FOLDER DOMAIN… [--own-memory]``
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from pathlib import Path

from ballbot_ros.nodes.shared_memory import SHARED_MEMORY, sweep
from campaign.fault import Verdict
from campaign.faults import BY_NAME
from campaign.site import START_S, CampaignError, Site, Stopwatch

OWN_MEMORY = '--own-memory'
"""Option for a private ``/dev/shm``."""


SWEPT_S = 5.0
"""Time after which a killed process has released its locks [s]."""


def judge_shared_memory() -> tuple[str, ...]:
    """Judge whether the next run can remove all leftovers in shared memory."""
    watch = Stopwatch()
    while True:
        sweep(older_than_s=0.0)
        left = sorted(SHARED_MEMORY.glob('*fastrtps*'))
        if not left or watch.update([os.getpid()]) > SWEPT_S:
            return tuple(f'{path} was not removed by the sweep' for path in left)
        time.sleep(0.05)


def main(words: list[str]) -> int:
    """Run a trial."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # nohup would let all its programs ignore it
    name, seed, number, folder, *domains = [word for word in words if word != OWN_MEMORY]
    attempt = BY_NAME[name].attempt(int(seed), int(number))
    with Site(Path(folder), [int(domain) for domain in domains]) as site:
        try:
            verdict = attempt.carry_out(site)
        except CampaignError as error:
            verdict = Verdict((str(error),), 0.0, START_S)
    if OWN_MEMORY in words:
        verdict = verdict._replace(failures=verdict.failures + judge_shared_memory())
    print(json.dumps({'attempt': str(attempt), **verdict._asdict()}))
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
