"""One trial as a separate process, which prints the verdict as JSON.

``python -m campaign.trial FAULT SEED NUMBER FOLDER DOMAIN… [--own-memory]``
"""

from __future__ import annotations

import json
import signal
import sys
from pathlib import Path

from campaign.fault import Verdict
from campaign.faults import BY_NAME
from campaign.site import START_S, CampaignError, Site

OWN_MEMORY = '--own-memory'
"""Option for a private ``/dev/shm``."""

SHARED_MEMORY = Path('/dev/shm')


def judge_shared_memory() -> tuple[str, ...]:
    """Judge whether no process has left anything in shared memory, which no graph may use."""
    return tuple(f'{path} is left' for path in sorted(SHARED_MEMORY.glob('*fastrtps*')))


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
