"""True motion and duties of a run, tick by tick, and their hash."""

from __future__ import annotations

import hashlib
import json
from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.engine.run import RunLog
from ballbot_ros.engine.scenario.task_timing import COUNT, job_row, task_timing
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.parameter import TextEnum
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.brick.brick import DeviceOutputs
from ballbot_ros.robot.plant.ground_truth import GroundTruth

_INT8 = 0xFF


class Engine(TextEnum):
    """What computes the ticks of a run, with the same bits."""

    INTERPRETED = 'interpreted'
    COMPILED = 'compiled'


@dataclass(frozen=True)
class Trajectory:
    """True motion of a run; column 0 is plane x, column 1 plane y.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Time since the first tick [s].
    position : ndarray, shape (n, 2)
        Ball centre [m].
    psi : ndarray, shape (n, 2)
        Body pitch [rad].
    duty : ndarray, shape (n, 2)
        Duty [%].
    timing : ndarray, shape (n, 4) or (0, 4)
        As in :class:`~ballbot_ros.engine.scenario.metrics.Motion`; without rows also if unknown.
    """

    time: Floats
    position: Floats
    psi: Floats
    duty: NDArray[np.int8]
    timing: Floats = field(default_factory=lambda: np.zeros((0, COUNT)))


class TrajectoryLog:
    """Collects the trajectory and the hash of the duties, tick by tick.

    With `keep` false, for an endless run, it only counts and hashes. Without the parameters of
    ``controller`` there is no timing.
    """

    def __init__(
        self, controller: ControllerParameters | None = None, *, keep: bool = True
    ) -> None:
        self._keep = keep
        self._controller = controller or ControllerParameters()
        self._numbers, self._timing = array('d'), array('d')
        self._delays, self._jobs = array('q'), array('q')
        self._duties = bytearray()
        self._hash = hashlib.sha256()
        self.ticks = 0

    def add(
        self, truth: GroundTruth, duty_x: int, duty_y: int, outputs: DeviceOutputs | None = None
    ) -> None:
        """Add the tick of `truth`, the duties that answer it, and all outputs if they are known."""
        duties = bytes((duty_x & _INT8, duty_y & _INT8))
        self._hash.update(duties)
        self.ticks += 1
        if self._keep:
            self._numbers.extend((truth.stamp_ns * 1e-9, *truth.position, *truth.psi))
            self._duties += duties
            self._delays.append(outputs.delay_ns if outputs else 0)
            for job in outputs.jobs if outputs else ():
                self._jobs.extend(job_row(job))

    def extend(self, stamps_ns: NDArray[np.int64], ticks: RunLog) -> None:
        """Add ticks of a run; they come before those that are added one by one."""
        position, psi, duty, timing, _ = ticks
        self._hash.update(duty.tobytes())
        self.ticks += len(duty)
        if self._keep:
            table = np.column_stack([stamps_ns * 1e-9, position, psi])
            self._numbers.frombytes(table.tobytes())
            self._duties += duty.tobytes()
            self._delays.extend([0] * len(duty))
            self._timing.frombytes(timing.tobytes())

    @property
    def duty_sha256(self) -> str:
        """SHA-256 over the int8 duty pairs from the first tick on, as hexadecimal text."""
        return self._hash.hexdigest()

    def trajectory(self) -> Trajectory:
        """Return the trajectory so far."""
        table = np.array(self._numbers).reshape(-1, 5)
        start = table[0, 0] if len(table) else 0.0
        duty = np.frombuffer(bytes(self._duties), dtype=np.int8).reshape(-1, 2)
        jobs, delays_ns = np.array(self._jobs, np.int64), np.array(self._delays, np.int64)
        stamps_ns = np.rint(table[:, 0] * 1e9).astype(np.int64)
        timing = task_timing(self._controller, jobs.reshape(-1, 6), stamps_ns, duty, delays_ns)
        known = np.array(self._timing).reshape(-1, COUNT)  # of compiled ticks, which are the first
        timing[: len(known)] = known
        return Trajectory(
            time=table[:, 0] - start,
            position=table[:, 1:3],
            psi=table[:, 3:5],
            duty=duty,
            timing=timing,
        )


def save_trajectory(path: Path, trajectory: Trajectory, summary: Mapping[str, object]) -> None:
    """Write a trajectory and a summary of the run to an .npz file.

    The file appears only when it is complete.
    """
    partial = path.with_name(f'{path.name}.part')
    with partial.open('wb') as file:
        np.savez(file, **vars(trajectory), summary=np.array(json.dumps(summary)))
    partial.replace(path)


def load_trajectory(path: Path) -> tuple[Trajectory, dict[str, Any]]:
    """Read the file that :func:`save_trajectory` wrote."""
    with np.load(path) as file:
        names = [each.name for each in fields(Trajectory)]
        return Trajectory(**{name: file[name] for name in names}), json.loads(str(file['summary']))
