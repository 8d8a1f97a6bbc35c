"""Drivers that are killed and restarted."""

from __future__ import annotations

import math
import random
import time
from collections.abc import Sequence
from dataclasses import dataclass
from signal import Signals
from typing import NamedTuple

from ballbot_ros.engine.trajectory import load_trajectory
from ballbot_ros.parameters import CONTROLLER, DRIVERS, NODES, PLANT, RECORDER
from campaign.fault import Verdict
from campaign.remains import read_remains
from campaign.run import FIRST_TICKS_BYTES, START_PITCH_DEG, judge_printed, ticks_of, undisturbed
from campaign.site import Program, Site, Stopwatch, wait_until

DURATION_S = 4.0
PATIENCE_S = 60.0
BOUND_S = 60.0
END_S = 15.0


class Restart(NamedTuple):
    """A driver that is killed, and restarted later.

    Attributes
    ----------
    driver : str
    killed_s : float
        Time since the first tick, or since the previous restart [s].
    away_s : float
        Time until it is restarted [s].
    """

    driver: str
    killed_s: float
    away_s: float


@dataclass(frozen=True)
class Restarts:
    """Drivers of a run that are killed and restarted, one after the other."""

    restarts: Sequence[Restart]

    def __str__(self) -> str:
        return ', '.join(
            f'{each.driver} killed after {each.killed_s:.3f} s, away for {each.away_s:.3f} s'
            for each in self.restarts
        )

    @classmethod
    def draw(cls, generator: random.Random, index: int) -> Restarts:
        """Draw one to three restarts; in four consecutive trials each driver comes first once."""
        drivers = [DRIVERS[index % len(DRIVERS)]]
        drivers += generator.choices(DRIVERS, k=generator.randrange(3))
        return cls(
            [Restart(d, generator.uniform(0.0, 1.5), generator.uniform(0.0, 1.0)) for d in drivers]
        )

    def carry_out(self, site: Site) -> Verdict:
        """Start every node alone, and judge the plant's summary and the recording."""
        recording, account = site.folder / 'run.mcap', site.folder / 'trajectory.npz'
        pitch = math.radians(START_PITCH_DEG)
        nodes = {name: site.start_node(name) for name in (*DRIVERS, CONTROLLER)}
        nodes[RECORDER] = site.start_node(RECORDER, output=recording)
        nodes[PLANT] = site.start_node(
            PLANT, duration=DURATION_S, start_pitch_x=pitch, real_time_factor=1.0,
            require_recorder='true', timeout=PATIENCE_S, trajectory_file=account,
        )  # fmt: skip
        wait_until(
            lambda: recording.exists() and recording.stat().st_size > FIRST_TICKS_BYTES,
            'the first tick',
        )
        watch = Stopwatch()
        lives = list(nodes.values())
        for number, restart in enumerate(self.restarts, start=1):
            time.sleep(restart.killed_s)
            nodes[restart.driver].send(Signals.SIGKILL)
            time.sleep(restart.away_s)
            nodes[restart.driver] = site.start_node(restart.driver, number)
            lives.append(nodes[restart.driver])
        failures = []
        while nodes[PLANT].status is None and watch.update(site.alive()) < BOUND_S:
            time.sleep(0.05)
        if nodes[PLANT].status is None:
            failures.append(f'still running {BOUND_S:.0f} s after the first kill')
        took_s = watch.elapsed_s
        failures += _end(site, [nodes[name] for name in NODES if name != PLANT])
        failures += judge_printed(''.join(life.text for life in lives))
        if nodes[PLANT].status == 0:
            expected = undisturbed(site, ticks_of(DURATION_S))
            if load_trajectory(account)[1]['duty_sha256'] != expected.duty_sha256:
                failures.append('the duties differ from those of an undisturbed run')
            # Permit missing samples, which the file reports: a driver may be killed when only one
            # of its two readers has a sample, the controller or the recorder.
            remains = read_remains(recording, site.folder)
            if not remains or not remains.finished or len(remains.duties) != expected.ticks:
                failures.append(
                    f'expected a finished recording of {expected.ticks} duties, got {remains}'
                )
        elif nodes[PLANT].status is not None:
            last = nodes[PLANT].text.strip().rpartition('\n')[2]
            failures.append(f'{PLANT} ended with status {nodes[PLANT].status}: {last}')
        return Verdict(tuple(failures), took_s, BOUND_S)


def _end(site: Site, nodes: Sequence[Program]) -> list[str]:
    """Interrupt the waiting nodes; return the broken guarantees."""
    for node in nodes:
        node.send(Signals.SIGINT)
    watch = Stopwatch()
    while (alive := site.alive()) and watch.update(alive) < END_S:
        time.sleep(0.05)
    wrong = {node.name: node.status for node in nodes if node.status}
    failures = [f'status of {name} after SIGINT: {status}' for name, status in wrong.items()]
    if alive:
        failures.append(f'SIGINT does not end {", ".join(alive.values())}')
    return failures
