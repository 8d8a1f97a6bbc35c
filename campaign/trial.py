"""One trial, as a process of its own, which prints the verdict as JSON.

``python -m campaign.trial FAULT SEED NUMBER FOLDER DOMAIN…``
"""

from __future__ import annotations

import json
import signal
import sys
from pathlib import Path

from campaign.fault import Verdict
from campaign.faults import BY_NAME
from campaign.site import CampaignError, Site, Stopwatch


def main(words: list[str]) -> int:
    """Carry out a trial."""
    # What a shell runs in the background ignores SIGINT, and so would all that it starts.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    name, seed, number, folder, *domains = words
    attempt = BY_NAME[name].attempt(int(seed), int(number))
    watch = Stopwatch()
    with Site(Path(folder), [int(domain) for domain in domains]) as site:
        try:
            verdict = attempt.carry_out(site)
        except CampaignError as error:
            verdict = Verdict((str(error),), watch.elapsed_s, 1.0)
    print(json.dumps({'attempt': str(attempt), **verdict._asdict()}))
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
