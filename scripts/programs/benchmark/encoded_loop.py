"""The closed loop with all messages encoded, and nothing sent or written: the graph's own work.

``python -m benchmark.encoded_loop SCENARIO SECONDS`` prints its speed.
"""

from __future__ import annotations

import json
import sys
import time

from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.scenario.reader import load_scenario
from ballbot_ros.recording.messages.run_messages import RunMessages


def main(name: str, duration: str) -> None:
    """Run a scenario for a time [s]."""
    scenario = load_scenario(name)
    loop = ClosedLoop(scenario.parameters, scenario)
    messages = RunMessages(lambda topic: lambda stamp_ns, data: None, scenario.parameters)
    messages.begin(loop.start_ns, loop.world, loop.pushes)
    begun_s = time.monotonic()
    for tick in loop.ticks(float(duration)):
        messages.tick(tick, loop.program)
    print(json.dumps({'real_time_factor': float(duration) / (time.monotonic() - begun_s)}))


if __name__ == '__main__':
    main(*sys.argv[1:])
