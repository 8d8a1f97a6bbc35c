"""Many runs as one function on tables of numbers, which a compiler takes as it is."""

from __future__ import annotations

from typing import Any

from ballbot_ros.engine.run import Events, Log, simulate_run


def simulate_runs(
    plants: Any,
    gyros: Any,
    encoders: Any,
    sonars: Any,
    programs: Any,
    floor: Any,
    events: Any,
    log: Any,
    ends: Any,
) -> None:
    """Simulate a run for each row of the tables.

    The arrays of `events` and `log` have one dimension more, the first: that of the runs. If it
    has a length of one, all runs have the same events.
    """
    for run in range(len(plants)):
        own = run if len(events.vertical) > 1 else 0
        at = Events(
            events.push_times[own].copy(), events.push_forces[own].copy(),
            events.vertical[own], events.horizontal[own],
        )  # fmt: skip
        to = Log(log.position[run], log.psi[run], log.duty[run])
        simulate_run(
            plants[run], gyros[run], encoders[run], sonars[run], programs[run], floor, at, to,
            ends[run],
        )  # fmt: skip
